//! Ends what is left of a run: orphans, by the kernel's own list of them.

use std::path::Path;
use std::time::Duration;

use node::{Namespace, clock};
use rustix::process::{Pid, Signal, WaitOptions};

/// What is left is killed again after this long, until nothing is left.
const POLL: Duration = Duration::from_millis(1);

/// Only a process that cannot be killed lives longer: it waits in the kernel for a device.
const STRANGERS_MAX: Duration = Duration::from_secs(5);

/// Names the robot in the environment of every process of its run.
pub(crate) const MARK: &str = "TESEO_ROBOT_DIRECTORY";

/// From now on, every process of the run that loses its parent is a child of this one.
pub(crate) fn inherit_orphans() {
    let watched = rustix::process::set_child_subreaper(Some(rustix::process::getpid()));
    if let Err(cause) = watched {
        tracing::warn!(%cause, "grandchildren that lose their parent will not be found");
    }
}

/// How long a process that drives the wheels may take to bring the robot to rest.
const WAY_TO_REST: Duration = Duration::from_millis(150);

/// Kills and reaps every child of this process, and whatever becomes one thereby, until there is
/// none. What drives the wheels is given time to stop them.
pub(crate) fn children() {
    let begun = clock::now();
    loop {
        let is_patient = clock::now().since(begun) < WAY_TO_REST;
        let is_spared = |pid: &Pid| is_patient && drives(*pid);
        own_children().into_iter().filter(|pid| !is_spared(pid)).for_each(kill);
        match rustix::process::wait(WaitOptions::NOHANG) {
            Ok(Some(_)) => {}
            Ok(None) => clock::nap(POLL),
            Err(_) => return,
        }
    }
}

/// Kills the children of this process that `belongs` does not know, of the node and life that
/// have just ended, and reaps those that have ended.
pub(crate) fn orphans(node: &str, epoch: u32, belongs: impl Fn(u32) -> bool) {
    let marks = [format!("TESEO_NODE={node}"), format!("TESEO_EPOCH={epoch}")];
    for pid in own_children() {
        let number = pid.as_raw_nonzero().get().unsigned_abs();
        if belongs(number) {
            continue;
        }
        let is_of_this_life = || {
            let environment = environment(number);
            marks.iter().all(|mark| environment.iter().any(|entry| entry == mark.as_bytes()))
        };
        if is_of_this_life() {
            kill(pid);
        }
        let _ = rustix::process::waitpid(Some(pid), WaitOptions::NOHANG);
    }
}

/// Kills what lives of a former run of this robot, wherever it is, and waits until it is gone. Only
/// for one who holds the lock.
pub(crate) fn strangers(namespace: &Namespace) {
    let begun = clock::now();
    loop {
        let strangers = marked(namespace.directory());
        if strangers.is_empty() || STRANGERS_MAX < clock::now().since(begun) {
            return;
        }
        strangers.into_iter().for_each(kill);
        clock::nap(POLL);
    }
}

fn marked(directory: &Path) -> Vec<Pid> {
    let mark = [MARK.as_bytes(), b"=", directory.as_os_str().as_encoded_bytes()].concat();
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(|&pid: &u32| pid != std::process::id() && environment(pid).contains(&mark))
        .filter_map(|pid| Pid::from_raw(i32::try_from(pid).ok().filter(|&pid| 1 < pid)?))
        .collect()
}

/// Whether the process drives the wheels, and was told so when it was started.
fn drives(pid: Pid) -> bool {
    let environment = environment(pid.as_raw_nonzero().get().unsigned_abs());
    environment.iter().any(|entry| entry.starts_with(node::SUPERVISOR.as_bytes()))
}

fn environment(pid: u32) -> Vec<Vec<u8>> {
    let all = std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    all.split(|&byte| byte == 0).map(<[u8]>::to_vec).collect()
}

fn kill(pid: Pid) {
    if let Err(cause) = rustix::process::kill_process(pid, Signal::KILL) {
        tracing::debug!(%cause, "gone already");
    }
}

/// This process's children, by the system's own list.
fn own_children() -> Vec<Pid> {
    let own = std::process::id();
    let listed = std::fs::read_to_string(format!("/proc/self/task/{own}/children"));
    let pids = listed.unwrap_or_default();
    pids.split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .filter(|&pid: &i32| 1 < pid)
        .filter_map(Pid::from_raw)
        .collect()
}

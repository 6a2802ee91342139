//! The outermost process: holds the robot's lock, and leaves nothing behind.

use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

use node::{EmergencyStop, Error, Namespace, Result, say, signal};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::{Pid, PidfdFlags, Signal};

use crate::check::check_all;
use crate::lock::Lock;
use crate::{Check, Options, detach, last_words, preflight, shim, shown, sweep};

/// Somebody may ask for the end in the very moment before this process waits.
const POLL: Duration = Duration::from_millis(250);

/// Runs a robot until it is done or asked to stop; returns the supervisor's exit code.
pub(crate) fn up(options: &Options, check: Check) -> Result<u8> {
    detach::leave_terminal();
    signal::listen();
    shown::go_down_with_screen();
    let settings = check_all(&options.config, &options.sets(), check)?;
    let namespace = settings.namespace()?;
    let lock = Lock::take(&namespace)?;
    // Of a run whose guardian and supervisor were killed at once.
    sweep::strangers(&namespace);
    namespace.clear();
    last_words::forget(&namespace);
    if let Err(error) = preflight::check(&settings) {
        namespace.remove();
        return Err(error);
    }
    mention_emergency_stop(&namespace);
    sweep::inherit_orphans();
    let outcome = start(&lock).and_then(watch).map(exit_code);
    sweep::children();
    if detach::is_alone() {
        last_words::keep(&namespace, *outcome.as_ref().unwrap_or(&1));
    }
    for path in namespace.remove() {
        tracing::warn!(path = %path.display(), "could not be removed");
    }
    drop(lock);
    outcome
}

/// A robot that is held from the start looks like one that hangs, above all in lock-step.
fn mention_emergency_stop(namespace: &Namespace) {
    let latch = EmergencyStop::of(namespace);
    if latch.is_latched() {
        let (robot, by) = (namespace.robot(), latch.reason().unwrap_or_default());
        say::mention(&format!(
            "teseo: robot '{robot}' will stand still: its emergency stop is latched, by {by}; \
             `teseo estop --clear --robot {robot}` releases it"
        ));
    }
}

/// Starts this very command again as the supervisor, which holds the lock with this process: who
/// finds it free finds nothing of the run alive.
fn start(lock: &Lock) -> Result<Child> {
    let executable = shim::own_path();
    let failed = |cause| Error::File { path: executable.clone(), cause };
    let lock = lock.file().try_clone().map_err(failed)?;
    Command::new(&executable)
        .args(std::env::args_os().skip(1))
        .stdin(lock)
        .env(node::PARENT, std::process::id().to_string())
        .env(ROLE, "supervisor")
        // Ctrl-C is for the guardian alone, which passes it on in order.
        .process_group(0)
        .spawn()
        .map_err(failed)
}

/// Set for the process that `up` starts: it is the supervisor.
pub(crate) const ROLE: &str = "TESEO_ROLE";

/// The guardian of this supervisor.
pub(crate) fn pid() -> u32 {
    let parent = std::env::var(node::PARENT).ok();
    parent.and_then(|pid| pid.parse().ok()).unwrap_or_default()
}

/// [-] Asked so often, the robot goes down without its supervisor.
const REQUESTS_MAX: u32 = 3;

/// Passes on what people ask for, until the supervisor has ended.
fn watch(mut supervisor: Child) -> Result<ExitStatus> {
    let failed = |cause: &dyn std::fmt::Display| {
        Error::Fault(format!("lost sight of the supervisor: {cause}"))
    };
    let pid = i32::try_from(supervisor.id()).ok().and_then(Pid::from_raw);
    let pid = pid.ok_or_else(|| failed(&"it has no process id"))?;
    let pidfd =
        rustix::process::pidfd_open(pid, PidfdFlags::empty()).map_err(|cause| failed(&cause))?;
    let mut passed_on = 0;
    loop {
        if let Some(status) = supervisor.try_wait().map_err(|cause| failed(&cause))? {
            return Ok(status);
        }
        let requests = signal::stop_requests();
        if passed_on < requests {
            // The first asks, the second insists, the third is for the guardian itself to see to.
            let is_last = REQUESTS_MAX <= requests;
            let signal = if is_last { Signal::KILL } else { Signal::TERM };
            (passed_on..requests).for_each(|_| send(pid, signal));
            passed_on = requests;
        }
        if detach::is_alone() || shown::is_shown() {
            last_words::trim();
        }
        wait(&pidfd);
    }
}

/// Until the supervisor ends or somebody asks for something.
fn wait(pidfd: &impl AsFd) {
    let mut fds = vec![PollFd::new(pidfd, PollFlags::IN)];
    fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
    let timeout = Timespec::try_from(POLL).unwrap_or_default();
    // However it ends, the caller looks.
    let _ = rustix::event::poll(&mut fds, Some(&timeout));
    signal::sleep_again();
}

fn send(pid: Pid, signal: Signal) {
    if let Err(cause) = rustix::process::kill_process(pid, signal) {
        tracing::debug!(%cause, "the supervisor is gone already");
    }
}

pub(crate) fn exit_code(status: ExitStatus) -> u8 {
    // Killed by a signal: as a shell would say it.
    let killed = std::os::unix::process::ExitStatusExt::signal(&status).map(|signal| 128 + signal);
    status.code().or(killed).and_then(|code| u8::try_from(code).ok()).unwrap_or(1)
}

/// Whether the process does anything still: the dead may wait for somebody to take note.
pub(crate) fn is_alive(pid: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    status.lines().any(|line| line.starts_with("State:") && !line.contains('Z'))
}

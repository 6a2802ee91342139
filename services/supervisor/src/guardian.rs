//! The outermost process: holds the robot's lock, and leaves nothing behind.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

use node::{Error, Namespace, Result, Settings, clock, signal};
use rustix::fs::FlockOperation;
use rustix::process::{Pid, Signal, WaitOptions};

use crate::check::check_all;
use crate::{Check, Options};

/// Between two looks at the supervisor: short for a person, long for a processor.
const POLL: Duration = Duration::from_millis(10);

/// What is left of a run is killed again after this long, until nothing is left.
const SWEEP_POLL: Duration = Duration::from_millis(1);

/// Runs a robot until it is done or asked to stop; returns the supervisor's exit code.
pub(crate) fn up(options: &Options, check: Check) -> Result<u8> {
    signal::listen();
    let settings = Settings::of_supervisor(&options.config, &options.sets())?;
    check_all(&options.config, &settings, check)?;
    let namespace = settings.namespace()?;
    let lock = Lock::take(&namespace)?;
    namespace.clear();
    let watched = rustix::process::set_child_subreaper(Some(rustix::process::getpid()));
    if let Err(cause) = watched {
        tracing::warn!(%cause, "grandchildren that lose their parent will not be found");
    }
    let outcome = start().and_then(watch);
    sweep_processes();
    for path in namespace.remove() {
        tracing::warn!(path = %path.display(), "could not be removed");
    }
    drop(lock);
    outcome.map(exit_code)
}

/// Starts this very command again as the supervisor.
fn start() -> Result<Child> {
    let failed = |cause| Error::File { path: "/proc/self/exe".into(), cause };
    let executable = std::env::current_exe().map_err(failed)?;
    let arguments = std::env::args_os().skip(1);
    Command::new(&executable)
        .args(arguments)
        .env(node::PARENT, std::process::id().to_string())
        .env(ROLE, "supervisor")
        // Ctrl-C is for the guardian alone, which passes it on in order.
        .process_group(0)
        .spawn()
        .map_err(|cause| Error::File { path: executable, cause })
}

/// Set for the process that `up` starts: it is the supervisor.
pub(crate) const ROLE: &str = "TESEO_ROLE";

/// Passes on what people ask for, until the supervisor has ended.
fn watch(mut supervisor: Child) -> Result<ExitStatus> {
    let mut passed_on = 0;
    loop {
        let ended = supervisor
            .try_wait()
            .map_err(|cause| Error::Fault(format!("lost sight of the supervisor: {cause}")))?;
        if let Some(status) = ended {
            return Ok(status);
        }
        let requests = signal::stop_requests();
        if passed_on < requests {
            // Asked a second time: at once.
            let urgent = if requests == 1 { Signal::TERM } else { Signal::KILL };
            send(&supervisor, urgent);
            passed_on = requests;
        }
        clock::nap(POLL);
    }
}

fn send(child: &Child, signal: Signal) {
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    if let Some(pid) = pid
        && let Err(cause) = rustix::process::kill_process(pid, signal)
    {
        tracing::debug!(%cause, "the supervisor is gone already");
    }
}

/// Kills whatever of the run still lives: as a subreaper, every orphan is a child of this process.
fn sweep_processes() {
    loop {
        for pid in children() {
            if let Err(cause) = rustix::process::kill_process(pid, Signal::KILL) {
                tracing::debug!(%cause, "gone already");
            }
        }
        match rustix::process::wait(WaitOptions::NOHANG) {
            Ok(Some(_)) => {}
            Ok(None) => clock::nap(SWEEP_POLL),
            Err(_) => return,
        }
    }
}

/// This process's children, by the system's own list.
fn children() -> Vec<Pid> {
    let own = std::process::id();
    let listed = std::fs::read_to_string(format!("/proc/self/task/{own}/children"));
    let pids = listed.unwrap_or_default();
    pids.split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .filter(|&pid: &i32| 1 < pid)
        .filter_map(Pid::from_raw)
        .collect()
}

fn exit_code(status: ExitStatus) -> u8 {
    // Killed by a signal: as a shell would say it.
    let killed = std::os::unix::process::ExitStatusExt::signal(&status).map(|signal| 128 + signal);
    status.code().or(killed).and_then(|code| u8::try_from(code).ok()).unwrap_or(1)
}

/// The right to run a robot, held until dropped; the kernel takes it back from the dead.
struct Lock(#[expect(dead_code, reason = "held open, and that is its use")] File);

impl Lock {
    fn take(namespace: &Namespace) -> Result<Self> {
        loop {
            namespace.create_directory()?;
            let path = namespace.lock();
            let failed = |cause| Error::File { path: path.clone(), cause };
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(failed)?;
            if rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                let mut process = String::new();
                file.read_to_string(&mut process).map_err(failed)?;
                let robot = namespace.robot().to_owned();
                return Err(Error::Held { robot, process: process.trim().to_owned() });
            }
            // The former holder may have removed the file between our opening and locking it.
            let ours = file.metadata().map_err(failed)?.ino();
            if std::fs::metadata(&path).is_ok_and(|present| present.ino() == ours) {
                file.set_len(0).map_err(failed)?;
                file.rewind().map_err(failed)?;
                writeln!(file, "{}", std::process::id()).map_err(failed)?;
                return Ok(Self(file));
            }
        }
    }
}

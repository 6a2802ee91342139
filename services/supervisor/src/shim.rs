//! `teseo __exec`: between the supervisor's spawn and the program, all that has to be done in the
//! new process itself. It replaces itself with the program, which keeps its process id.

use std::ffi::OsString;
use std::io::Write;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use clap::Args;
use node::Namespace;
use node::launch::Process;
use rustix::process::{Pid, Resource, Signal};
use rustix::thread::CpuSet;

use crate::sweep;

/// The verb's name, which is for the supervisor alone.
pub(crate) const VERB: &str = "__exec";

/// As a shell says it: found, but not to be run.
const NOT_RUN: u8 = 126;

/// What to become, and how.
#[derive(Debug, Clone, Args)]
pub struct ExecOptions {
    /// The process without which the program must not live
    #[arg(long)]
    parent: i32,

    /// It is asked to end when that one is gone, rather than killed
    #[arg(long)]
    drives: bool,

    /// The processors it may run on
    #[arg(long, value_delimiter = ',')]
    cpus: Vec<usize>,

    /// The program and its arguments
    #[arg(last = true, required = true)]
    command: Vec<OsString>,
}

/// Becomes the program; returns only where that cannot be.
pub(crate) fn exec(options: &ExecOptions) -> ExitCode {
    let Err(why) = prepare(options).map(|()| {
        let (program, arguments) = options.command.split_first().unwrap_or_else(|| unreachable!());
        let cause = Command::new(program).args(arguments).exec();
        format!("cannot run {}: {cause}", Path::new(program).display())
    }) else {
        return ExitCode::from(NOT_RUN);
    };
    drop(writeln!(std::io::stderr(), "{why}"));
    ExitCode::from(NOT_RUN)
}

/// The kernel ends this process with its supervisor: told first, looked after second, so that there
/// is no moment between. It outlasts the exec.
fn prepare(options: &ExecOptions) -> Result<(), String> {
    let signal = if options.drives { Signal::TERM } else { Signal::KILL };
    rustix::process::set_parent_process_death_signal(Some(signal))
        .map_err(|cause| format!("cannot be tied to the supervisor: {cause}"))?;
    if rustix::process::getppid() != Pid::from_raw(options.parent) {
        return Err("the supervisor is gone already".to_owned());
    }
    // Before the program, so that it finds its place free; and here, since this may hang: whoever does
    // not come up in time is killed and begun anew.
    let robot = std::env::var_os(sweep::MARK).map(PathBuf::from);
    if let Some(robot) = robot.as_deref().and_then(Namespace::at) {
        robot.clear_dead().map_err(|cause| cause.to_string())?;
    }
    // As much as the system lets it have: what a process may lock is not what it does.
    let mut limit = rustix::process::getrlimit(Resource::Memlock);
    limit.current = limit.maximum;
    let _ = rustix::process::setrlimit(Resource::Memlock, limit);
    keep_to(&options.cpus)
}

/// From now on the calling thread runs on these processors alone; on all where none are named.
pub(crate) fn keep_to(cpus: &[usize]) -> Result<(), String> {
    if cpus.is_empty() {
        return Ok(());
    }
    let mut set = CpuSet::new();
    for &cpu in cpus {
        set.set(cpu);
    }
    rustix::thread::sched_setaffinity(None, &set)
        .map_err(|cause| format!("cannot run on the processors {cpus:?}: {cause}"))
}

/// The command that starts `program` with `arguments` under the shim, as a child of this process.
pub(crate) fn command(process: &Process, program: &Path, arguments: &[String]) -> Command {
    let mut command = Command::new(own_path());
    command.arg(VERB).arg(format!("--parent={}", std::process::id()));
    if process.drives {
        command.arg("--drives").env(node::SUPERVISOR, std::process::id().to_string());
    } else {
        command.env_remove(node::SUPERVISOR);
    }
    if !process.cpu_affinity.is_empty() {
        let cpus: Vec<_> = process.cpu_affinity.iter().map(usize::to_string).collect();
        command.arg(format!("--cpus={}", cpus.join(",")));
    }
    command.arg("--");
    if let Some(priority) = process.cpu_scheduling_priority {
        // util-linux: the system call has no safe form in the libraries that we use.
        command.args(["chrt", "--fifo", &priority.to_string()]);
    }
    command.arg(program).args(arguments);
    command
}

/// This very executable, by its name unless a new build has taken that.
pub(crate) fn own_path() -> PathBuf {
    let own = PathBuf::from("/proc/self/exe");
    let inode = |path: &Path| std::fs::metadata(path).ok().map(|file| (file.dev(), file.ino()));
    let named = std::env::current_exe().ok().filter(|named| inode(named) == inode(&own));
    named.unwrap_or(own)
}

/// The program that `exec` names: beside this executable, or a path, or along `PATH`.
pub(crate) fn find_program(name: &str) -> Result<PathBuf, String> {
    let is_program = |path: &Path| {
        rustix::fs::access(path, rustix::fs::Access::EXEC_OK).is_ok() && !path.is_dir()
    };
    if name.contains('/') {
        let path = PathBuf::from(name);
        return match rustix::fs::access(&path, rustix::fs::Access::EXEC_OK) {
            Ok(()) if !path.is_dir() => Ok(path),
            Ok(()) => Err(format!("cannot run {name}: it is a directory")),
            Err(cause) => {
                let cause = std::io::Error::from(cause).kind();
                Err(format!("cannot run {name}: {cause}"))
            }
        };
    }
    let beside = std::env::current_exe().ok().map(|own| own.with_file_name(name));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let along = std::env::split_paths(&path).map(|directory| directory.join(name));
    beside
        .into_iter()
        .chain(along)
        .find(|path| is_program(path))
        .ok_or_else(|| format!("cannot run {name}: it is neither beside teseo nor in PATH"))
}

//! `teseo up --detach`: the robot goes on when this command has returned.

use std::fs::File;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use node::{Error, Namespace, Result, Settings, clock};
use rustix::fs::MemfdFlags;
use rustix::process::Pid;

use crate::{Options, guardian, last_words, shim, verbs};

/// Between two looks at whether the robot is ready.
const POLL: Duration = Duration::from_millis(10);

/// Set for the guardian that runs on: it leaves the terminal.
pub(crate) const ALONE: &str = "TESEO_DETACHED";

/// Starts the robot, and returns when it is ready or has failed.
pub(crate) fn up(options: &Options) -> Result<u8> {
    let settings = Settings::of_supervisor(&options.config, &options.sets())?;
    let namespace = settings.namespace()?;
    let failed = |cause: std::io::Error| Error::Fault(format!("cannot detach: {cause}"));
    // Nobody has to read it, and no pipe's end can be missing.
    let said = rustix::fs::memfd_create("teseo up", MemfdFlags::CLOEXEC);
    let said = File::from(said.map_err(|cause| failed(cause.into()))?);
    let (out, err) = (said.try_clone().map_err(failed)?, said.try_clone().map_err(failed)?);
    let guardian = Command::new(shim::own_path())
        .args(std::env::args_os().skip(1))
        .env(ALONE, "1")
        .stdin(Stdio::null())
        .stdout(out)
        .stderr(err)
        .spawn()
        .map_err(failed)?;
    await_ready(guardian, &namespace, said)
}

fn await_ready(mut guardian: Child, namespace: &Namespace, said: File) -> Result<u8> {
    let mut said = Said { file: said, shown: 0 };
    loop {
        let ended = guardian.try_wait();
        let ended = ended.map_err(|cause| Error::Fault(format!("lost sight of it: {cause}")))?;
        // Not another's, which had the robot before this guardian could find it held.
        let is_ready = verbs::is_ready(namespace, guardian.id());
        said.show();
        if ended.is_none() && !is_ready {
            clock::nap(POLL);
            continue;
        }
        if ended.is_some() {
            last_words::forget(namespace);
        }
        return Ok(ended.map_or(0, guardian::exit_code));
    }
}

/// What the guardian has written, and how much of it is shown.
struct Said {
    file: File,
    shown: u64,
}

impl Said {
    /// Shows what has come, without moving the place where the guardian writes.
    fn show(&mut self) {
        let mut piece = [0; 4096];
        while let Ok(length @ 1..) = self.file.read_at(&mut piece, self.shown) {
            drop(std::io::stdout().write_all(&piece[..length]));
            self.shown += length as u64;
        }
    }
}

/// Whether this is the guardian that runs on.
pub(crate) fn is_alone() -> bool {
    std::env::var_os(ALONE).is_some()
}

/// In the guardian that runs on: no terminal can end it.
pub(crate) fn leave_terminal() {
    if is_alone()
        && let Err(cause) = rustix::process::setsid()
    {
        let own: Pid = rustix::process::getpid();
        tracing::warn!(%cause, ?own, "the robot may end with this terminal");
    }
}

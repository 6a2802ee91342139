//! `teseo up --view`: the robot under a screen, which another service draws.

use std::fs::File;
use std::io::Write;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use node::{Error, Namespace, Result, Settings, clock, control, signal};
use rustix::fs::MemfdFlags;
use rustix::process::{Pid, Signal};

use crate::{Options, guardian, last_words, shim};

/// Between two looks at whether the robot is held, or has ended.
const POLL: Duration = Duration::from_millis(10);

/// Set for the guardian under a screen: it goes down with whoever shows it.
pub(crate) const SHOWN: &str = "TESEO_SHOWN";

/// A robot that a screen is to show. What it prints goes into memory: the terminal is the screen's.
#[derive(Debug)]
pub struct Shown {
    namespace: Namespace,
    guardian: Child,
    said: File,
}

impl Shown {
    /// Brings the robot up; returns as soon as it is held, or has ended again.
    pub fn start(options: &Options) -> Result<Self> {
        let settings = Settings::of_supervisor(&options.config, &options.sets())?;
        let namespace = settings.namespace()?;
        let failed = |cause: std::io::Error| Error::Fault(format!("cannot run it: {cause}"));
        let said = rustix::fs::memfd_create("teseo up", MemfdFlags::CLOEXEC);
        let said = File::from(said.map_err(|cause| failed(cause.into()))?);
        let (out, err) = (said.try_clone().map_err(failed)?, said.try_clone().map_err(failed)?);
        let guardian = Command::new(shim::own_path())
            .args(options.words())
            .env(SHOWN, "1")
            .env(node::PARENT, std::process::id().to_string())
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            .spawn()
            .map_err(failed)?;
        let mut shown = Self { namespace, guardian, said };
        while !shown.has_ended() && !shown.is_held() {
            clock::nap(POLL);
        }
        Ok(shown)
    }

    /// The robot, where it is there to be shown.
    pub fn namespace(&mut self) -> Option<&Namespace> {
        (!self.has_ended()).then_some(&self.namespace)
    }

    /// Takes the robot down, where it is still up, and waits until nothing of it is left. Prints the
    /// last of what it has said; returns the exit code of its run.
    pub fn end(mut self) -> Result<u8> {
        let mut asked = false;
        let mut insisted = signal::stop_requests();
        while !self.has_ended() {
            // Whoever asks again while it goes down insists.
            let requests = signal::stop_requests();
            if !asked || insisted < requests {
                (asked, insisted) = (true, requests);
                self.signal();
            }
            clock::nap(POLL);
        }
        let status = self.guardian.wait();
        let status = status.map_err(|cause| Error::Fault(format!("lost sight of it: {cause}")))?;
        let text = last_words::last_of(&self.said).join("\n") + "\n";
        // Whoever closed it does not want to know.
        drop(std::io::stdout().write_all(text.as_bytes()));
        Ok(guardian::exit_code(status))
    }

    fn signal(&self) {
        let pid = i32::try_from(self.guardian.id()).ok().filter(|&pid| 1 < pid);
        if let Some(pid) = pid.and_then(Pid::from_raw) {
            // It is not reaped yet, so the number is still its own.
            let _ = rustix::process::kill_process(pid, Signal::TERM);
        }
    }

    fn has_ended(&mut self) -> bool {
        // Where nobody can tell, there is nothing to wait for.
        !matches!(self.guardian.try_wait(), Ok(None))
    }

    fn is_held(&self) -> bool {
        control::guardian(&self.namespace) == Some(self.guardian.id())
    }
}

/// Whether this guardian is under a screen.
pub(crate) fn is_shown() -> bool {
    std::env::var_os(SHOWN).is_some()
}

/// In the guardian under a screen: whoever shows the robot and dies takes it down.
pub(crate) fn go_down_with_screen() {
    if is_shown() {
        node::die_with_parent(Signal::TERM);
    }
}

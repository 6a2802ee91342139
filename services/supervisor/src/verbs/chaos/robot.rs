//! The robot with which things go wrong: a child of this command, which goes down with it.

use std::fs::File;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use interfaces::Stamp;
use node::control::{self, Connection, Failure, Heard, Request, told};
use node::{Namespace, clock};
use rustix::fs::MemfdFlags;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde_json::Value;

use super::schedule::{Blow, What};
use super::story::Struck;
use crate::verbs::motion;
use crate::{guardian, last_words, shim};
use node::say::say;

/// A robot is ready, or down, long before this, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);

/// [-] What a robot that has ended has said last, as far as it matters: a mistake and what mends it.
const LINES: usize = 12;

/// Between two looks at a robot that comes up or goes down.
const POLL: Duration = Duration::from_millis(10);

/// A robot that runs under this command.
pub(super) struct Robot<'a> {
    child: Child,
    namespace: &'a Namespace,
    said: File,
    /// Who was stopped, and until when.
    stopped: Vec<(Stamp, OwnedFd)>,
}

impl<'a> Robot<'a> {
    /// Up, and ready.
    pub(super) fn up(
        launch: &Path,
        sets: &[String],
        namespace: &'a Namespace,
    ) -> Result<Self, Failure> {
        let failed = |cause: std::io::Error| Failure::Refused(format!("cannot start it: {cause}"));
        let said = rustix::fs::memfd_create("teseo up", MemfdFlags::CLOEXEC);
        let said = File::from(said.map_err(|cause| failed(cause.into()))?);
        let child = Command::new(shim::own_path())
            // Whatever ends this command ends the robot too, in order.
            .args([shim::VERB, &format!("--parent={}", std::process::id()), "--drives", "--"])
            .arg(shim::own_path())
            .arg("up")
            .arg(launch)
            .arg("--log-level=error")
            .args(sets.iter().map(|set| format!("--set={set}")))
            // Ctrl-C is for this command.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(said.try_clone().map_err(failed)?)
            .stderr(said.try_clone().map_err(failed)?)
            .spawn()
            .map_err(failed)?;
        let mut robot = Self { child, namespace, said, stopped: Vec::new() };
        robot.await_ready()?;
        Ok(robot)
    }

    /// Waits until it is ready; one that has ended never will be.
    pub(super) fn await_ready(&mut self) -> Result<(), Failure> {
        let until = clock::now().after(PATIENCE);
        while !self.status().is_ok_and(|status| status["state"] == "ready") {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                let said = last_words::last_of(&self.said);
                let said = said[said.len().saturating_sub(LINES)..].join("\n");
                return Err(Failure::Refused(format!("the robot has ended; it said:\n{said}")));
            }
            control::check_stop()?;
            if until <= clock::now() {
                return Err(Failure::TooLong(format!("it is not ready within {PATIENCE:?}")));
            }
            self.resume();
            clock::nap(POLL);
        }
        Ok(())
    }

    /// The robot as it stands, if it is ours.
    pub(super) fn status(&self) -> Result<Value, Failure> {
        let status = control::look(self.namespace);
        let ours = status.filter(|status| status["guardian"] == self.child.id());
        ours.ok_or_else(|| Failure::NotRunning("the robot does not answer".to_owned()))
    }

    /// Strikes as `blows` say, and listens, for so long; or until Ctrl-C, or until it goes away.
    pub(super) fn endure(
        &mut self,
        blows: Vec<Blow>,
        length: Duration,
    ) -> Result<Vec<Struck>, Failure> {
        let request = Request::Events { node: None, follow: true };
        let mut events = Connection::open(self.namespace, &request)?;
        let begun = clock::now();
        let mut blows = blows.into_iter().peekable();
        let mut struck: Vec<Struck> = Vec::new();
        loop {
            self.resume();
            let due = begun.after(blows.peek().map_or(length, |blow| blow.at));
            if due <= clock::now() {
                show(struck.last(), begun)?;
                let Some(blow) = blows.next() else { return Ok(struck) };
                struck.push(self.strike(blow));
                continue;
            }
            let resumed = self.stopped.iter().map(|(until, _)| *until).min();
            match events.hear(Some(resumed.map_or(due, |resumed| resumed.min(due)))) {
                Ok(Heard::Line(line)) => self.hear(&told(&line)?["event"], struck.last_mut()),
                Ok(Heard::Nothing) => {}
                Ok(Heard::End) | Err(Failure::Unwanted) => {
                    show(struck.last(), begun)?;
                    return Ok(struck);
                }
                Err(failure) => return Err(failure),
            }
        }
    }

    fn hear(&self, event: &Value, struck: Option<&mut Struck>) {
        if let Some(struck) = struck {
            struck.hear(event);
        }
        if event["motion"]["needs_person"] == true {
            // There is one. Where nobody answers, it is asked again at the next such event.
            drop(motion::arm(Some(self.namespace.robot())));
        }
    }

    fn strike(&mut self, blow: Blow) -> Struck {
        let victim = self.victim(&blow.node);
        let now = clock::now();
        let process = victim.and_then(|(process, victim)| {
            let signal = match blow.what {
                What::Kill => Signal::KILL,
                What::Stop(_) => Signal::STOP,
            };
            pidfd_send_signal(&victim, signal).ok()?;
            if let What::Stop(duration) = blow.what {
                self.stopped.push((now.after(duration), victim));
            }
            Some(process)
        });
        Struck::new(blow, now.seconds(), process)
    }

    /// A node's process, by what the robot itself says: before and after it was taken hold of, since
    /// a number may come to be another's.
    fn victim(&self, node: &str) -> Option<(u32, OwnedFd)> {
        let process = self.process(node)?;
        let pid = Pid::from_raw(i32::try_from(process).ok()?)?;
        let victim = pidfd_open(pid, PidfdFlags::empty()).ok()?;
        (self.process(node) == Some(process)).then_some((process, victim))
    }

    fn process(&self, node: &str) -> Option<u32> {
        let status = self.status().ok()?;
        let node = status["nodes"].as_array()?.iter().find(|other| other["name"] == node)?;
        let process = u32::try_from(node["pid"].as_u64()?).ok()?;
        let is_node = 1 < process && status["supervisor"] != process && self.child.id() != process;
        is_node.then_some(process)
    }

    /// Whoever was stopped for long enough goes on.
    fn resume(&mut self) {
        let now = clock::now();
        self.stopped.retain(|(until, process)| {
            let is_over = *until <= now;
            if is_over {
                // It may have been killed meanwhile.
                let _ = pidfd_send_signal(process, Signal::CONT);
            }
            !is_over
        });
    }

    /// Down in order; its exit code.
    pub(super) fn down(mut self) -> Result<u8, Failure> {
        self.end()
    }

    fn end(&mut self) -> Result<u8, Failure> {
        let until = clock::now().after(PATIENCE);
        if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw)
            && matches!(self.child.try_wait(), Ok(None))
        {
            // It is not reaped yet, so that the number is its own.
            let _ = rustix::process::kill_process(pid, Signal::TERM);
        }
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Ok(guardian::exit_code(status)),
                Ok(None) if clock::now() < until => {}
                Ok(None) | Err(_) => {
                    return Err(Failure::TooLong(format!("it is not down within {PATIENCE:?}")));
                }
            }
            self.resume();
            clock::nap(POLL);
        }
    }
}

impl Drop for Robot<'_> {
    fn drop(&mut self) {
        // Where something went wrong before it was taken down.
        drop(self.end());
    }
}

/// Tells what became of the last that was struck, by now.
fn show(struck: Option<&Struck>, begun: Stamp) -> Result<(), Failure> {
    struck.map_or(Ok(()), |struck| say(&struck.line(begun.seconds(), clock::now().seconds())))
}

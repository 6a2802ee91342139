//! A connection to a supervisor: one request, then its answers, each within its time.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

use interfaces::Stamp;
use node::{Namespace, clock, signal};
use rustix::event::{PollFd, PollFlags, Timespec};
use serde_json::Value;

use super::Failure;
use crate::control::Request;
use crate::lock;

/// A supervisor that turns at all answers many times faster.
const PATIENCE: Duration = Duration::from_secs(5);

/// Between two attempts to reach a supervisor that is about to listen.
const POLL: Duration = Duration::from_millis(10);

/// The robot that is meant: by its name, or because no other runs.
pub(super) fn find(name: Option<&str>) -> Result<Namespace, Failure> {
    if let Some(name) = name {
        return Namespace::new(name).map_err(|error| Failure::Unclear(error.to_string()));
    }
    let all = Namespace::all_under(&Namespace::runtime_directory());
    let mut running: Vec<_> = all.into_iter().filter(is_running).collect();
    match (running.pop(), running.len()) {
        (None, _) => {
            let help = "no robot is running; `teseo up FILE` starts one";
            Err(Failure::NotRunning(help.to_owned()))
        }
        (Some(namespace), 0) => Ok(namespace),
        (Some(last), _) => {
            let all: Vec<_> = running.iter().chain([&last]).map(Namespace::robot).collect();
            let all = all.join(", ");
            Err(Failure::Unclear(format!("several robots are running: {all}; name one: --robot")))
        }
    }
}

pub(super) fn is_running(namespace: &Namespace) -> bool {
    UnixStream::connect(socket(namespace)).is_ok() || guardian(namespace).is_some()
}

fn socket(namespace: &Namespace) -> PathBuf {
    namespace.directory().join("control")
}

/// The process that holds the robot, though perhaps no supervisor listens yet, or any more. The
/// lock itself is not tried: that would turn away a guardian that tries it at the same time.
pub(super) fn guardian(namespace: &Namespace) -> Option<u32> {
    let pid: u32 = fs::read_to_string(namespace.lock()).ok()?.trim().parse().ok()?;
    // Another process may have the number by now.
    lock::is_open_in(pid, &namespace.lock()).then_some(pid)
}

/// The robot as it stands, where anybody can tell at this moment.
pub(super) fn look(namespace: &Namespace) -> Option<Value> {
    let stream = UnixStream::connect(socket(namespace)).ok()?;
    let mut connection = Connection::of(namespace, stream, &Request::Status).ok()?;
    connection.answer().ok()
}

/// What is heard from a supervisor.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// One line of its answer.
    Line(String),
    /// That there is no more.
    End,
    /// Nothing in the time that it had.
    Nothing,
}

/// One request and its answers.
#[derive(Debug)]
pub(super) struct Connection {
    robot: String,
    guardian: Option<u32>,
    stream: UnixStream,
    /// What has come and was not taken yet.
    come: Vec<u8>,
}

impl Connection {
    /// Asks; waits for a supervisor that is about to listen.
    pub(super) fn open(namespace: &Namespace, request: &Request) -> Result<Self, Failure> {
        let until = clock::now().after(PATIENCE);
        loop {
            let cause = match UnixStream::connect(socket(namespace)) {
                Ok(stream) => return Self::of(namespace, stream, request),
                Err(cause) => cause,
            };
            let robot = namespace.robot();
            let is_absent =
                matches!(cause.kind(), ErrorKind::NotFound | ErrorKind::ConnectionRefused);
            if !is_absent {
                return Err(Failure::Refused(format!("cannot reach robot '{robot}': {cause}")));
            }
            let Some(guardian) = guardian(namespace) else {
                return Err(Failure::NotRunning(format!("robot '{robot}' is not running")));
            };
            if until <= clock::now() {
                return Err(silent(robot, Some(guardian)));
            }
            check_stop()?;
            clock::nap(POLL);
        }
    }

    fn of(
        namespace: &Namespace,
        mut stream: UnixStream,
        request: &Request,
    ) -> Result<Self, Failure> {
        let robot = namespace.robot().to_owned();
        let failed = |cause: std::io::Error| {
            Failure::NotRunning(format!("robot '{robot}' went away: {cause}"))
        };
        let line = serde_json::to_string(request).unwrap_or_default();
        // It fits into what the kernel holds for one who does not read yet.
        let written = stream.write_all(format!("{line}\n").as_bytes());
        // Where it fails, the reason is among the answers: there may be too many at the socket.
        if written.as_ref().is_err_and(|cause| cause.kind() != ErrorKind::BrokenPipe) {
            written.map_err(failed)?;
        }
        stream.set_nonblocking(true).map_err(failed)?;
        let guardian = guardian(namespace);
        Ok(Self { robot, guardian, stream, come: Vec::new() })
    }

    /// Its one answer.
    pub(super) fn answer(&mut self) -> Result<Value, Failure> {
        match self.next_in_time()? {
            Some(line) => told(&line),
            None => Err(self.gone()),
        }
    }

    /// The next line of its answer, which is due; nothing where there is no more.
    pub(super) fn next_in_time(&mut self) -> Result<Option<String>, Failure> {
        match self.hear(Some(clock::now().after(PATIENCE)))? {
            Heard::Line(line) => Ok(Some(line)),
            Heard::End => Ok(None),
            Heard::Nothing => Err(silent(&self.robot, self.guardian)),
        }
    }

    /// Waits for the next line; where `until` says nothing, for ever.
    pub(super) fn hear(&mut self, until: Option<Stamp>) -> Result<Heard, Failure> {
        loop {
            if let Some(end) = self.come.iter().position(|&byte| byte == b'\n') {
                let line: Vec<_> = self.come.drain(..=end).collect();
                return Ok(Heard::Line(String::from_utf8_lossy(&line[..end]).into_owned()));
            }
            check_stop()?;
            let now = clock::now();
            if until.is_some_and(|until| until <= now) {
                return Ok(Heard::Nothing);
            }
            let mut bytes = [0; 16 * 1024];
            match self.stream.read(&mut bytes) {
                Ok(0) => return Ok(Heard::End),
                Ok(count) => self.come.extend_from_slice(&bytes[..count]),
                Err(cause) if cause.kind() == ErrorKind::Interrupted => {}
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => {
                    wait(Some(&self.stream), until.map(|until| until.since(now)));
                }
                // It was ended while it still had something to read.
                Err(_) => return Ok(Heard::End),
            }
        }
    }

    /// That it has ended without an answer.
    pub(super) fn gone(&self) -> Failure {
        Failure::NotRunning(format!("robot '{}' went away", self.robot))
    }
}

/// Waits until something has come or Ctrl-C was pressed, but no longer than `timeout`.
pub(super) fn wait(stream: Option<&UnixStream>, timeout: Option<Duration>) {
    let mut fds: Vec<_> =
        stream.map(|stream| PollFd::new(stream, PollFlags::IN)).into_iter().collect();
    fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
    let timeout = timeout.and_then(|timeout| Timespec::try_from(timeout).ok());
    // However it ends, the caller looks.
    let _ = rustix::event::poll(&mut fds, timeout.as_ref());
    signal::sleep_again();
}

/// Ctrl-C ends whoever follows; see [`signal::listen`].
pub(super) fn check_stop() -> Result<(), Failure> {
    if 0 < signal::stop_requests() { Err(Failure::Unwanted) } else { Ok(()) }
}

/// What a line says, or why the supervisor says no.
pub(super) fn told(line: &str) -> Result<Value, Failure> {
    let value: Value = serde_json::from_str(line).map_err(|cause| {
        Failure::Refused(format!("the supervisor's answer is none ({cause}); is it of this build?"))
    })?;
    match value.get("error") {
        Some(error) => Err(Failure::Refused(error.as_str().unwrap_or_default().to_owned())),
        None => Ok(value),
    }
}

fn silent(robot: &str, guardian: Option<u32>) -> Failure {
    let help = guardian.map_or(String::new(), |pid| {
        format!("; SIGTERM three times to its guardian, process {pid}, ends it without an answer")
    });
    Failure::TooLong(format!("the supervisor of robot '{robot}' does not answer{help}"))
}

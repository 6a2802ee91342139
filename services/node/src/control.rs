//! The other end of a supervisor's control socket: one request, then its answers, each in its time.

use std::convert::Infallible;
use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use interfaces::Stamp;
use rustix::event::{PollFd, PollFlags, Timespec};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::namespace::check_name;
use crate::{Namespace, clock, signal};

/// [-] Lines of a log, for one who does not say how many.
pub const LINES: usize = 100;

/// A supervisor that turns at all answers many times faster.
const PATIENCE: Duration = Duration::from_secs(5);

/// Between two attempts to reach a supervisor that is about to listen.
const POLL: Duration = Duration::from_millis(10);

/// What can be asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "verb", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// Whether anybody is there.
    Ping,
    /// The robot as it stands.
    Status,
    /// The robot down, in order.
    Down,
    /// What has happened.
    Events {
        /// To this node, or to all.
        node: Option<String>,
        /// And what will.
        #[serde(default)]
        follow: bool,
    },
    /// What nodes have written.
    Logs {
        /// This node, or all.
        node: Option<String>,
        /// And what will be.
        #[serde(default)]
        follow: bool,
        /// [-] The last so many lines.
        #[serde(default = "lines")]
        lines: usize,
    },
    /// A node and whoever requires it, down and up again.
    Restart {
        /// The node.
        node: String,
    },
    /// A node and whoever it requires, up.
    Start {
        /// The node.
        node: String,
    },
    /// A node and whoever requires it, down until it is started again.
    Stop {
        /// The node.
        node: String,
    },
    /// Another value of one parameter, from now until the node's life ends.
    Set {
        /// The node.
        node: String,
        /// Dotted, with its unit at the end.
        key: String,
        /// [as the key says] The value: a number, a word, true or false.
        value: Value,
    },
}

const fn lines() -> usize {
    LINES
}

/// Why a verb did not do what it was asked for.
#[derive(Debug)]
pub enum Failure {
    /// Whoever asked wants to know no more: it pressed Ctrl-C, or closed our standard output.
    Unwanted,
    /// The supervisor says no, or cannot be understood.
    Refused(String),
    /// It is not clear which robot is meant.
    Unclear(String),
    /// The robot does not run.
    NotRunning(String),
    /// It took too long.
    TooLong(String),
}

impl Failure {
    /// What a verb exits with.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Unwanted => 0,
            Self::Refused(_) => 1,
            Self::Unclear(_) => 2,
            Self::NotRunning(_) => 3,
            Self::TooLong(_) => 124,
        }
    }
}

/// A node's name as it was typed: ROS 2 has a slash before it.
pub fn node_name(typed: &str) -> Result<String, Infallible> {
    Ok(typed.trim_start_matches('/').to_owned())
}

/// A robot's name as it was typed, where it can be one.
pub fn robot_name(typed: &str) -> crate::Result<String> {
    check_name(typed).map(|()| typed.to_owned())
}

/// The robot that is meant: by its name, or because no other runs.
pub fn find(name: Option<&str>) -> Result<Namespace, Failure> {
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

/// That the robot does not run, and which ones do.
pub fn not_running(namespace: &Namespace) -> Failure {
    let all = Namespace::all_under(&Namespace::runtime_directory());
    let running: Vec<_> =
        all.iter().filter(|other| is_running(other)).map(Namespace::robot).collect();
    let others = match &running[..] {
        [] => String::new(),
        [other] => format!("; '{other}' is"),
        others => format!("; these are: {}", others.join(", ")),
    };
    Failure::NotRunning(format!("robot '{}' is not running{others}", namespace.robot()))
}

/// Whether somebody holds the robot or listens for it.
pub fn is_running(namespace: &Namespace) -> bool {
    UnixStream::connect(socket(namespace)).is_ok() || guardian(namespace).is_some()
}

fn socket(namespace: &Namespace) -> PathBuf {
    namespace.directory().join("control")
}

/// The process that holds the robot, though perhaps no supervisor listens yet, or any more. The
/// lock itself is not tried: that would turn away a guardian that tries it at the same time.
pub fn guardian(namespace: &Namespace) -> Option<u32> {
    let pid: u32 = fs::read_to_string(namespace.lock()).ok()?.trim().parse().ok()?;
    // Another process may have the number by now.
    is_open_in(pid, &namespace.lock()).then_some(pid)
}

/// The robot as it stands, where anybody can tell at this moment.
pub fn look(namespace: &Namespace) -> Option<Value> {
    Connection::attempt(namespace, &Request::Status)?.answer().ok()
}

/// What is heard from a supervisor.
#[derive(Debug, PartialEq, Eq)]
pub enum Heard {
    /// One line of its answer.
    Line(String),
    /// That there is no more.
    End,
    /// Nothing in the time that it had.
    Nothing,
}

/// One request and its answers.
#[derive(Debug)]
pub struct Connection {
    robot: String,
    guardian: Option<u32>,
    stream: UnixStream,
    /// What has come and was not taken yet.
    come: Vec<u8>,
}

impl Connection {
    /// Asks; waits for a supervisor that is about to listen.
    pub fn open(namespace: &Namespace, request: &Request) -> Result<Self, Failure> {
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
                return Err(not_running(namespace));
            };
            if until <= clock::now() {
                return Err(silent(robot, Some(guardian)));
            }
            check_stop()?;
            clock::nap(POLL);
        }
    }

    /// Asks, where somebody listens at this moment; waits for nobody.
    pub fn attempt(namespace: &Namespace, request: &Request) -> Option<Self> {
        let stream = UnixStream::connect(socket(namespace)).ok()?;
        Self::of(namespace, stream, request).ok()
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
    pub fn answer(&mut self) -> Result<Value, Failure> {
        match self.next_in_time()? {
            Some(line) => told(&line),
            None => Err(self.gone()),
        }
    }

    /// The next line of its answer, which is due; nothing where there is no more.
    pub fn next_in_time(&mut self) -> Result<Option<String>, Failure> {
        match self.hear(Some(clock::now().after(PATIENCE)))? {
            Heard::Line(line) => Ok(Some(line)),
            Heard::End => Ok(None),
            Heard::Nothing => Err(silent(&self.robot, self.guardian)),
        }
    }

    /// Waits for the next line; where `until` says nothing, for ever, and where it is over, not at all.
    pub fn hear(&mut self, until: Option<Stamp>) -> Result<Heard, Failure> {
        loop {
            if let Some(end) = self.come.iter().position(|&byte| byte == b'\n') {
                let line: Vec<_> = self.come.drain(..=end).collect();
                return Ok(Heard::Line(String::from_utf8_lossy(&line[..end]).into_owned()));
            }
            check_stop()?;
            let mut bytes = [0; 16 * 1024];
            match self.stream.read(&mut bytes) {
                Ok(0) => return Ok(Heard::End),
                Ok(count) => self.come.extend_from_slice(&bytes[..count]),
                Err(cause) if cause.kind() == ErrorKind::Interrupted => {}
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => {
                    let now = clock::now();
                    if until.is_some_and(|until| until <= now) {
                        return Ok(Heard::Nothing);
                    }
                    wait(Some(&self.stream), until.map(|until| until.since(now)));
                }
                // It was ended while it still had something to read.
                Err(_) => return Ok(Heard::End),
            }
        }
    }

    /// That it has ended without an answer.
    pub fn gone(&self) -> Failure {
        Failure::NotRunning(format!("robot '{}' went away", self.robot))
    }
}

/// Waits until something has come or Ctrl-C was pressed, but no longer than `timeout`.
pub fn wait(stream: Option<&UnixStream>, timeout: Option<Duration>) {
    let mut fds: Vec<_> =
        stream.map(|stream| PollFd::new(stream, PollFlags::IN)).into_iter().collect();
    fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
    let timeout = timeout.and_then(|timeout| Timespec::try_from(timeout).ok());
    // However it ends, the caller looks.
    let _ = rustix::event::poll(&mut fds, timeout.as_ref());
    signal::sleep_again();
}

/// Ctrl-C ends whoever follows; see [`signal::listen`].
pub fn check_stop() -> Result<(), Failure> {
    if 0 < signal::stop_requests() { Err(Failure::Unwanted) } else { Ok(()) }
}

/// What a line says, or why the supervisor says no.
pub fn told(line: &str) -> Result<Value, Failure> {
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

/// Whether the process has this file open.
pub fn is_open_in(pid: u32, path: &Path) -> bool {
    let Ok(file) = fs::metadata(path) else { return false };
    let entries = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    let is_it = |other: &fs::Metadata| (other.dev(), other.ino()) == (file.dev(), file.ino());
    entries.map(|entry| entry.path()).any(|path| fs::metadata(path).is_ok_and(|file| is_it(&file)))
}

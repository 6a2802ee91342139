//! One node of the robot, as the supervisor sees it: where it runs, where it stands, what it says.

use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command};
use std::thread::JoinHandle;

use interfaces::topics::{CHANGE_STATE, STATUS, TRANSITION_EVENT};
use interfaces::{ChangeState, NodeStatus, State, Transition, TransitionEvent};
use node::{Error, Publisher, Result, Session, Settings, Subscriber, clock};
use rustix::process::{Pid, Signal};

/// Where a node's code runs.
#[derive(Debug)]
enum Life {
    /// In a process of its own.
    Process(Child),
    /// In a thread of the supervisor's, until it is joined.
    Thread(Option<JoinHandle<Result>>),
    /// Nowhere any more: how it ended.
    Over(Ended),
}

/// How a node's process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Ended {
    /// [-] Its exit code, if it had one.
    pub(crate) code: Option<i32>,
    /// What happened, for people.
    pub(crate) what: String,
}

/// A change of state that a node has told.
#[derive(Debug, Clone)]
pub(crate) struct Change {
    pub(crate) start: State,
    pub(crate) goal: State,
    pub(crate) reason: String,
}

/// One node of the robot.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) state: State,
    /// The last state in which it could stay.
    rest: State,
    pub(crate) status: Box<NodeStatus>,
    pub(crate) memory_peak_kib: u64,
    /// Why it last changed state without being asked to.
    pub(crate) reason: String,
    life: Life,
    requests: Publisher<ChangeState>,
    events: Subscriber<TransitionEvent>,
    statuses: Subscriber<NodeStatus>,
}

impl Member {
    /// Starts the process called `name` of the launch file.
    pub(crate) fn spawn(
        session: &Session,
        settings: &Settings,
        name: &str,
        arguments: &[String],
    ) -> Result<Self> {
        let mut member = Self::expect(session, name)?;
        member.life = Life::Process(launch(settings, name, arguments)?);
        Ok(member)
    }

    /// Starts `body` as the node called `name` in a thread of this process.
    pub(crate) fn spawn_thread(
        session: &Session,
        settings: &Settings,
        name: &str,
        body: fn(&mut node::Node<'_>) -> Result,
    ) -> Result<Self> {
        let mut member = Self::expect(session, name)?;
        let settings = settings.within(name);
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || node::run_with(&settings, body))
            .map_err(|cause| Error::Fault(format!("cannot start a thread: {cause}")))?;
        member.life = Life::Thread(Some(thread));
        Ok(member)
    }

    /// Opens the node's lifecycle topics before the node itself does, so that nothing is missed.
    fn expect(session: &Session, name: &str) -> Result<Self> {
        Ok(Self {
            name: name.to_owned(),
            state: State::Unknown,
            rest: State::Unknown,
            status: Box::default(),
            memory_peak_kib: 0,
            reason: String::new(),
            life: Life::Thread(None),
            requests: session.publisher_to(&CHANGE_STATE, name)?,
            events: session.subscriber_to(&TRANSITION_EVENT, name)?,
            statuses: session.subscriber_to(&STATUS, name)?,
        })
    }

    /// Asks for a transition.
    pub(crate) fn request(&mut self, transition: Transition) -> Result {
        self.requests.send_with(|request| {
            request.header.stamp = clock::now();
            request.transition = transition as u8;
        })
    }

    /// Takes in what the node has said, and whether it still lives; returns its next change.
    pub(crate) fn poll(&mut self) -> Result<Option<Change>> {
        if let Some(status) = self.statuses.latest()? {
            *self.status = *status;
        }
        if let Some(event) = self.events.receive()? {
            let start = self.rest;
            let goal = State::try_from(event.goal_state).unwrap_or(State::Unknown);
            self.state = goal;
            if goal as u8 <= State::Finalized as u8 {
                self.rest = goal;
            }
            if !event.reason.is_empty() {
                self.reason = event.reason.to_string();
            }
            return Ok(Some(Change { start, goal, reason: event.reason.to_string() }));
        }
        self.reap();
        Ok(None)
    }

    /// How it ended, if it has.
    pub(crate) fn ended(&self) -> Option<&Ended> {
        match &self.life {
            Life::Over(ended) => Some(ended),
            Life::Process(_) | Life::Thread(_) => None,
        }
    }

    /// Notes how much memory its process took at the most, while there is a process to ask.
    pub(crate) fn measure_memory(&mut self) {
        let process = match &self.life {
            Life::Process(child) => child.id(),
            Life::Thread(_) => std::process::id(),
            Life::Over(_) => return,
        };
        let status = std::fs::read_to_string(format!("/proc/{process}/status"));
        let status = status.unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let peak = peak.and_then(|peak| peak.split_whitespace().next()?.parse().ok());
        self.memory_peak_kib = peak.unwrap_or(self.memory_peak_kib);
    }

    /// Ends its process without asking it.
    pub(crate) fn signal(&self, signal: Signal) {
        let Life::Process(child) = &self.life else { return };
        let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid
            && let Err(cause) = rustix::process::kill_process(pid, signal)
        {
            tracing::debug!(%cause, node = self.name, "gone already");
        }
    }

    fn reap(&mut self) {
        let ended = match &mut self.life {
            Life::Process(child) => match child.try_wait() {
                Ok(None) => return,
                Ok(Some(status)) => Ended { code: status.code(), what: describe(status) },
                Err(cause) => Ended { code: None, what: format!("was lost: {cause}") },
            },
            Life::Thread(thread) => {
                if !thread.as_ref().is_some_and(JoinHandle::is_finished) {
                    return;
                }
                match thread.take().map(JoinHandle::join) {
                    Some(Ok(Ok(()))) | None => Ended { code: Some(0), what: "ended".to_owned() },
                    Some(Ok(Err(error))) => Ended { code: Some(1), what: error.to_string() },
                    Some(Err(_)) => Ended { code: Some(101), what: "panicked".to_owned() },
                }
            }
            Life::Over(_) => return,
        };
        self.life = Life::Over(ended);
    }
}

fn launch(settings: &Settings, name: &str, arguments: &[String]) -> Result<Child> {
    let own = std::env::current_exe()
        .map_err(|cause| Error::File { path: "/proc/self/exe".into(), cause })?;
    let exec = settings.launch().process(name).map_or(&[][..], |process| &process.exec);
    let mut command = if let Some((program, rest)) = exec.split_first() {
        let beside = own.with_file_name(program);
        let mut command = Command::new(if beside.exists() { beside } else { program.into() });
        command.args(rest);
        command
    } else {
        let mut command = Command::new(own);
        command.arg(name);
        command
    };
    command
        .args(arguments)
        .env(node::PARENT, std::process::id().to_string())
        // Ctrl-C is not for the nodes: they are stopped in order.
        .process_group(0)
        .spawn()
        .map_err(|cause| {
            let program = command.get_program().display();
            Error::Fault(format!("cannot run {program}: {cause}; is it built, and beside teseo?"))
        })
}

fn describe(status: std::process::ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exited with code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}"),
        (None, None) => "ended".to_owned(),
    }
}

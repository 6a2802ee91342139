//! One node of the robot, as the supervisor sees it: where it runs, where it stands, what it says.

use std::collections::VecDeque;
use std::os::fd::OwnedFd;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ExitStatus, Stdio};
use std::thread::JoinHandle;

use interfaces::topics::{CHANGE_STATE, STATUS, TRANSITION_EVENT};
use interfaces::{ChangeState, NodeStatus, Outcome, Stamp, State, Transition, TransitionEvent};
use node::launch::{Kind, Process};
use node::{Publisher, Result, Session, Subscriber, clock};
use rustix::process::{Pid, PidfdFlags, Signal};

use crate::flow::Flow;
use crate::launcher::Launcher;
use crate::machine::{Exit, Kill, News};

/// One node of the robot.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) status: Box<NodeStatus>,
    pub(crate) flow: Flow,
    pub(crate) memory_peak_kib: u64,
    pub(crate) epoch: u32,
    /// What it last said by `STATUS=`.
    pub(crate) says: String,
    /// [-] How its last process ended, if it had an exit code.
    pub(crate) exit_code: Option<i32>,
    body: Body,
    life: Life,
    /// What is to be told as if it had come from outside.
    news: VecDeque<News>,
    has_finished: bool,
    /// Of a foreign process that has yet to begin.
    output: Option<(Stdio, Stdio)>,
}

/// What speaks for a node.
#[derive(Debug)]
enum Body {
    /// A managed node in a process of its own: its lifecycle topics.
    Managed(Line),
    /// A managed node in a thread of this process.
    Thread(Line, fn(&mut node::Node<'_>) -> Result),
    /// A process that does not know the lifecycle: where the supervisor has it stand.
    Foreign(Kind, State),
}

/// The lifecycle topics of a node, open from before its first life to after its last.
#[derive(Debug)]
struct Line {
    requests: Publisher<ChangeState>,
    events: Subscriber<TransitionEvent>,
    statuses: Subscriber<NodeStatus>,
}

/// Where a node's code runs.
#[derive(Debug)]
enum Life {
    Nowhere,
    Process { child: Child, pidfd: OwnedFd, is_leaving: bool },
    Thread(JoinHandle<Result>),
}

impl Member {
    /// A process of the launch file; its lifecycle topics are opened before it does, so that nothing
    /// is missed.
    pub(crate) fn of_process(session: &Session, process: &Process) -> Result<Self> {
        let body = match process.kind {
            Kind::Lifecycle => Body::Managed(Line::open(session, &process.name)?),
            Kind::Notify | Kind::Simple => Body::Foreign(process.kind, State::Unknown),
        };
        Ok(Self::new(&process.name, body))
    }

    /// A node that runs in a thread of this process.
    pub(crate) fn of_thread(
        session: &Session,
        name: &str,
        code: fn(&mut node::Node<'_>) -> Result,
    ) -> Result<Self> {
        Ok(Self::new(name, Body::Thread(Line::open(session, name)?, code)))
    }

    fn new(name: &str, body: Body) -> Self {
        Self {
            name: name.to_owned(),
            status: Box::default(),
            flow: Flow::default(),
            memory_peak_kib: 0,
            epoch: 0,
            says: String::new(),
            exit_code: None,
            body,
            life: Life::Nowhere,
            news: VecDeque::new(),
            has_finished: false,
            output: None,
        }
    }

    /// Begins life number `epoch`, with `output` for what it writes.
    pub(crate) fn spawn(
        &mut self,
        launcher: &Launcher,
        epoch: u32,
        output: (Stdio, Stdio),
    ) -> std::result::Result<(), String> {
        self.epoch = epoch;
        self.news.clear();
        self.flow = Flow::default();
        self.says.clear();
        *self.status = NodeStatus::default();
        self.has_finished = false;
        match &self.body {
            Body::Managed(_) => {
                self.life = Life::of_process(launcher.start(&self.name, epoch, output)?)?;
            }
            Body::Thread(_, code) => {
                let (settings, code) = (launcher.settings_of_thread(&self.name, epoch), *code);
                let thread = std::thread::Builder::new().name(self.name.clone());
                let thread = thread.spawn(move || node::run_with(&settings, code));
                self.life = Life::Thread(thread.map_err(|cause| format!("no thread: {cause}"))?);
            }
            Body::Foreign(..) => {
                // Its process begins when its turn to be active comes.
                self.output = Some(output);
                self.stand(State::Unconfigured);
            }
        }
        Ok(())
    }

    /// Asks for a transition.
    pub(crate) fn request(&mut self, transition: Transition, launcher: &Launcher) -> Result {
        match &mut self.body {
            Body::Managed(line) | Body::Thread(line, _) => line.request(transition)?,
            Body::Foreign(kind, _) => {
                let kind = *kind;
                self.request_of_foreign(transition, kind, launcher);
            }
        }
        Ok(())
    }

    fn request_of_foreign(&mut self, transition: Transition, kind: Kind, launcher: &Launcher) {
        self.stand(transition.through());
        match transition {
            Transition::Configure | Transition::CleanUp => self.stand(transition.goal()),
            Transition::Activate => {
                let output = self.output.take().unwrap_or_else(|| (Stdio::null(), Stdio::null()));
                let started = launcher.start(&self.name, self.epoch, output);
                match started.and_then(Life::of_process) {
                    Ok(life) => {
                        self.life = life;
                        if kind == Kind::Simple {
                            self.stand(State::Active);
                        }
                    }
                    Err(why) => self.news.push_back(News::NotSpawned { why }),
                }
            }
            Transition::Deactivate | Transition::ShutdownActive => self.leave(),
            Transition::ShutdownUnconfigured | Transition::ShutdownInactive => {
                self.stand(State::Finalized);
                self.news.push_back(News::Exited(Exit { code: Some(0), what: "ended".to_owned() }));
            }
        }
    }

    /// A foreign process is asked to end; how it does is no failure.
    fn leave(&mut self) {
        if let Life::Process { is_leaving, .. } = &mut self.life {
            *is_leaving = true;
        }
        self.signal(Kill::Term);
    }

    /// A foreign process has said `READY=1`.
    pub(crate) fn ready(&mut self) {
        if let Body::Foreign(Kind::Notify, State::Activating) = self.body {
            self.stand(State::Active);
        }
    }

    /// Has a foreign process stand somewhere.
    fn stand(&mut self, state: State) {
        let Body::Foreign(_, stand) = &mut self.body else { return };
        *stand = state;
        self.news.push_back(News::Changed { goal: state, reason: String::new() });
        if state == State::Active {
            // It has no topics of ours.
            self.news.push_back(News::Flows);
        }
    }

    /// Takes in what the node has said, and whether it still lives; returns the next news, in order.
    pub(crate) fn hear(&mut self, now: Stamp) -> Result<Option<News>> {
        if let Some(news) = self.news.pop_front() {
            return Ok(Some(news));
        }
        // Whether it lives is asked first: what it said before its end is then all there.
        let is_over = self.is_over();
        if let Body::Managed(line) | Body::Thread(line, _) = &mut self.body {
            // What is latched may be of a former life.
            while let Some(status) = line.statuses.receive()? {
                if status.header.epoch == self.epoch {
                    *self.status = *status;
                }
            }
            while let Some(event) = line.events.receive()? {
                if event.header.epoch == self.epoch {
                    let goal = State::try_from(event.goal_state).unwrap_or(State::Unknown);
                    return Ok(Some(News::Changed { goal, reason: event.reason.to_string() }));
                }
            }
        }
        if let Some(news) = self.outcome() {
            return Ok(Some(news));
        }
        if is_over {
            return Ok(self.bury());
        }
        Ok(self.flow.turn(&self.status, now))
    }

    /// That it has come to the end of what it was to do, once.
    fn outcome(&mut self) -> Option<News> {
        let outcome = Outcome::try_from(self.status.outcome).unwrap_or(Outcome::Working);
        if outcome == Outcome::Working || std::mem::replace(&mut self.has_finished, true) {
            return None;
        }
        let why = self.status.text.to_string();
        Some(News::Finished { is_success: outcome == Outcome::Done, why })
    }

    /// Where its newest status says that it is.
    pub(crate) fn state(&self) -> State {
        match &self.body {
            Body::Managed(_) | Body::Thread(..) => {
                State::try_from(self.status.state).unwrap_or(State::Unknown)
            }
            Body::Foreign(_, state) => *state,
        }
    }

    /// [-] Its process, while it has one of its own.
    pub(crate) fn pid(&self) -> Option<u32> {
        match &self.life {
            Life::Process { child, .. } => Some(child.id()),
            Life::Nowhere | Life::Thread(_) => None,
        }
    }

    /// Whether its code runs somewhere.
    pub(crate) fn lives(&self) -> bool {
        !matches!(self.life, Life::Nowhere)
    }

    /// Whether `pid` speaks for it.
    pub(crate) fn is(&self, pid: u32) -> bool {
        match &self.life {
            Life::Process { child, .. } => child.id() == pid,
            Life::Thread(_) => std::process::id() == pid,
            Life::Nowhere => false,
        }
    }

    /// Becomes readable when its process ends.
    pub(crate) fn pidfd(&self) -> Option<&OwnedFd> {
        match &self.life {
            Life::Process { pidfd, .. } => Some(pidfd),
            Life::Nowhere | Life::Thread(_) => None,
        }
    }

    /// Notes how much memory its process took at the most, while there is a process to ask.
    pub(crate) fn measure_memory(&mut self) {
        let process = match &self.life {
            Life::Process { child, .. } => child.id(),
            Life::Thread(_) => std::process::id(),
            Life::Nowhere => return,
        };
        let peak = node::process::memory_kib(process, "VmHWM:");
        self.memory_peak_kib = peak.unwrap_or(self.memory_peak_kib);
    }

    /// Sends a signal to the whole process group.
    pub(crate) fn signal(&mut self, signal: Kill) {
        let signal = match signal {
            Kill::Term => Signal::TERM,
            Kill::Kill => Signal::KILL,
        };
        match &self.life {
            Life::Process { child, .. } => signal_group(child, signal),
            // Nothing in the kernel can end a thread alone: it is left behind, and ends with this process.
            Life::Thread(_) => {
                if signal == Signal::KILL {
                    self.life = Life::Nowhere;
                    let exit = Exit { code: None, what: "was left behind".to_owned() };
                    self.news.push_back(News::Exited(exit));
                }
            }
            // A foreign node that has no process yet ends as soon as it is told.
            Life::Nowhere => {
                let exit = Exit { code: None, what: "had not begun".to_owned() };
                self.news.push_back(News::Exited(exit));
            }
        }
    }

    fn is_over(&self) -> bool {
        match &self.life {
            Life::Process { pidfd, .. } => {
                let mut fds = [rustix::event::PollFd::new(pidfd, rustix::event::PollFlags::IN)];
                let timeout = rustix::event::Timespec::default();
                rustix::event::poll(&mut fds, Some(&timeout)).is_ok_and(|ready| 0 < ready)
            }
            Life::Thread(thread) => thread.is_finished(),
            Life::Nowhere => false,
        }
    }

    /// Reaps what has ended, and what it leaves of its process group.
    fn bury(&mut self) -> Option<News> {
        let exit = match std::mem::replace(&mut self.life, Life::Nowhere) {
            Life::Process { mut child, is_leaving, .. } => {
                // Its number is its own until it is reaped, and so is its group's.
                signal_group(&child, Signal::KILL);
                let exit = match child.wait() {
                    Ok(status) => Exit { code: status.code(), what: describe(status) },
                    Err(cause) => Exit { code: None, what: format!("was lost: {cause}") },
                };
                if let Body::Foreign(_, State::Deactivating) = self.body
                    && is_leaving
                {
                    self.stand(State::Inactive);
                    return self.news.pop_front();
                }
                exit
            }
            Life::Thread(thread) => match thread.join() {
                Ok(Ok(())) => Exit { code: Some(0), what: "ended".to_owned() },
                Ok(Err(error)) => {
                    Exit { code: Some(i32::from(error.exit_code())), what: error.to_string() }
                }
                Err(_) => Exit { code: Some(101), what: "panicked".to_owned() },
            },
            Life::Nowhere => return None,
        };
        self.exit_code = exit.code;
        Some(News::Exited(exit))
    }
}

impl Life {
    fn of_process(child: Child) -> std::result::Result<Self, String> {
        let pid = pid_of(&child).ok_or("its process id is none")?;
        // Nobody but this process reaps it, so the number is still its own.
        let pidfd = rustix::process::pidfd_open(pid, PidfdFlags::empty())
            .map_err(|cause| format!("cannot watch it: {cause}"))?;
        Ok(Self::Process { child, pidfd, is_leaving: false })
    }
}

impl Line {
    fn open(session: &Session, name: &str) -> Result<Self> {
        Ok(Self {
            requests: session.publisher_to(&CHANGE_STATE, name)?,
            events: session.subscriber_to(&TRANSITION_EVENT, name)?,
            statuses: session.subscriber_to(&STATUS, name)?,
        })
    }

    fn request(&mut self, transition: Transition) -> Result {
        self.requests.send_with(|request| {
            request.header.stamp = clock::now();
            request.transition = transition as u8;
        })
    }
}

fn pid_of(child: &Child) -> Option<Pid> {
    i32::try_from(child.id()).ok().filter(|&pid| 1 < pid).and_then(Pid::from_raw)
}

fn signal_group(child: &Child, signal: Signal) {
    if let Some(group) = pid_of(child)
        && let Err(cause) = rustix::process::kill_process_group(group, signal)
    {
        tracing::debug!(%cause, "gone already");
    }
}

fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exited with code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}{}", signal_name(signal)),
        (None, None) => "ended".to_owned(),
    }
}

/// What people call the signals that end processes, and what the odd one means here.
fn signal_name(signal: i32) -> &'static str {
    match signal {
        1 => " (SIGHUP)",
        2 => " (SIGINT)",
        4 => " (SIGILL)",
        6 => " (SIGABRT)",
        7 => " (SIGBUS: is shared memory exhausted?)",
        8 => " (SIGFPE)",
        9 => " (SIGKILL)",
        11 => " (SIGSEGV)",
        13 => " (SIGPIPE)",
        15 => " (SIGTERM)",
        _ => "",
    }
}

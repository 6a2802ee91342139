//! The supervision as a pure state machine: events and the time in, actions out. No clock, no
//! process, no shared memory; the shell around it (`supervise.rs`) has those.
//!
//! Nodes are numbered in the order in which they start. All are spawned, configured in order, then
//! activated in order; they stop in reverse. The robot is ready when all are active and their
//! topics carry data.

mod advance;
mod asked;
mod due;
mod failed;
mod heard;
mod life;
#[cfg(test)]
mod tests;

use std::fmt;
use std::time::Duration;

use interfaces::{Stamp, State, Transition};
use node::launch::{Restart, Strategy};

use life::{Life, Phase, Stopping, Want};

/// One node, as the machine has to know it.
#[derive(Debug, Clone)]
pub(crate) struct NodePlan {
    pub(crate) name: String,
    /// Those that have to run while it does; all have smaller numbers.
    pub(crate) requires: Vec<usize>,
    pub(crate) restart: Restart,
    pub(crate) strategy: Strategy,
    pub(crate) backoff: Backoff,
    pub(crate) start_limit: StartLimit,
    /// For the start, for each transition upwards, and for its topics to carry data.
    pub(crate) start_timeout: Duration,
    /// For each transition downwards, and again from SIGTERM to SIGKILL.
    pub(crate) stop_timeout: Duration,
    /// How long its loop may stand still once it is active.
    pub(crate) watchdog: Option<Duration>,
    /// Whether an exit with code 0 that nobody asked for is an end like any other: so of a foreign
    /// program, but not of a node of the loop.
    pub(crate) may_end: bool,
}

/// How long to wait before a restart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Backoff {
    /// Before the second restart in a row; the first comes at once.
    pub(crate) first: Duration,
    /// It grows up to this, geometrically.
    pub(crate) max: Duration,
    /// [-] In so many steps.
    pub(crate) steps: u32,
}

/// How many failures are too many.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StartLimit {
    pub(crate) burst: u32,
    pub(crate) interval: Duration,
}

/// What happens to the machine.
#[derive(Debug, Clone)]
pub(crate) enum Event {
    /// Time has passed.
    Tick,
    /// Somebody asks for something.
    Asked(Ask),
    /// A node has said something in the life called `epoch`, or something has happened to it.
    News { node: usize, epoch: u32, news: News },
}

/// What people ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ask {
    /// The whole robot down, in order.
    Down,
    /// The whole robot down, at once.
    DownNow,
    /// One node, and whoever has to go with it, down and up again. Its failures are forgotten.
    Restart(usize),
    /// One node, and whoever requires it, down, until somebody asks for it again.
    Stop(usize),
    /// One node, and whoever it requires, up again. Its failures are forgotten.
    Start(usize),
}

/// What comes from a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum News {
    /// It has told that it is in another state now; why, where nobody asked for it.
    Changed { goal: State, reason: String },
    /// The answer to [`Action::Query`]: where its newest status says that it is.
    IsIn(State),
    /// Its loop has turned.
    Pinged,
    /// It asks to be treated as if its loop stood still (`WATCHDOG=trigger`).
    Hung,
    /// It asks for so much more time for what it is doing (`EXTEND_TIMEOUT_USEC`).
    NeedsTime(Duration),
    /// All its topics carry data.
    Flows,
    /// This topic carries none any more.
    Stalled { topic: String },
    /// It has reached its end and asks for the end of the run.
    Finished { is_success: bool, why: String },
    /// It could not be started at all.
    NotSpawned { why: String },
    /// Its process is gone, and reaped.
    Exited(Exit),
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Exit {
    /// [-] Its exit code, if it had one.
    pub(crate) code: Option<i32>,
    /// What happened, for people: `exited with code 1`, `was killed by signal 9 (SIGKILL)`.
    pub(crate) what: String,
}

/// What the shell has to do, in this order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Action {
    /// Start the process, in this life.
    Spawn { node: usize, epoch: u32 },
    /// Ask for a transition.
    Request { node: usize, transition: Transition },
    /// Look at its newest status and answer with [`News::IsIn`].
    Query { node: usize },
    /// Send a signal to its process group; the answer is [`News::Exited`].
    Signal { node: usize, signal: Kill },
    /// Tell people, and whoever reads the history.
    Tell(Told),
    /// Everything is down: end with this. Nothing comes after it.
    End(Ending),
}

/// A signal that ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kill {
    /// SIGTERM.
    Term,
    /// SIGKILL.
    Kill,
}

/// What people are told, once each and in the order in which it happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Told {
    /// A node has a process.
    Spawned { node: usize, epoch: u32 },
    /// A node has come from one state to another.
    Changed { node: usize, epoch: u32, start: State, goal: State, reason: String },
    /// A node failed; why, and how long this life had lasted.
    Failed { node: usize, epoch: u32, cause: Cause, age: Duration },
    /// It will be started again after `delay`, for the `count`th time of `burst` within the limit.
    Restarting { node: usize, delay: Duration, count: u32, burst: u32 },
    /// Nodes go down because `because` failed or was asked to stop; in the order in which they do.
    TakingDown { nodes: Vec<usize>, because: usize },
    /// Its data flows again, or stopped flowing.
    Flowing { node: usize },
    /// See [`News::Stalled`].
    Stalled { node: usize, topic: String },
    /// A node was asked to end, and did not: it gets this signal.
    Signalled { node: usize, signal: Kill },
    /// A node ended by itself, as it may.
    Ended { node: usize, what: String },
    /// All nodes that shall run are active, and their topics carry data; how long it took.
    Ready { after: Duration },
    /// The whole robot goes down.
    GoingDown { cause: String },
    /// What was asked for cannot be.
    Refused { ask: Ask, why: String },
}

/// Why a node failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Cause {
    /// Its process ended.
    Exited(Exit),
    /// Its process could not be started.
    NotSpawned(String),
    /// It said so itself, and ended with this code if it did.
    Refused { reason: String, code: Option<i32> },
    /// It was not there in time.
    TooSlow { goal: State, is: State, after: Duration },
    /// Its loop stood still for this long.
    Hung { silence: Duration },
    /// It is active, and this topic carries no data.
    NoData { after: Duration },
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Ending {
    /// A node said that it was done.
    Done(String),
    /// A node said that it had failed.
    Failed(String),
    /// Somebody asked for it.
    Asked,
    /// A node did not come up.
    NotStarted { node: usize, cause: Cause },
    /// A node failed, and was not, or not any more, started again.
    GaveUp { node: usize, cause: Cause, failures: u32 },
}

/// The machine: all nodes, and where the robot as a whole stands.
#[derive(Debug)]
pub(crate) struct Machine {
    plans: Vec<NodePlan>,
    lives: Vec<Life>,
    readiness: Readiness,
    /// Since when all nodes have been active, so that data can flow all the way round.
    all_active_since: Option<Stamp>,
    /// Until when a node that is active has asked everybody to wait for its data.
    data_awaited_until: Stamp,
    /// Set once the robot goes down: why.
    ending: Option<Ending>,
    is_over: bool,
    had_to_kill: bool,
    actions: Vec<Action>,
}

/// Whether all nodes are active and their topics carry data.
#[derive(Debug, Clone, Copy)]
struct Readiness {
    is_ready: bool,
    was_ready: bool,
    /// Of being so or not.
    since: Stamp,
}

/// One node, for whoever looks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Which life it is in, from 1; 0 before the first.
    pub(crate) epoch: u32,
    pub(crate) state: State,
    /// When this life began.
    pub(crate) since: Stamp,
    /// [-] How often it was started again.
    pub(crate) restarts: u32,
    pub(crate) doing: Doing,
}

/// What a node is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Doing {
    /// On its way up.
    Starting,
    /// What it was started for.
    Running,
    /// Nothing: it is active, but its topics carry no data.
    Stalled,
    /// On its way down.
    Stopping,
    /// Down until somebody asks for it.
    Stopped,
    /// Down until this moment.
    Waiting { until: Stamp },
    /// Down by itself, as it may be.
    Ended,
}

impl Doing {
    /// For people.
    pub(crate) fn describe(self, now: Stamp) -> String {
        match self {
            Self::Starting => "starting".to_owned(),
            Self::Running => "running".to_owned(),
            Self::Stalled => "no data".to_owned(),
            Self::Stopping => "stopping".to_owned(),
            Self::Stopped => "stopped".to_owned(),
            Self::Waiting { until } => {
                format!("starts again in {:.1} s", until.since(now).as_secs_f64())
            }
            Self::Ended => "ended".to_owned(),
        }
    }
}

impl Machine {
    pub(crate) fn new(plans: Vec<NodePlan>, now: Stamp) -> Self {
        Self {
            lives: plans.iter().map(|_| Life::new(now)).collect(),
            plans,
            readiness: Readiness { is_ready: false, was_ready: false, since: now },
            all_active_since: None,
            data_awaited_until: Stamp::ZERO,
            ending: None,
            is_over: false,
            had_to_kill: false,
            actions: Vec::new(),
        }
    }

    /// Begins: all nodes are wanted.
    pub(crate) fn start(&mut self, now: Stamp) -> Vec<Action> {
        self.advance(now);
        std::mem::take(&mut self.actions)
    }

    /// Takes in what has happened; returns what is to be done about it.
    pub(crate) fn step(&mut self, event: Event, now: Stamp) -> Vec<Action> {
        if self.is_over {
            return Vec::new();
        }
        match event {
            Event::Tick => self.check_deadlines(now),
            Event::Asked(ask) => self.obey(ask, now),
            Event::News { node, epoch, news } => {
                // What a former life says is no news.
                if self.lives[node].epoch == epoch {
                    self.hear(node, news, now);
                }
            }
        }
        self.advance(now);
        std::mem::take(&mut self.actions)
    }

    /// When the next [`Event::Tick`] is due.
    pub(crate) fn next_deadline(&self) -> Option<Stamp> {
        (0..self.lives.len()).filter_map(|node| self.deadline(node)).min()
    }

    pub(crate) fn node(&self, node: usize) -> View {
        let life = &self.lives[node];
        // However its life ended, it is over; before the first nobody knows anything.
        let is_over = 0 < life.epoch && !life.has_process();
        View {
            epoch: life.epoch,
            state: if is_over { State::Finalized } else { life.state },
            since: life.since,
            restarts: life.restarts,
            doing: self.doing(node),
        }
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.readiness.is_ready
    }

    pub(crate) fn is_ending(&self) -> bool {
        self.ending.is_some()
    }

    /// Whether a node did not end when it was asked to while the robot went down.
    pub(crate) fn had_to_kill(&self) -> bool {
        self.had_to_kill
    }

    fn doing(&self, node: usize) -> Doing {
        let life = &self.lives[node];
        match life.phase {
            Phase::Down => match life.want {
                Want::Down => Doing::Stopped,
                Want::Up | Want::Again => Doing::Waiting { until: life.not_before },
            },
            Phase::Starting(_)
            | Phase::Unconfigured
            | Phase::Configuring(_)
            | Phase::Inactive
            | Phase::Activating(_) => match life.want {
                Want::Up => Doing::Starting,
                Want::Down | Want::Again => Doing::Stopping,
            },
            Phase::Active if life.want != Want::Up => Doing::Stopping,
            Phase::Active if life.flows => Doing::Running,
            Phase::Active => Doing::Stalled,
            Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_) => Doing::Stopping,
            Phase::Ended => Doing::Ended,
            Phase::Lost => Doing::Stopped,
        }
    }

    /// The moment at which something is due for this node.
    fn deadline(&self, node: usize) -> Option<Stamp> {
        let (plan, life) = (&self.plans[node], &self.lives[node]);
        match life.phase {
            Phase::Down => (life.want == Want::Up).then_some(life.not_before),
            Phase::Starting(deadline)
            | Phase::Configuring(deadline)
            | Phase::Activating(deadline)
            | Phase::Deactivating(deadline)
            | Phase::Failing(deadline) => Some(deadline.until),
            Phase::ShuttingDown(stopping) | Phase::Dying(stopping) => Some(stopping.until),
            Phase::Active => {
                let watchdog = plan.watchdog.map(|limit| life.pinged.after(limit));
                [watchdog, self.data_deadline(node)].into_iter().flatten().min()
            }
            Phase::Unconfigured | Phase::Inactive | Phase::Ended | Phase::Lost => None,
        }
    }

    /// Until when the topics of an active node have to carry data for the first time: counted from
    /// where all are active, since what it sends may need what the others send, and extended for all
    /// by any of them that asks for it.
    fn data_deadline(&self, node: usize) -> Option<Stamp> {
        let life = &self.lives[node];
        let is_due = life.phase == Phase::Active && life.want == Want::Up && !life.has_flowed;
        let since = self.all_active_since.filter(|_| is_due)?;
        Some(since.after(self.plans[node].start_timeout).max(self.data_awaited_until))
    }

    /// SIGTERM, and SIGKILL after the time-out.
    fn terminate(&mut self, node: usize, now: Stamp) {
        let until = now.after(self.plans[node].stop_timeout);
        let stopping = Stopping { until, told: Some(Kill::Term) };
        self.lives[node].phase = Phase::ShuttingDown(stopping);
        self.act(Action::Signal { node, signal: Kill::Term });
    }

    /// SIGKILL: nothing that it sends from now on can reach the next life.
    fn kill(&mut self, node: usize, now: Stamp) {
        let until = now.after(KILL_TIMEOUT);
        self.lives[node].phase = Phase::Dying(Stopping { until, told: Some(Kill::Kill) });
        self.act(Action::Signal { node, signal: Kill::Kill });
    }

    /// It has not ended in time.
    fn insist(&mut self, node: usize, stopping: Stopping, now: Stamp) {
        match stopping.told {
            None => {
                self.tell(Told::Signalled { node, signal: Kill::Term });
                self.terminate(node, now);
            }
            Some(Kill::Term) => {
                self.had_to_kill |= self.ending.is_some();
                self.tell(Told::Signalled { node, signal: Kill::Kill });
                self.kill(node, now);
            }
            Some(Kill::Kill) => {
                // In the kernel, or a thread: it cannot be started beside itself.
                self.lives[node].phase = Phase::Lost;
                self.had_to_kill = true;
                let what = "could not be killed".to_owned();
                let cause = Cause::Exited(Exit { code: None, what });
                let text = format!("{} {cause}", self.plans[node].name);
                self.go_down(Ending::GaveUp { node, cause, failures: 1 }, &text, now);
            }
        }
    }

    fn tell(&mut self, told: Told) {
        self.actions.push(Action::Tell(told));
    }

    fn act(&mut self, action: Action) {
        self.actions.push(action);
    }
}

/// The shell answers from what it knows already.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(100);

/// A process that was killed is gone sooner, unless it waits for a device.
const KILL_TIMEOUT: Duration = Duration::from_secs(5);

/// How far a node is, measured against another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rank {
    Behind,
    There,
    Beyond,
}

/// Exit codes that say that another start would end like this one: a wrong configuration
/// (sysexits.h), and s6's permanent failure.
const PERMANENT: [i32; 2] = [78, 125];

impl Cause {
    fn code(&self) -> Option<i32> {
        match self {
            Self::Exited(exit) => exit.code,
            Self::Refused { code, .. } => *code,
            Self::NotSpawned(_)
            | Self::TooSlow { .. }
            | Self::Hung { .. }
            | Self::NoData { .. } => None,
        }
    }

    /// Whether nothing is left to be killed.
    fn is_process_gone(&self) -> bool {
        match self {
            Self::Exited(_) | Self::NotSpawned(_) => true,
            Self::Refused { code, .. } => code.is_some(),
            Self::TooSlow { .. } | Self::Hung { .. } | Self::NoData { .. } => false,
        }
    }

    /// Whether it tells of a node that had come up.
    fn is_of_running(&self) -> bool {
        match self {
            Self::Exited(_) | Self::Refused { .. } | Self::Hung { .. } => true,
            Self::NotSpawned(_) | Self::TooSlow { .. } | Self::NoData { .. } => false,
        }
    }

    fn may_restart(&self, restart: Restart) -> bool {
        let is_permanent = self.code().is_some_and(|code| PERMANENT.contains(&code));
        match restart {
            Restart::Never => false,
            Restart::OnFailure => !is_permanent && self.code() != Some(0),
            Restart::Always => !is_permanent,
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exited(exit) => formatter.write_str(&exit.what),
            Self::NotSpawned(why) => formatter.write_str(why),
            Self::Refused { reason, .. } => formatter.write_str(reason),
            Self::TooSlow { goal, is, after } => {
                write!(formatter, "was not {goal} within {after:?}: it is still {is}")
            }
            Self::Hung { silence } => {
                write!(formatter, "hung: its loop stood still for {} ms", silence.as_millis())
            }
            Self::NoData { after } => {
                write!(formatter, "is active, but its topics carried no data for {after:?}")
            }
        }
    }
}

//! The supervision as a pure state machine: events and the time in, actions out. No clock, no
//! process, no shared memory; the shell around it (`supervise.rs`) has those.
//!
//! Nodes are numbered in the order in which they start. All are spawned, configured in order, then
//! activated in order; they stop in reverse. The robot is ready when all are active and their
//! topics carry data.

mod life;
#[cfg(test)]
mod tests;

use std::fmt;
use std::time::Duration;

use interfaces::{Stamp, State, Transition};
use node::launch::{Restart, Strategy};

use life::{Deadline, Life, Phase, Stopping, Want};

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
        View {
            epoch: life.epoch,
            state: life.state,
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
    /// where all are active, since what it sends may need what the others send.
    fn data_deadline(&self, node: usize) -> Option<Stamp> {
        let life = &self.lives[node];
        let is_due = life.phase == Phase::Active && life.want == Want::Up && !life.has_flowed;
        let since = self.all_active_since.filter(|_| is_due)?;
        Some(since.after(self.plans[node].start_timeout))
    }

    // ---- What people ask for.

    fn obey(&mut self, ask: Ask, now: Stamp) {
        if self.ending.is_some() && ask != Ask::DownNow {
            if ask != Ask::Down {
                let why = "the robot goes down".to_owned();
                self.tell(Told::Refused { ask, why });
            }
            return;
        }
        match ask {
            Ask::Down => self.go_down(Ending::Asked, "somebody asked for it", now),
            Ask::DownNow => {
                self.go_down(Ending::Asked, "somebody insisted on it", now);
                for node in 0..self.lives.len() {
                    if self.lives[node].has_process() {
                        self.had_to_kill = true;
                        self.kill(node, now);
                    }
                }
            }
            Ask::Restart(node) => {
                self.lives[node].forget_failures(now);
                if self.lives[node].want == Want::Down || !self.lives[node].has_process() {
                    self.want_up(node, now);
                } else {
                    self.lives[node].want = Want::Again;
                    self.lives[node].because = None;
                    self.take_down_with(node);
                    self.lives[node].restarts += 1;
                }
            }
            Ask::Stop(node) => {
                let nodes: Vec<_> = self.requirers(node).into_iter().chain([node]).collect();
                for &node in &nodes {
                    self.lives[node].want = Want::Down;
                }
                self.tell_taking_down(nodes, node);
            }
            Ask::Start(node) => self.want_up(node, now),
        }
    }

    /// Has the node come up, and what it requires.
    fn want_up(&mut self, node: usize, now: Stamp) {
        for required in self.plans[node].requires.clone() {
            self.want_up(required, now);
        }
        let life = &mut self.lives[node];
        life.forget_failures(now);
        if matches!(life.phase, Phase::Ended | Phase::Lost) {
            life.phase = Phase::Down;
        }
        // One on its way down goes all the way first.
        let is_leaving = life.want != Want::Up && life.has_process();
        life.want = if is_leaving { Want::Again } else { Want::Up };
    }

    // ---- What nodes say: one match for each phase.

    fn hear(&mut self, node: usize, news: News, now: Stamp) {
        let news = match news {
            News::Changed { goal, reason } => {
                self.note_change(node, goal, reason.clone());
                News::Changed { goal, reason }
            }
            News::Pinged => return self.lives[node].pinged = now,
            News::NeedsTime(more) => return self.lives[node].phase.extend(now, more),
            News::Finished { is_success, why } => return self.finish(is_success, why, now),
            News::IsIn(_)
            | News::Hung
            | News::Flows
            | News::Stalled { .. }
            | News::NotSpawned { .. }
            | News::Exited(_) => news,
        };
        match self.lives[node].phase {
            Phase::Starting(deadline) => {
                self.hear_on_the_way(node, deadline, State::Unconfigured, news, now);
            }
            Phase::Configuring(deadline) | Phase::Deactivating(deadline) => {
                self.hear_on_the_way(node, deadline, State::Inactive, news, now);
            }
            Phase::Activating(deadline) => {
                self.hear_on_the_way(node, deadline, State::Active, news, now);
            }
            Phase::Unconfigured | Phase::Inactive => self.hear_at_rest(node, news, now),
            Phase::Active => self.hear_active(node, news, now),
            Phase::Failing(_) | Phase::ShuttingDown(_) | Phase::Dying(_) => {
                self.hear_leaving(node, news, now);
            }
            // Its process is gone; whatever it said before is history.
            Phase::Down | Phase::Ended | Phase::Lost => {}
        }
    }

    /// In a transition, to `goal`.
    fn hear_on_the_way(
        &mut self,
        node: usize,
        deadline: Deadline,
        goal: State,
        news: News,
        now: Stamp,
    ) {
        match news {
            News::Changed { goal: is, .. } | News::IsIn(is) if is == goal => {
                self.arrive(node, goal, now);
            }
            News::Changed { reason, .. } if !reason.is_empty() => self.expect_end(node, now),
            News::IsIn(is) if deadline.is_asked => {
                let after = deadline.limit;
                self.be_too_slow(node, Cause::TooSlow { goal, is, after }, now);
            }
            News::Flows => self.lives[node].flow(),
            News::Hung => self.fail(node, Cause::Hung { silence: Duration::ZERO }, now),
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            // The states on the way, and what does not matter there.
            News::Changed { .. } | News::IsIn(_) | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    /// Unconfigured or inactive, until its turn comes.
    fn hear_at_rest(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Changed { reason, .. } if !reason.is_empty() => self.expect_end(node, now),
            News::Hung => self.fail(node, Cause::Hung { silence: Duration::ZERO }, now),
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            News::Changed { .. } | News::IsIn(_) | News::Flows | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    fn hear_active(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Flows => {
                if self.lives[node].has_flowed && !self.lives[node].flows {
                    self.tell(Told::Flowing { node });
                }
                self.lives[node].flow();
            }
            News::Stalled { topic } => {
                self.lives[node].flows = false;
                self.tell(Told::Stalled { node, topic });
            }
            // It goes by itself: where it comes from its supervisor it is in another phase.
            News::Changed { goal, .. } if goal != State::Active => self.expect_end(node, now),
            News::Hung => {
                let silence = now.since(self.lives[node].pinged);
                self.fail(node, Cause::Hung { silence }, now);
            }
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            News::Changed { .. } | News::IsIn(_) => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    /// On its way out: only its end matters.
    fn hear_leaving(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Exited(exit) => self.see_off(node, exit, now),
            // It was told to go before it had come, and may not have noticed: no signal reaches a
            // thread.
            News::Changed { goal: State::Unconfigured, reason }
                if reason.is_empty() && self.lives[node].phase.was_told(Kill::Term) =>
            {
                self.lives[node].phase = Phase::Unconfigured;
            }
            News::NotSpawned { .. }
            | News::Changed { .. }
            | News::IsIn(_)
            | News::Hung
            | News::Flows
            | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    fn note_change(&mut self, node: usize, goal: State, reason: String) {
        let life = &mut self.lives[node];
        let mut start = std::mem::replace(&mut life.state, goal);
        if goal.is_primary() {
            // People think from rest to rest: what lies between is told for itself.
            start = std::mem::replace(&mut life.rest, goal);
        }
        if !reason.is_empty() {
            life.reason.get_or_insert_with(|| reason.clone());
        }
        let epoch = life.epoch;
        if start != goal || !reason.is_empty() {
            self.tell(Told::Changed { node, epoch, start, goal, reason });
        }
    }

    fn arrive(&mut self, node: usize, state: State, now: Stamp) {
        let life = &mut self.lives[node];
        // It may have answered before it told.
        life.state = state;
        life.phase = match life.phase {
            Phase::Starting(_) => Phase::Unconfigured,
            Phase::Configuring(_) | Phase::Deactivating(_) => Phase::Inactive,
            Phase::Activating(_) => {
                life.pinged = now;
                life.active_since = now;
                Phase::Active
            }
            other => other,
        };
    }

    /// It has said why it cannot go on; its exit code says more.
    fn expect_end(&mut self, node: usize, now: Stamp) {
        let deadline = Deadline::new(now, self.plans[node].stop_timeout);
        self.lives[node].phase = Phase::Failing(deadline);
    }

    fn finish(&mut self, is_success: bool, why: String, now: Stamp) {
        if self.ending.is_none() {
            let cause = why.clone();
            let ending = if is_success { Ending::Done(why) } else { Ending::Failed(why) };
            self.go_down(ending, &cause, now);
        }
    }

    // ---- Failures.

    /// Its process is gone.
    fn see_off(&mut self, node: usize, exit: Exit, now: Stamp) {
        let life = &mut self.lives[node];
        life.state = State::Unknown;
        let was_asked = matches!(life.phase, Phase::ShuttingDown(_) | Phase::Dying(_));
        match life.want {
            Want::Up if was_asked => life.phase = Phase::Down,
            Want::Up => {
                let is_end = exit.code == Some(0) && self.may_end(node);
                if is_end {
                    self.lives[node].phase = Phase::Ended;
                    self.tell(Told::Ended { node, what: exit.what });
                } else {
                    self.fail(node, self.cause_of(node, exit), now);
                }
            }
            Want::Down | Want::Again => {
                life.phase = Phase::Down;
                if life.want == Want::Again {
                    life.want = Want::Up;
                }
                if !was_asked {
                    let (epoch, age) = (life.epoch, now.since(life.since));
                    let cause = self.cause_of(node, exit);
                    self.tell(Told::Failed { node, epoch, cause, age });
                }
            }
        }
    }

    fn may_end(&self, node: usize) -> bool {
        let plan = &self.plans[node];
        plan.may_end && plan.restart != Restart::Always && self.requirers(node).is_empty()
    }

    /// What it said before its end explains more than how it ended.
    fn cause_of(&self, node: usize, exit: Exit) -> Cause {
        match self.lives[node].reason.clone() {
            Some(reason) if exit.code.is_some() => Cause::Refused { reason, code: exit.code },
            Some(_) | None => Cause::Exited(exit),
        }
    }

    /// A transition was not done in time, and it has been asked.
    fn be_too_slow(&mut self, node: usize, cause: Cause, now: Stamp) {
        if self.lives[node].want == Want::Up {
            self.fail(node, cause, now);
        } else {
            self.terminate(node, now);
        }
    }

    /// A node that is wanted cannot go on: fenced, told, and started again if it may be.
    fn fail(&mut self, node: usize, cause: Cause, now: Stamp) {
        let (plan, life) = (&self.plans[node], &mut self.lives[node]);
        let (epoch, age) = (life.epoch, now.since(life.since));
        let was_up = life.phase == Phase::Active && cause.is_of_running();
        life.note_failure(plan, now);
        let failures = life.failures.len();
        let is_over = cause.is_process_gone();
        self.tell(Told::Failed { node, epoch, cause: cause.clone(), age });
        if is_over {
            self.lives[node].phase = Phase::Down;
            self.lives[node].state = State::Unknown;
        } else {
            self.kill(node, now);
        }
        if self.ending.is_some() {
            return;
        }

        let plan = &self.plans[node];
        if !cause.may_restart(plan.restart) || plan.start_limit.burst as usize <= failures {
            let text = format!("{} {cause}", plan.name);
            let failures = u32::try_from(failures).unwrap_or(u32::MAX);
            let ending = if was_up || self.readiness.was_ready {
                Ending::GaveUp { node, cause, failures }
            } else {
                Ending::NotStarted { node, cause }
            };
            return self.go_down(ending, &text, now);
        }

        let delay = self.lives[node].delay(plan, now);
        let (count, burst) = (u32::try_from(failures).unwrap_or(u32::MAX), plan.start_limit.burst);
        let life = &mut self.lives[node];
        life.not_before = now.after(delay);
        life.restarts += 1;
        life.because = None;
        self.tell(Told::Restarting { node, delay, count, burst });
        self.take_down_with(node);
    }

    /// Takes down whoever is started again with `node`.
    fn take_down_with(&mut self, node: usize) {
        let with = match self.plans[node].strategy {
            Strategy::OneForOne => self.requirers(node),
            Strategy::RestForOne => ((node + 1)..self.lives.len()).rev().collect(),
            Strategy::All => (0..self.lives.len()).rev().filter(|&other| other != node).collect(),
        };
        let with: Vec<_> =
            with.into_iter().filter(|&other| self.lives[other].goes_with_others()).collect();
        for &other in &with {
            let life = &mut self.lives[other];
            if node < other {
                life.because = Some(node);
            }
            if life.has_process() {
                life.want = Want::Again;
            }
        }
        if !with.is_empty() {
            self.tell_taking_down(with, node);
        }
    }

    /// Those that do not run without `node`, by their own word or another's; the last first.
    fn requirers(&self, node: usize) -> Vec<usize> {
        let mut with = vec![node];
        for other in (node + 1)..self.plans.len() {
            if self.plans[other].requires.iter().any(|required| with.contains(required)) {
                with.push(other);
            }
        }
        with.remove(0);
        with.reverse();
        with
    }

    fn tell_taking_down(&mut self, nodes: Vec<usize>, because: usize) {
        self.tell(Told::TakingDown { nodes, because });
    }

    fn go_down(&mut self, ending: Ending, cause: &str, now: Stamp) {
        if self.ending.is_none() {
            self.ending = Some(ending);
            self.tell(Told::GoingDown { cause: cause.to_owned() });
        }
        for (plan, life) in self.plans.iter().zip(&mut self.lives) {
            life.want = Want::Down;
            // Nobody waits for a start as long as a start may take.
            life.phase.shorten(now, plan.stop_timeout);
        }
    }

    // ---- What is due.

    fn check_deadlines(&mut self, now: Stamp) {
        for node in 0..self.lives.len() {
            if self.deadline(node).is_some_and(|due| due <= now) {
                self.be_due(node, now);
            }
        }
    }

    fn be_due(&mut self, node: usize, now: Stamp) {
        let life = &mut self.lives[node];
        match life.phase {
            Phase::Starting(deadline)
            | Phase::Configuring(deadline)
            | Phase::Activating(deadline)
            | Phase::Deactivating(deadline) => {
                if deadline.is_asked {
                    // It was asked, and nobody answered.
                    let (goal, is) = (life.phase.goal(), life.state);
                    let after = deadline.limit;
                    self.be_too_slow(node, Cause::TooSlow { goal, is, after }, now);
                } else {
                    life.phase.ask(now.after(ANSWER_TIMEOUT));
                    self.act(Action::Query { node });
                }
            }
            Phase::Active => self.be_due_active(node, now),
            Phase::Failing(_) => self.give_reason_up(node, now),
            Phase::ShuttingDown(stopping) | Phase::Dying(stopping) => {
                self.insist(node, stopping, now);
            }
            // Its turn may have come, which `advance` knows.
            Phase::Down | Phase::Unconfigured | Phase::Inactive | Phase::Ended | Phase::Lost => {}
        }
    }

    fn be_due_active(&mut self, node: usize, now: Stamp) {
        if self.lives[node].want != Want::Up {
            // It waits for its turn to go, and its watchdog with it.
            self.lives[node].pinged = now;
            return;
        }
        let silence = now.since(self.lives[node].pinged);
        let is_hung = self.plans[node].watchdog.is_some_and(|limit| limit <= silence);
        let cause = if is_hung {
            Cause::Hung { silence }
        } else {
            Cause::NoData { after: self.plans[node].start_timeout }
        };
        self.fail(node, cause, now);
    }

    /// It said why it would end, and did not.
    fn give_reason_up(&mut self, node: usize, now: Stamp) {
        let reason = self.lives[node].reason.clone().unwrap_or_default();
        if self.lives[node].want == Want::Up {
            self.fail(node, Cause::Refused { reason, code: None }, now);
        } else {
            self.terminate(node, now);
        }
    }

    // ---- Everybody's next step.

    /// Whatever may happen next happens, in order upwards and in reverse downwards.
    fn advance(&mut self, now: Stamp) {
        for node in (0..self.lives.len()).rev() {
            self.advance_down(node, now);
        }
        for node in 0..self.lives.len() {
            self.advance_up(node, now);
        }
        self.see_whether_all_are_active(now);
        self.see_whether_ready(now);
        if let Some(ending) = &self.ending
            && self.lives.iter().all(|life| !life.has_process())
        {
            let ending = ending.clone();
            self.is_over = true;
            self.act(Action::End(ending));
        }
    }

    fn advance_up(&mut self, node: usize, now: Stamp) {
        if self.lives[node].want != Want::Up {
            return;
        }
        let deadline = Deadline::new(now, self.plans[node].start_timeout);
        match self.lives[node].phase {
            Phase::Down if self.may_spawn(node, now) => {
                let life = &mut self.lives[node];
                life.begin(now, Phase::Starting(deadline));
                let epoch = life.epoch;
                self.tell(Told::Spawned { node, epoch });
                self.act(Action::Spawn { node, epoch });
            }
            Phase::Unconfigured if self.may_follow(node, Phase::rank_unconfigured, now) => {
                self.lives[node].phase = Phase::Configuring(deadline);
                self.act(Action::Request { node, transition: Transition::Configure });
            }
            Phase::Inactive if self.may_follow(node, Phase::rank_inactive, now) => {
                self.lives[node].phase = Phase::Activating(deadline);
                self.act(Action::Request { node, transition: Transition::Activate });
            }
            Phase::Down
            | Phase::Unconfigured
            | Phase::Inactive
            | Phase::Starting(_)
            | Phase::Configuring(_)
            | Phase::Activating(_)
            | Phase::Active
            | Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_)
            | Phase::Ended
            | Phase::Lost => {}
        }
    }

    /// Not before its time, not before whoever took it down or is required, and not while others are on their way
    /// down, who may be of its kind.
    fn may_spawn(&self, node: usize, now: Stamp) -> bool {
        let life = &self.lives[node];
        let is_pending = |because: usize| {
            self.lives[because].want == Want::Up && !self.lives[because].is_there()
        };
        life.not_before <= now
            && life.because.is_none_or(|because| !is_pending(because))
            && self.lives.iter().all(|other| other.want == Want::Up || !other.has_process())
            && self.plans[node].requires.iter().all(|&other| self.lives[other].is_there())
    }

    /// Whether all that are on their way up have come as far as it has, and those before it further.
    fn may_follow(&self, node: usize, is_there: fn(Phase) -> Rank, now: Stamp) -> bool {
        (0..self.lives.len()).all(|other| {
            let life = &self.lives[other];
            // One that waits for its next life, or is not wanted, holds nobody up.
            let is_absent = life.want == Want::Down || !life.has_process() && now < life.not_before;
            is_absent
                || match is_there(life.phase) {
                    Rank::Behind => false,
                    Rank::There => node <= other,
                    Rank::Beyond => true,
                }
        })
    }

    fn advance_down(&mut self, node: usize, now: Stamp) {
        let life = &self.lives[node];
        if life.want == Want::Up {
            return;
        }
        let stop_timeout = self.plans[node].stop_timeout;
        let deadline = Deadline::new(now, stop_timeout);
        match life.phase {
            // Nothing has begun that would have to be ended in order.
            Phase::Starting(_) => self.terminate(node, now),
            // A foreign process that does not become ready is told to go.
            Phase::Activating(_) if self.plans[node].may_end => self.terminate(node, now),
            Phase::Active if self.all_later_are_paused(node) => {
                self.lives[node].phase = Phase::Deactivating(deadline);
                self.act(Action::Request { node, transition: Transition::Deactivate });
            }
            Phase::Inactive | Phase::Unconfigured if self.all_later_are_gone(node) => {
                let shutdown = match life.phase {
                    Phase::Inactive => Transition::ShutdownInactive,
                    _ => Transition::ShutdownUnconfigured,
                };
                let stopping = Stopping { until: deadline.until, told: None };
                self.lives[node].phase = Phase::ShuttingDown(stopping);
                self.act(Action::Request { node, transition: shutdown });
            }
            Phase::Down if life.want == Want::Again => self.lives[node].want = Want::Up,
            Phase::Down
            | Phase::Active
            | Phase::Inactive
            | Phase::Unconfigured
            | Phase::Configuring(_)
            | Phase::Activating(_)
            | Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_)
            | Phase::Ended
            | Phase::Lost => {}
        }
    }

    fn leaving(&self) -> impl Iterator<Item = (usize, &Life)> {
        let lives = self.lives.iter().enumerate();
        lives.filter(|(_, life)| life.want != Want::Up && life.has_process())
    }

    fn all_later_are_paused(&self, node: usize) -> bool {
        self.leaving().all(|(other, life)| other <= node || life.phase.is_paused())
    }

    /// And all are paused, the earlier too: nobody ends while another is still at work.
    fn all_later_are_gone(&self, node: usize) -> bool {
        self.leaving().all(|(other, life)| other <= node && life.phase.is_paused())
    }

    fn see_whether_all_are_active(&mut self, now: Stamp) {
        let is_active = |life: &Life| {
            life.want == Want::Up && matches!(life.phase, Phase::Active | Phase::Ended)
        };
        if !self.lives.iter().all(is_active) {
            self.all_active_since = None;
        } else if self.all_active_since.is_none() {
            self.all_active_since = Some(now);
        }
    }

    fn see_whether_ready(&mut self, now: Stamp) {
        let is_ready = self.ending.is_none() && self.lives.iter().all(Life::is_ready);
        if is_ready == self.readiness.is_ready {
            return;
        }
        let after = now.since(self.readiness.since);
        self.readiness.is_ready = is_ready;
        self.readiness.since = now;
        if is_ready {
            self.readiness.was_ready = true;
            self.tell(Told::Ready { after });
        }
    }

    // ---- Ends.

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

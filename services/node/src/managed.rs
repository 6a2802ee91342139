//! A managed node: its own code runs only while it is active.

mod ports;
mod rhythm;
mod telling;

use std::os::fd::AsFd;
use std::time::Duration;

use interfaces::topics::{CHANGE_STATE, STATUS, TRANSITION_EVENT};
use interfaces::{
    ChangeState, Message, NodeStatus, Outcome, Scope, Stamp, State, Text, Topic, Transition,
    TransitionEvent,
};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use rustix::process::{Pid, getppid};

use crate::arguments;
use crate::config;
use crate::config::Listable;
use crate::diary::{Diary, Records};
use crate::faults::FaultyLink;
use crate::figures::Figures;
use crate::wake::Waiter;
use crate::{
    Clock, Error, Gauge, Latency, Publisher, Result, Session, Settings, Subscriber, Tunable,
    Tuning, clock, memory, signal, trace,
};
use ports::{Ports, Promise};
use rhythm::Rhythm;
use telling::Telling;

/// However long nothing happens, every wait ends: a lost wake-up costs no more than this.
const WAIT_MAX: Duration = Duration::from_millis(50);

/// While active, a node says this often how it is.
const STATUS_PERIOD: Duration = Duration::from_millis(100);

/// How long a node may finish what it has begun before it is deactivated all the same.
const HOLD_MAX: Duration = Duration::from_secs(1);

/// One turn of a node's loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tick {
    /// [ns] Now, on `CLOCK_MONOTONIC`, whatever time the robot lives in.
    pub now: Stamp,
    /// Whether this is the first turn since the node was activated.
    pub activated: bool,
    /// Whether a period of [`Node::set_period`] has passed.
    pub due: bool,
}

/// What a node's own code is given.
#[derive(Debug)]
pub struct Node<'a> {
    settings: &'a Settings,
    session: &'a Session,
    waiter: &'a Waiter<'a>,
    requests: Subscriber<ChangeState>,
    events: Publisher<TransitionEvent>,
    status: Publisher<NodeStatus>,
    status_due: Stamp,
    report: Box<NodeStatus>,
    ports: Ports,
    figures: Figures,
    state: State,
    pending: Option<(Transition, Stamp)>,
    activated: bool,
    held: bool,
    last_turn: bool,
    rhythm: Rhythm,
    telling: Telling,
    records: Records,
    supervisor: Option<Pid>,
}

/// Runs `body` as a managed node until it is shut down. `body` opens its ports and then loops over
/// [`Node::tick`]; it is called anew for every `configure`.
pub fn run_with(settings: &Settings, body: impl FnMut(&mut Node<'_>) -> Result) -> Result {
    if settings.clock() == Clock::Realtime {
        clock::be_punctual();
    }
    let namespace = settings.namespace()?;
    // Before it joins, so that whoever sweeps finds nobody, or is kept off.
    let _share = if settings.autostart() { namespace.share()? } else { None };
    if settings.autostart() {
        namespace.clear_dead()?;
    }
    let session =
        Session::join(&namespace, settings.name(), settings.epoch())?.with_clock(settings.clock());
    session
        .with_waiter(settings.wait(), |waiter| Node::new(settings, &session, waiter)?.serve(body))
}

impl<'a> Node<'a> {
    fn new(settings: &'a Settings, session: &'a Session, waiter: &'a Waiter<'a>) -> Result<Self> {
        trace::start(settings);
        let mut report = Box::<NodeStatus>::default();
        report.process = std::process::id();
        Ok(Self {
            settings,
            session,
            waiter,
            requests: session.subscriber(&CHANGE_STATE)?,
            events: session.publisher(&TRANSITION_EVENT)?,
            status: session.publisher(&STATUS)?,
            status_due: Stamp::ZERO,
            report,
            ports: Ports::default(),
            figures: Figures::default(),
            state: State::Unknown,
            pending: None,
            activated: false,
            held: false,
            last_turn: false,
            rhythm: Rhythm::default(),
            telling: Telling::new(settings),
            records: Records::new(settings),
            supervisor: arguments::supervisor(),
        })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        self.settings.name()
    }

    /// What it was started with.
    pub fn settings(&self) -> &Settings {
        self.settings
    }

    /// Whose time the robot lives in.
    pub fn clock(&self) -> Clock {
        self.settings.clock()
    }

    /// Its own parameters, from the launch file and the command line.
    pub fn parameters<T: crate::config::Parameters>(&self) -> Result<T> {
        self.settings.parameters()
    }

    /// Becomes the one publisher of `topic`, and promises a steady flow: the robot is ready only when
    /// something has come, and a silence of a second is a fault.
    pub fn publish<T: Message>(&mut self, topic: &Topic<T>) -> Result<Publisher<T>> {
        self.publisher(topic, Promise::Flow)
    }

    /// Becomes the one publisher of `topic`, but promises nothing: for what is sent only when
    /// something happens, such as an alarm, or once, such as a map. Nobody waits for it, neither for
    /// the robot to be ready nor later.
    pub fn publish_on_event<T: Message>(&mut self, topic: &Topic<T>) -> Result<Publisher<T>> {
        self.publisher(topic, Promise::Nothing)
    }

    fn publisher<T: Message>(
        &mut self,
        topic: &Topic<T>,
        promise: Promise,
    ) -> Result<Publisher<T>> {
        let mut publisher = self.session.publisher(topic)?;
        let faults = self.settings.faults(|_, _| {})?;
        if topic.scope == Scope::Robot
            && let Some(faults) = faults.get(topic.name)
        {
            // A life that its own faults have ended must not meet the same ones again.
            let life = u64::from(self.settings.epoch());
            let stream = xxh3_64_with_seed(topic.name.as_bytes(), life);
            let link = FaultyLink::new(faults, self.settings.launch().seed, stream);
            publisher = publisher.with_faults(link);
            self.ports.add_faulty(topic.name, *faults, publisher.port());
        }
        self.ports.add(publisher.port(), promise);
        Ok(publisher)
    }

    /// Reads `topic`; every sample wakes this node.
    pub fn subscribe<T: Message + 'static>(&mut self, topic: &Topic<T>) -> Result<Subscriber<T>> {
        let subscriber = self.session.subscriber(topic)?;
        self.ports.add(subscriber.port(), Promise::Flow);
        Ok(subscriber)
    }

    /// Reads `topic`, but no sample of it wakes this node: for what is looked at when something
    /// else does.
    pub fn subscribe_quietly<T: Message + 'static>(
        &mut self,
        topic: &Topic<T>,
    ) -> Result<Subscriber<T>> {
        let subscriber = self.session.quiet_subscriber(topic)?;
        self.ports.add(subscriber.port(), Promise::Flow);
        Ok(subscriber)
    }

    /// From the next activation on, [`Tick::due`] is set once every `period`. Without a drift: a
    /// turn that comes late does not move the next; one that misses its successor is counted. How
    /// late turns come is told as `late`.
    pub fn set_period(&mut self, period: Duration) {
        self.rhythm.set_period(period, &mut self.figures);
    }

    /// From now on these of its `parameters` may be changed while the node runs; see
    /// [`Tuning::take`].
    pub fn tuning<T: Listable>(
        &mut self,
        parameters: T,
        tunables: &'static [Tunable],
    ) -> Result<Tuning<T>> {
        Tuning::open(self.session, parameters, tunables)
    }

    /// A figure of this node's status, with its unit at the end of `key` (`distance_m`).
    pub fn gauge(&mut self, key: &str) -> Gauge {
        self.figures.gauge(key)
    }

    /// A duration of this node's status: its median, 99th percentile and maximum over the run, as
    /// `NAME_p50_us` and so on.
    pub fn latency(&mut self, name: &str) -> Latency {
        self.figures.latency(name)
    }

    /// The same, and how many there were in each of a few steps: `NAME_up_to_100_us` and so on.
    pub fn latency_by_steps(&mut self, name: &str) -> Latency {
        self.figures.latency_by_steps(name)
    }

    /// The one diary of this node, with a value for each of `keys`, for the report of a run. A key ends
    /// with its unit; one of a state, which is a number, lists its names: `activity:rests/drives`.
    pub fn diary(&mut self, keys: &[&str]) -> Diary {
        self.records.diary(keys)
    }

    /// From now on a turn comes whenever more can be read from `file`, such as a serial port, until
    /// that is closed. The node reads it to its end in each turn.
    pub fn watch(&self, file: impl AsFd) -> std::io::Result<()> {
        self.waiter.watch(file)
    }

    /// The next turn comes at `moment`, unless something brings it before.
    pub fn wake_by(&mut self, moment: Option<Stamp>) {
        self.rhythm.set_alarm(moment);
    }

    /// Says in one line what the node is doing.
    pub fn say(&mut self, text: &str) {
        self.report.text = Text::new(text);
        self.telling.status(text);
    }

    /// Asks for so much more time, from now, for what the node is doing: for a start that takes
    /// longer than the launch file says.
    pub fn extend_timeout(&self, more: Duration) {
        self.telling.extend_timeout(more);
    }

    /// Wakes whoever started this node: there is something on a topic that it reads.
    pub(crate) fn hint(&self, name: &str) {
        self.telling.hint(name);
    }

    /// Says that there is nothing left to do: the run may end, well or ill, because of `why`.
    pub fn finish(&mut self, outcome: Outcome, why: &str) -> Result<()> {
        self.report.outcome = outcome as u8;
        self.say(why);
        self.send_status(clock::now())
    }

    /// Puts off a deactivation until [`Node::release`]: others are at work on what this node began.
    pub fn hold(&mut self) {
        self.held = true;
    }

    /// Nothing is under way any more.
    pub fn release(&mut self) {
        self.held = false;
    }

    /// Whether this node was asked to pause or end, which the next [`Node::tick`] will do.
    pub fn leaving(&mut self) -> Result<bool> {
        self.take_request(clock::now())?;
        Ok(self.pending.is_some())
    }

    /// Whether the supervisor that started this node to drive the wheels is gone. The node is asked
    /// to end then, too.
    pub fn has_lost_supervisor(&self) -> bool {
        self.supervisor.is_some_and(|supervisor| getppid() != Some(supervisor))
    }

    /// Waits for the next turn: a sample, a period, or a moment that passed without either. `None`
    /// when the node has to let go of everything.
    pub fn tick(&mut self) -> Result<Option<Tick>> {
        if self.state == State::Configuring {
            self.prepare_faults()?;
            memory::lock(self.settings)?;
            self.change(State::Inactive, "")?;
        }
        trace::turn_ends();
        let mut waited = false;
        loop {
            let now = clock::now();
            self.telling.ping(now);
            self.ports.flush(now)?;
            self.tell_flow(now)?;
            self.take_request(now)?;
            if let Some((transition, since)) = self.pending
                && (!self.held || HOLD_MAX < now.since(since))
            {
                // What has come before is still seen to.
                if self.state == State::Active && !std::mem::replace(&mut self.last_turn, true) {
                    return self.turn(now).map(Some);
                }
                self.last_turn = false;
                self.pending = None;
                self.held = false;
                if self.obey(transition)? {
                    return Ok(None);
                }
                continue;
            }
            if self.state == State::Active && (waited || self.activated || self.rhythm.is_due(now))
            {
                return self.turn(now).map(Some);
            }
            self.greet()?;
            self.wait(now)?;
            waited = true;
        }
    }

    /// All topics that can have faults are known now: refuses those that nobody publishes here.
    fn prepare_faults(&mut self) -> Result {
        let (faulty, published) = (self.ports.faulty_topics(), self.ports.published_topics());
        self.settings.faults(|faults, report| {
            for topic in faults.keys().filter(|topic| !faulty.contains(&topic.as_str())) {
                let message = format!("is no topic that `{}` publishes", self.settings.name());
                report.refuse(topic, message, config::suggestion(topic, &published));
            }
        })?;
        self.ports.prepare_figures(&mut self.figures);
        Ok(())
    }

    fn turn(&mut self, now: Stamp) -> Result<Tick> {
        let activated = std::mem::take(&mut self.activated);
        trace::turn_begins();
        let due = self.rhythm.is_due(now);
        self.rhythm.advance(now);
        if self.status_due <= now {
            self.send_status(now)?;
        }
        Ok(Tick { now, activated, due })
    }

    /// Says once that all topics have carried something, as soon as they have.
    fn tell_flow(&mut self, now: Stamp) -> Result {
        let is_active = self.state == State::Active && !self.activated;
        if is_active && self.telling.awaits_flow() && self.ports.have_flowed() {
            self.send_status(now)?;
            self.telling.flow();
        }
        Ok(())
    }

    fn wait(&self, now: Stamp) -> Result {
        let at_latest = now.after(WAIT_MAX);
        if self.state != State::Active {
            return self.waiter.block(at_latest);
        }
        let moments = [self.rhythm.next(), self.ports.due(), Some(at_latest)];
        let until = moments.into_iter().flatten().min().unwrap_or(at_latest);
        self.waiter.wait(until, || Ok(self.ports.has_samples()? || self.requests.has_samples()?))
    }

    /// Tells those who have come late what they have missed. Where nobody has come it is one look at a
    /// counter.
    fn greet(&self) -> Result {
        self.events.greet()?;
        self.status.greet()
    }

    /// Calls `body` for each `configure`, until the node is shut down.
    fn serve(&mut self, mut body: impl FnMut(&mut Self) -> Result) -> Result {
        self.change(State::Unconfigured, "")?;
        while self.await_configure()? {
            self.change(State::Configuring, "")?;
            if let Err(error) = body(self) {
                return self.fail(error);
            }
            self.ports.clear();
            self.figures.clear();
            if self.state != State::CleaningUp {
                break;
            }
            self.change(State::Unconfigured, "")?;
        }
        if self.state != State::ShuttingDown {
            self.change(State::ShuttingDown, "")?;
        }
        self.change(State::Finalized, "")
    }

    /// Waits until the node may configure itself; false where it shall end instead.
    fn await_configure(&mut self) -> Result<bool> {
        loop {
            let now = clock::now();
            self.telling.ping(now);
            self.take_request(now)?;
            match self.pending.take() {
                Some((Transition::Configure, _)) => return Ok(true),
                Some((Transition::ShutdownUnconfigured, _)) => return Ok(false),
                Some(_) | None => {
                    self.greet()?;
                    self.wait(now)?;
                }
            }
        }
    }

    fn fail(&mut self, error: Error) -> Result {
        let reason = error.to_string();
        let line = reason.lines().next().unwrap_or_default();
        self.records.write(&self.figures);
        if self.state == State::Configuring {
            self.change(State::Unconfigured, line)?;
        } else {
            self.change(State::ErrorProcessing, line)?;
            self.change(State::Finalized, line)?;
        }
        Err(error)
    }

    /// Does what was asked; true where the node's code has to return for it.
    fn obey(&mut self, transition: Transition) -> Result<bool> {
        if self.state == State::Active && transition != Transition::Deactivate {
            self.deactivate()?;
        }
        // What came while others were still at work is counted, as unread.
        self.ports.drain()?;
        match transition {
            Transition::Activate => self.activate()?,
            Transition::Deactivate => self.deactivate()?,
            Transition::CleanUp => self.change(State::CleaningUp, "")?,
            Transition::ShutdownUnconfigured
            | Transition::ShutdownInactive
            | Transition::ShutdownActive => self.change(State::ShuttingDown, "")?,
            Transition::Configure => {}
        }
        Ok(!matches!(self.state, State::Active | State::Inactive))
    }

    fn activate(&mut self) -> Result {
        self.change(State::Activating, "")?;
        // What came while the node's code was not running is not for it.
        self.ports.drain()?;
        self.activated = true;
        self.rhythm.start(clock::now());
        self.change(State::Active, "")
    }

    fn deactivate(&mut self) -> Result {
        self.change(State::Deactivating, "")?;
        self.ports.drain()?;
        self.change(State::Inactive, "")?;
        self.records.write(&self.figures);
        trace::write();
        Ok(())
    }

    /// Notes the next request that fits the node's state; a signal is a request to end.
    fn take_request(&mut self, now: Stamp) -> Result {
        if self.pending.is_some() {
            return Ok(());
        }
        if self.settings.heeds_signals() && 0 < signal::stop_requests() {
            self.pending = Transition::shutdown_from(self.state).map(|end| (end, now));
            return Ok(());
        }
        while let Some(request) = self.requests.receive()? {
            match Transition::try_from(request.transition) {
                Ok(transition) if transition.start() == self.state => {
                    self.pending = Some((transition, now));
                    return Ok(());
                }
                Ok(transition) => {
                    tracing::warn!(%transition, state = %self.state, "refused a transition");
                    self.announce(self.state, "refused a transition that does not start here")?;
                }
                Err(cause) => tracing::warn!(%cause, "refused a transition"),
            }
        }
        self.autostart(now);
        Ok(())
    }

    /// A node that nobody supervises configures and activates itself.
    fn autostart(&mut self, now: Stamp) {
        if !self.settings.autostart() {
            return;
        }
        let next = match self.state {
            State::Unconfigured => Some(Transition::Configure),
            State::Inactive => Some(Transition::Activate),
            _ => None,
        };
        self.pending = next.map(|next| (next, now));
    }

    fn change(&mut self, goal: State, reason: &str) -> Result {
        let start = std::mem::replace(&mut self.state, goal);
        tracing::debug!(%start, %goal, "changed state");
        // The counters first: whoever sees the new state finds them.
        self.send_status(clock::now())?;
        self.announce(start, reason)?;
        self.telling.state(goal);
        Ok(())
    }

    fn announce(&mut self, start: State, reason: &str) -> Result {
        let goal = self.state;
        self.events.send_with(|event| {
            event.header.stamp = clock::now();
            event.start_state = start as u8;
            event.goal_state = goal as u8;
            event.reason = Text::new(reason);
        })
    }

    fn send_status(&mut self, now: Stamp) -> Result {
        self.status_due = now.after(STATUS_PERIOD);
        self.ports.update_figures();
        let report = &mut *self.report;
        report.header.stamp = now;
        report.state = self.state as u8;
        if self.state != State::Unconfigured && self.state != State::Finalized {
            report.port_count = self.ports.write(&mut report.port);
            report.value_count = self.figures.write(&mut report.value);
        }
        self.status.send_with(|status| *status = *report)
    }
}

//! A managed node: its own code runs only while it is active.

mod lifecycle;
mod ports;
mod report;
mod rhythm;
mod telling;

use std::os::fd::AsFd;
use std::time::Duration;

use interfaces::{Message, Outcome, Scope, Stamp, State, Topic, Transition};
use rustix::process::{Pid, getppid};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::arguments;
use crate::config;
use crate::config::Listable;
use crate::diary::{Diary, Records};
use crate::faults::FaultyLink;
use crate::figures::Figures;
use crate::wake::Waiter;
use crate::{
    Clock, Error, Gauge, Latency, Publisher, Result, Session, Settings, Subscriber, Tunable,
    Tuning, clock, memory, trace,
};
use lifecycle::{Lifecycle, Next};
use ports::{Ports, Promise};
use report::Report;
use rhythm::Rhythm;
use telling::Telling;

/// However long nothing happens, every wait ends: a lost wake-up costs no more than this.
const WAIT_MAX: Duration = Duration::from_millis(50);

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
    life: Lifecycle,
    report: Report,
    ports: Ports,
    figures: Figures,
    activated: bool,
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
        Ok(Self {
            settings,
            session,
            waiter,
            life: Lifecycle::open(session)?,
            report: Report::open(session)?,
            ports: Ports::default(),
            figures: Figures::default(),
            activated: false,
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
        self.report.set_text(text);
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
        self.report.set_outcome(outcome);
        self.say(why);
        self.send_status(clock::now())
    }

    /// Puts off a deactivation until [`Node::release`]: others are at work on what this node began.
    pub fn hold(&mut self) {
        self.life.set_held(true);
    }

    /// Nothing is under way any more.
    pub fn release(&mut self) {
        self.life.set_held(false);
    }

    /// Whether this node was asked to pause or end, which the next [`Node::tick`] will do.
    pub fn leaving(&mut self) -> Result<bool> {
        self.life.take_request(self.settings, clock::now())?;
        Ok(self.life.is_leaving())
    }

    /// Whether the supervisor that started this node to drive the wheels is gone. The node is asked
    /// to end then, too.
    pub fn has_lost_supervisor(&self) -> bool {
        self.supervisor.is_some_and(|supervisor| getppid() != Some(supervisor))
    }

    /// Waits for the next turn: a sample, a period, or a moment that passed without either. `None`
    /// when the node has to let go of everything.
    pub fn tick(&mut self) -> Result<Option<Tick>> {
        if self.life.state() == State::Configuring {
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
            self.life.take_request(self.settings, now)?;
            match self.life.next(now) {
                Next::LastTurn => return self.turn(now).map(Some),
                Next::Go(transition) if self.obey(transition)? => return Ok(None),
                Next::Go(_) => continue,
                Next::Stay => {}
            }
            let is_active = self.life.state() == State::Active;
            if is_active && (waited || self.activated || self.rhythm.is_due(now)) {
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
        if self.report.is_due(now) {
            self.send_status(now)?;
        }
        Ok(Tick { now, activated, due })
    }

    /// Says once that all topics have carried something, as soon as they have.
    fn tell_flow(&mut self, now: Stamp) -> Result {
        let is_active = self.life.state() == State::Active && !self.activated;
        if is_active && self.telling.awaits_flow() && self.ports.have_flowed() {
            self.send_status(now)?;
            self.telling.flow();
        }
        Ok(())
    }

    fn wait(&self, now: Stamp) -> Result {
        let at_latest = now.after(WAIT_MAX);
        if self.life.state() != State::Active {
            return self.waiter.block(at_latest);
        }
        let moments = [self.rhythm.next(), self.ports.due(), Some(at_latest)];
        let until = moments.into_iter().flatten().min().unwrap_or(at_latest);
        self.waiter.wait(until, || Ok(self.ports.has_samples()? || self.life.has_requests()?))
    }

    /// Tells those who have come late what they have missed. Where nobody has come it is one look at a
    /// counter.
    fn greet(&self) -> Result {
        self.life.greet()?;
        self.report.greet()
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
            if self.life.state() != State::CleaningUp {
                break;
            }
            self.change(State::Unconfigured, "")?;
        }
        if self.life.state() != State::ShuttingDown {
            self.change(State::ShuttingDown, "")?;
        }
        self.change(State::Finalized, "")
    }

    /// Waits until the node may configure itself; false where it shall end instead.
    fn await_configure(&mut self) -> Result<bool> {
        loop {
            let now = clock::now();
            self.telling.ping(now);
            self.life.take_request(self.settings, now)?;
            match self.life.next(now) {
                Next::Go(Transition::Configure) => return Ok(true),
                Next::Go(Transition::ShutdownUnconfigured) => return Ok(false),
                Next::Go(_) | Next::LastTurn | Next::Stay => {
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
        if self.life.state() == State::Configuring {
            self.change(State::Unconfigured, line)?;
        } else {
            self.change(State::ErrorProcessing, line)?;
            self.change(State::Finalized, line)?;
        }
        Err(error)
    }

    /// Does what was asked; true where the node's code has to return for it.
    fn obey(&mut self, transition: Transition) -> Result<bool> {
        if self.life.state() == State::Active && transition != Transition::Deactivate {
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
        Ok(!matches!(self.life.state(), State::Active | State::Inactive))
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

    fn change(&mut self, goal: State, reason: &str) -> Result {
        let start = self.life.enter(goal);
        // The counters first: whoever sees the new state finds them.
        self.send_status(clock::now())?;
        self.life.announce(start, reason)?;
        self.telling.state(goal);
        Ok(())
    }

    fn send_status(&mut self, now: Stamp) -> Result {
        self.report.send(now, self.life.state(), &self.ports, &self.figures)
    }
}

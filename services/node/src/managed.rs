//! A managed node: its own code runs only while it is active.

use std::rc::Rc;
use std::time::Duration;

use iceoryx2::prelude::{SignalHandlingMode, WaitSetBuilder, ipc};
use interfaces::topics::{CHANGE_STATE, STATUS, TRANSITION_EVENT};
use interfaces::{
    ChangeState, Message, NodeStatus, Outcome, PORTS_MAX, PortStatus, Scope, Stamp, State, Text,
    Topic, Transition, TransitionEvent,
};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use rustix::process::{Pid, getppid};

use crate::arguments;
use crate::config;
use crate::faults::{Faults, FaultyLink, Figure};
use crate::figures::Figures;
use crate::port::Port;
use crate::wake::Waiter;
use crate::{
    Clock, Error, Gauge, Latency, Notifier, Publisher, Result, Session, Settings, Subscriber, Wait,
    clock, memory, signal, watchdog_period,
};

/// However long nothing happens, every wait ends: a lost wake-up costs no more than this.
const WAIT_MAX: Duration = Duration::from_millis(50);

/// While active, a node says this often how it is.
const STATUS_PERIOD: Duration = Duration::from_millis(100);

/// How long a node may finish what it has begun before it is deactivated all the same.
const HOLD_MAX: Duration = Duration::from_secs(1);

/// Shorter than this a time-out of the transport is none: it counts whole milliseconds.
const TIMEOUT_MIN: Duration = Duration::from_millis(1);

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
    waiter: Waiter<'a>,
    requests: Subscriber<ChangeState>,
    events: Publisher<TransitionEvent>,
    status: Publisher<NodeStatus>,
    status_due: Stamp,
    greeting_due: Stamp,
    report: Box<NodeStatus>,
    ports: Vec<Counted>,
    faulty: Vec<Faulty>,
    figures: Figures,
    state: State,
    pending: Option<(Transition, Stamp)>,
    activated: bool,
    held: bool,
    last_turn: bool,
    period: Option<Duration>,
    due: Stamp,
    overruns: Gauge,
    lateness: Option<Latency>,
    alarm: Option<Stamp>,
    notifier: Notifier,
    ping_period: Option<Duration>,
    ping_due: Stamp,
    told: Told,
    supervisor: Option<Pid>,
}

/// What whoever started this node has been told about it, beside its states.
#[derive(Debug, Default)]
struct Told {
    ready: bool,
    flows: bool,
}

/// A port whose counters and queue the node looks after.
struct Counted {
    port: Rc<dyn Port>,
    /// Whether nobody may wait for it to carry something.
    on_event: bool,
}

impl Counted {
    fn new(port: Rc<dyn Port>) -> Self {
        Self { port, on_event: false }
    }

    fn on_event(port: Rc<dyn Port>) -> Self {
        Self { port, on_event: true }
    }

    fn status(&self) -> PortStatus {
        PortStatus { on_event: self.on_event.into(), ..self.port.status() }
    }

    fn has_flowed(&self) -> bool {
        self.on_event || self.port.has_flowed()
    }
}

impl std::fmt::Debug for Counted {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(self.port.status().topic.as_str())
    }
}

/// A port on whose topic something goes wrong on purpose, and what it says of that.
struct Faulty {
    topic: &'static str,
    faults: Faults,
    port: Rc<dyn Port>,
    gauges: Vec<(Gauge, &'static Figure)>,
}

impl std::fmt::Debug for Faulty {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(self.topic)
    }
}

/// Runs `body` as a managed node until it is shut down. `body` opens its ports and then loops over
/// [`Node::tick`]; it is called anew for every `configure`.
pub fn run_with(settings: &Settings, body: impl FnMut(&mut Node<'_>) -> Result) -> Result {
    let namespace = settings.namespace()?;
    // Before it joins, so that whoever sweeps finds nobody, or is kept off.
    let _share = if settings.autostart() { namespace.share()? } else { None };
    let session =
        Session::join(&namespace, settings.name(), settings.epoch())?.with_clock(settings.clock());
    let failed = |cause: String| Error::shared_memory("open the wake-up channel", cause);
    let listener = session
        .wake_service(settings.name())?
        .listener_builder()
        .create()
        .map_err(|cause| failed(format!("{cause:?}")))?;
    let waitset = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|cause| failed(format!("{cause:?}")))?;
    // Attached once: attaching anew for each wait would cost ten system calls a message.
    let _attached =
        waitset.attach_notification(&listener).map_err(|cause| failed(format!("{cause:?}")))?;
    let waiter = Waiter { mode: settings.wait(), listener: &listener, waitset: &waitset };
    Node::new(settings, &session, waiter)?.serve(body)
}

impl<'a> Node<'a> {
    fn new(settings: &'a Settings, session: &'a Session, waiter: Waiter<'a>) -> Result<Self> {
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
            greeting_due: Stamp::ZERO,
            report,
            ports: Vec::new(),
            faulty: Vec::new(),
            figures: Figures::default(),
            state: State::Unknown,
            pending: None,
            activated: false,
            held: false,
            last_turn: false,
            period: None,
            due: Stamp::ZERO,
            overruns: Gauge::default(),
            lateness: None,
            alarm: None,
            notifier: settings.notifier(),
            // The watchdog of a node in its supervisor's process is the supervisor's.
            ping_period: watchdog_period().filter(|_| settings.heeds_signals()),
            ping_due: Stamp::ZERO,
            told: Told::default(),
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
        self.publisher(topic, Counted::new)
    }

    /// Becomes the one publisher of `topic`, but promises nothing: for what is sent only when
    /// something happens, such as an alarm, or once, such as a map. Nobody waits for it, neither for
    /// the robot to be ready nor later.
    pub fn publish_on_event<T: Message>(&mut self, topic: &Topic<T>) -> Result<Publisher<T>> {
        self.publisher(topic, Counted::on_event)
    }

    fn publisher<T: Message>(
        &mut self,
        topic: &Topic<T>,
        counted: fn(Rc<dyn Port>) -> Counted,
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
            let (port, faults) = (publisher.port(), *faults);
            self.faulty.push(Faulty { topic: topic.name, faults, port, gauges: Vec::new() });
        }
        self.ports.push(counted(publisher.port()));
        Ok(publisher)
    }

    /// Reads `topic`; every sample wakes this node.
    pub fn subscribe<T: Message + 'static>(&mut self, topic: &Topic<T>) -> Result<Subscriber<T>> {
        let subscriber = self.session.subscriber(topic)?;
        self.ports.push(Counted::new(subscriber.port()));
        Ok(subscriber)
    }

    /// Reads `topic`, but no sample of it wakes this node: for what is looked at when something
    /// else does.
    pub fn subscribe_quietly<T: Message + 'static>(
        &mut self,
        topic: &Topic<T>,
    ) -> Result<Subscriber<T>> {
        let subscriber = self.session.quiet_subscriber(topic)?;
        self.ports.push(Counted::new(subscriber.port()));
        Ok(subscriber)
    }

    /// From the next activation on, [`Tick::due`] is set once every `period`. Without a drift: a
    /// turn that comes late does not move the next; one that misses its successor is counted. How
    /// late turns come is told as `late`.
    pub fn set_period(&mut self, period: Duration) {
        self.period = Some(period);
        self.overruns = self.gauge("overruns");
        self.lateness = Some(self.latency("late"));
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

    /// The next turn comes at `moment`, unless something brings it before.
    pub fn wake_by(&mut self, moment: Option<Stamp>) {
        self.alarm = moment;
    }

    /// Says in one line what the node is doing.
    pub fn say(&mut self, text: &str) {
        self.report.text = Text::new(text);
        self.notifier.status(text);
    }

    /// Asks for so much more time, from now, for what the node is doing: for a start that takes
    /// longer than the launch file says.
    pub fn extend_timeout(&self, more: Duration) {
        self.notifier.extend_timeout(more);
    }

    /// Wakes whoever started this node: there is something on a topic that it reads.
    pub(crate) fn hint(&self, name: &str) {
        self.notifier.hint(name, "1");
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
        let mut waited = false;
        loop {
            let now = clock::now();
            self.ping(now);
            self.flush(now)?;
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
            if self.state == State::Active && (waited || self.activated || self.is_due(now)) {
                return self.turn(now).map(Some);
            }
            self.greet(now)?;
            self.wait(now)?;
            waited = true;
        }
    }

    /// All topics that can have faults are known now: refuses those that nobody publishes here.
    fn prepare_faults(&mut self) -> Result {
        let published: Vec<_> = self.faulty.iter().map(|faulty| faulty.topic).collect();
        let ports = self.ports.iter().map(|port| port.port.status());
        let ports = ports.filter(|port| port.publishes == 1);
        let topics: Vec<_> = ports.map(|port| port.topic.to_string()).collect();
        self.settings.faults(|faults, report| {
            for topic in faults.keys().filter(|topic| !published.contains(&topic.as_str())) {
                let message = format!("is no topic that `{}` publishes", self.settings.name());
                report.refuse(topic, message, config::suggestion(topic, &topics));
            }
        })?;
        for Faulty { topic, faults, gauges, .. } in &mut self.faulty {
            for figure in faults.figures() {
                let key = format!("faults_{topic}_{}", figure.name);
                if let Some(gauge) = self.figures.gauge_if_fits(&key) {
                    gauges.push((gauge, figure));
                } else {
                    tracing::warn!(key, "no room in the status");
                }
            }
        }
        Ok(())
    }

    /// Sends what faults have made late.
    fn flush(&self, now: Stamp) -> Result {
        self.faulty.iter().try_for_each(|faulty| faulty.port.flush(now))
    }

    /// Tells whoever started this node that its loop turns: from here, and from no other thread.
    fn ping(&mut self, now: Stamp) {
        if let Some(period) = self.ping_period
            && self.ping_due <= now
        {
            self.ping_due = now.after(period);
            self.notifier.watchdog();
        }
    }

    fn turn(&mut self, now: Stamp) -> Result<Tick> {
        let activated = std::mem::take(&mut self.activated);
        let due = self.is_due(now);
        if due && let Some(period) = self.period {
            self.schedule(now, period);
        }
        if self.status_due <= now {
            self.send_status(now)?;
        }
        Ok(Tick { now, activated, due })
    }

    /// Says once that all topics have carried something, as soon as they have.
    fn tell_flow(&mut self, now: Stamp) -> Result {
        let is_active = self.state == State::Active && !self.activated;
        if is_active && !self.told.flows && self.ports.iter().all(Counted::has_flowed) {
            self.told.flows = true;
            self.send_status(now)?;
            self.notifier.hint("FLOWS", "1");
        }
        Ok(())
    }

    fn is_due(&self, now: Stamp) -> bool {
        self.period.is_some() && self.due <= now
    }

    fn schedule(&mut self, now: Stamp, period: Duration) {
        if let Some(lateness) = &self.lateness {
            lateness.record(now.since(self.due));
        }
        self.due = self.due.after(period);
        if self.due <= now {
            self.overruns.count();
            self.due = now.after(period);
        }
    }

    fn wait(&self, now: Stamp) -> Result<()> {
        if self.state != State::Active {
            return Waiter { mode: Wait::Block, ..self.waiter }.wait(WAIT_MAX);
        }
        let late = self.faulty.iter().filter_map(|faulty| faulty.port.due()).min();
        let moments = [self.period.map(|_| self.due), self.alarm, late, Some(now.after(WAIT_MAX))];
        let until_due = moments.into_iter().flatten().min().map_or(WAIT_MAX, |due| due.since(now));
        if self.waiter.mode == Wait::Block && until_due < TIMEOUT_MIN {
            clock::nap(until_due);
            return Ok(());
        }
        // Whole milliseconds, rounded down: the rest is napped away just before the period ends.
        self.waiter.wait(Duration::from_millis(u64::try_from(until_due.as_millis()).unwrap_or(0)))
    }

    /// Tells those who have come late what they have missed, now and then.
    fn greet(&mut self, now: Stamp) -> Result {
        if self.greeting_due <= now {
            self.greeting_due = now.after(STATUS_PERIOD);
            self.events.greet()?;
            self.status.greet()?;
        }
        Ok(())
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
            self.faulty.clear();
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
            self.ping(now);
            self.take_request(now)?;
            match self.pending.take() {
                Some((Transition::Configure, _)) => return Ok(true),
                Some((Transition::ShutdownUnconfigured, _)) => return Ok(false),
                Some(_) | None => {
                    self.greet(now)?;
                    self.wait(now)?;
                }
            }
        }
    }

    fn fail(&mut self, error: Error) -> Result {
        let reason = error.to_string();
        let line = reason.lines().next().unwrap_or_default();
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
        self.drain()?;
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
        self.drain()?;
        self.activated = true;
        self.due = clock::now();
        self.change(State::Active, "")
    }

    fn deactivate(&mut self) -> Result {
        self.change(State::Deactivating, "")?;
        self.drain()?;
        self.change(State::Inactive, "")
    }

    fn drain(&self) -> Result {
        self.ports.iter().try_for_each(|counted| counted.port.drain())
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
        self.notifier.hint("LIFECYCLE", goal.label());
        match goal {
            State::Active if !std::mem::replace(&mut self.told.ready, true) => {
                self.notifier.ready();
            }
            State::ShuttingDown => self.notifier.stopping(),
            _ => {}
        }
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
        for faulty in &self.faulty {
            let counts = faulty.port.faults();
            for (gauge, figure) in &faulty.gauges {
                gauge.set((figure.count)(&counts) as f64);
            }
        }
        let report = &mut *self.report;
        report.header.stamp = now;
        report.state = self.state as u8;
        if self.state != State::Unconfigured && self.state != State::Finalized {
            let ports = self.ports.iter().take(PORTS_MAX);
            report.port_count = u32::try_from(ports.len()).unwrap_or_default();
            for (slot, port) in report.port.iter_mut().zip(ports) {
                *slot = port.status();
            }
            report.value_count = self.figures.write(&mut report.value);
        }
        self.status.send_with(|status| *status = *report)
    }
}

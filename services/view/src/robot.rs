//! The robot from outside: what it tells, in shared memory and at its supervisor's socket.

use std::path::Path;
use std::time::Duration;

use interfaces::topics::{MOTION_REQUEST, MOTION_STATE, ODOMETRY, SCAN, STATUS, TELEOP_COMMAND};
use interfaces::{Described, Header, MotionRequest, NodeStatus, Stamp, Topic, VelocityCommand};
use node::control::{self, Connection, Heard, Request};
use node::deadman::Motion;
use node::hand::{Hand, Key, PATIENCE};
use node::observe::{self, Observer};
use node::{
    Clock, EmergencyStop, Error, Namespace, Publisher, Result, Session, Subscriber, clock, process,
};
use serde_json::Value;

use crate::map::FindMap;
use crate::processes::Processes;
use crate::state::State;

/// Between two questions to the supervisor where nothing has happened: what moves fast is in shared
/// memory, and to answer takes the supervisor a millisecond.
const QUESTION_PERIOD: Duration = Duration::from_secs(1);

/// The same after something has happened.
const QUESTION_PAUSE: Duration = Duration::from_millis(100);

/// Between two looks at what processes take: the kernel counts in steps of ten milliseconds.
const PROCESS_PERIOD: Duration = Duration::from_secs(1);

/// Whoever drives wheels takes a request within one turn of its loop.
const ARMING: Duration = Duration::from_secs(1);

/// The fastest that a Burger can.
const FASTEST: Motion = Motion { linear: 0.22, angular: 2.84 };

/// One robot, looked at. It is woken by nobody and holds nobody up.
pub(crate) struct Robot {
    namespace: Namespace,
    find_map: FindMap,
    question: Option<Connection>,
    question_due: Stamp,
    events: Option<Connection>,
    process_due: Stamp,
    processes: Processes,
    /// [-] The supervisor whose robot it is.
    supervisor: u32,
    shared: Option<Shared>,
    order: Option<Connection>,
    arming: Option<(Publisher<MotionRequest>, bool, Stamp)>,
    commands: Option<Publisher<VelocityCommand>>,
    hand: Hand,
}

/// A guest's place in the robot's shared memory.
struct Shared {
    session: Session,
    clock: Clock,
    statuses: Vec<(String, Subscriber<NodeStatus>)>,
    /// By the topic's name.
    taps: Vec<(String, Tap)>,
}

impl Robot {
    pub(crate) fn new(namespace: &Namespace, find_map: FindMap) -> Self {
        Self {
            namespace: namespace.clone(),
            find_map,
            question: None,
            question_due: Stamp::ZERO,
            events: None,
            process_due: Stamp::ZERO,
            processes: Processes::default(),
            supervisor: 0,
            shared: None,
            order: None,
            arming: None,
            commands: None,
            hand: Hand::new(FASTEST, Some(PATIENCE)),
        }
    }

    /// Takes in everything that has come.
    pub(crate) fn look(&mut self, now: Stamp, state: &mut State) -> Result {
        if !self.namespace.lock().exists() {
            self.lose(now, state);
            return Ok(());
        }
        self.ask(now, state);
        self.hear_events(now, state);
        self.hear_order();
        self.join(state)?;
        if let Some(shared) = &mut self.shared {
            shared.look(now, state)?;
        }
        self.look_at_processes(now, state);
        self.go_on_arming(now)?;
        let motion = self.hand.motion(now, state.motion.permission == "armed");
        motion.map_or(Ok(()), |motion| self.command(now, motion))?;
        state.settle(now);
        Ok(())
    }

    /// Nothing of it is held, so that nothing of it is in the way of its next run.
    fn lose(&mut self, now: Stamp, state: &mut State) {
        self.question = None;
        self.events = None;
        self.order = None;
        self.shared = None;
        self.arming = None;
        self.commands = None;
        self.hand = Hand::new(FASTEST, Some(PATIENCE));
        self.supervisor = 0;
        state.lose(now);
    }

    fn ask(&mut self, now: Stamp, state: &mut State) {
        if self.question.is_none() && self.question_due <= now {
            self.question_due = now.after(QUESTION_PERIOD);
            self.question = Connection::attempt(&self.namespace, &Request::Status);
        }
        let Some(status) = next(&mut self.question) else { return };
        self.question = None;
        self.meet(&status, state);
        state.hear_status(now, &status);
        if state.place.map.is_none()
            && let Some((world, start)) = &state.supervisor.world
        {
            let map = (self.find_map)(Path::new(world), start);
            state.set_map(map);
        }
    }

    /// Another supervisor is another run: nothing of the last one counts.
    fn meet(&mut self, status: &Value, state: &mut State) {
        let pid = status["supervisor"].as_u64().and_then(|pid| pid.try_into().ok()).unwrap_or(0);
        if self.supervisor != pid {
            self.supervisor = pid;
            self.shared = None;
            self.events = None;
            *state = State::new(self.namespace.robot());
        }
    }

    fn hear_events(&mut self, now: Stamp, state: &mut State) {
        if self.events.is_none() && self.supervisor != 0 {
            let request = Request::Events { node: None, follow: true };
            self.events = Connection::attempt(&self.namespace, &request);
            state.events.clear();
        }
        while let Some(line) = next(&mut self.events) {
            state.hear_event(&line["event"]);
            // What has happened has changed how things stand, and what comes with it will soon.
            self.question_due = self.question_due.min(now.after(QUESTION_PAUSE));
        }
    }

    /// What becomes of an order is among the events.
    fn hear_order(&mut self) {
        while next(&mut self.order).is_some() {}
    }

    fn join(&mut self, state: &State) -> Result {
        let Some(clock) = state.supervisor.clock.filter(|_| self.shared.is_none()) else {
            return Ok(());
        };
        let session = Session::guest(&self.namespace, "view")?.with_clock(clock);
        self.shared = Some(Shared { session, clock, statuses: Vec::new(), taps: Vec::new() });
        Ok(())
    }

    fn look_at_processes(&mut self, now: Stamp, state: &mut State) {
        if now < self.process_due || state.nodes.is_empty() {
            return;
        }
        self.process_due = now.after(PROCESS_PERIOD);
        let pids: Vec<_> = state.nodes.iter().filter_map(|node| node.pid).collect();
        self.processes.keep(&pids);
        for index in 0..state.nodes.len() {
            let Some(pid) = state.nodes[index].pid else {
                state.hear_process(index, None, None);
                continue;
            };
            let cpu = self.processes.cpu_percent(now, pid);
            state.hear_process(index, cpu, process::memory_kib(pid, "VmRSS:"));
        }
    }

    /// A node and whoever requires it, down and up again.
    pub(crate) fn restart(&mut self, node: &str) {
        let request = Request::Restart { node: node.to_owned() };
        self.order = Connection::attempt(&self.namespace, &request);
    }

    /// Latches the emergency stop; false where it was latched before.
    pub(crate) fn stop(&self) -> Result<bool> {
        EmergencyStop::of(&self.namespace).latch(&self.namespace, "teseo view")
    }

    /// Releases it; false where it was not latched.
    pub(crate) fn release(&self) -> Result<bool> {
        EmergencyStop::of(&self.namespace).release()
    }

    /// Asks whoever drives the wheels to let the robot move again.
    pub(crate) fn arm(&mut self, now: Stamp) -> Result {
        if let Some(shared) = self.shared.as_ref().filter(|_| self.arming.is_none()) {
            let publisher = shared.session.publisher(&MOTION_REQUEST)?;
            self.arming = Some((publisher, false, now.after(ARMING)));
        }
        Ok(())
    }

    /// A person has pressed a key to drive by; the first takes the robot over.
    pub(crate) fn drive(&mut self, now: Stamp, key: Key) -> Result {
        if self.commands.is_none() {
            let Some(shared) = &self.shared else { return Ok(()) };
            let commands = shared.session.publisher(&TELEOP_COMMAND)?;
            if commands.readers() == 0 {
                let why =
                    "nobody to hear it: driving needs a multiplexer, as config/teleop.toml has";
                return Err(Error::Fault(why.to_owned()));
            }
            self.commands = Some(commands);
        }
        self.hand.press(now, key);
        Ok(())
    }

    /// The robot is asked to rest, and is free again.
    pub(crate) fn let_go(&mut self) -> Result {
        if self.hand.drives() {
            self.command(clock::now(), Motion::ZERO)?;
        }
        self.hand = Hand::new(FASTEST, Some(PATIENCE));
        self.commands = None;
        Ok(())
    }

    fn command(&mut self, now: Stamp, motion: Motion) -> Result {
        let Some(commands) = &mut self.commands else { return Ok(()) };
        commands.send_with(|command| {
            // A person sees the robot as it is now.
            command.header.stamp = now;
            command.linear = motion.linear;
            command.angular = motion.angular;
        })
    }

    /// A topic has one publisher: it is given back soon.
    fn go_on_arming(&mut self, now: Stamp) -> Result {
        let Some((publisher, has_asked, until)) = &mut self.arming else { return Ok(()) };
        if !*has_asked && 0 < publisher.readers() {
            publisher.send_with(|request| {
                request.header.stamp = now;
                request.arm = 1;
            })?;
            *has_asked = true;
        }
        if *until <= now {
            self.arming = None;
        }
        Ok(())
    }
}

/// The next line that has come, without waiting; where there will be none, the connection is over.
fn next(connection: &mut Option<Connection>) -> Option<Value> {
    match connection.as_mut()?.hear(Some(clock::now())) {
        Ok(Heard::Line(line)) => control::told(&line).ok(),
        Ok(Heard::Nothing) => None,
        Ok(Heard::End) | Err(_) => {
            *connection = None;
            None
        }
    }
}

impl Shared {
    fn look(&mut self, now: Stamp, state: &mut State) -> Result {
        for node in &state.nodes {
            if !self.statuses.iter().any(|(name, _)| *name == node.name) {
                let status = self.session.observer(&STATUS, &node.name)?;
                self.statuses.extend(status.map(|status| (node.name.clone(), status)));
            }
        }
        for (name, status) in &mut self.statuses {
            if let Some(status) = status.latest()? {
                state.hear_node(name, &status);
            }
        }
        self.open(state)?;
        self.taps.iter_mut().try_for_each(|(name, tap)| tap.drain(now, name, state))
    }

    /// Opens what somebody publishes by now. In lock-step the robot is too fast to be watched sample
    /// by sample, and the nodes' own figures have to do.
    fn open(&mut self, state: &State) -> Result {
        if self.clock == Clock::Lockstep {
            return Ok(());
        }
        for port in state.nodes.iter().flat_map(|node| &node.ports) {
            let name = port.topic.as_str();
            let is_open = self.taps.iter().any(|(open, _)| open == name);
            if port.publishes == 1 && !is_open {
                let tap = tap(&self.session, name)?;
                self.taps.extend(tap.map(|tap| (name.to_owned(), tap)));
            }
        }
        // Odometry is put where the newest scan says that the world has not begun anew.
        self.taps.sort_by_key(|(name, _)| name == ODOMETRY.name);
        Ok(())
    }
}

/// A topic, read by one for whom nobody waits.
enum Tap {
    /// Its samples say something, each heard by a part of the state.
    Heard(Box<dyn Listener>),
    /// Only its headers do.
    Counted(Box<dyn Observer>),
}

impl Tap {
    fn drain(&mut self, now: Stamp, name: &str, state: &mut State) -> Result {
        match self {
            Self::Heard(listener) => {
                while let Some(header) = listener.receive(state)? {
                    state.hear_sample(now, name, &header);
                }
            }
            Self::Counted(observer) => {
                while let Some(sample) = observer.receive()? {
                    state.hear_sample(now, name, &sample.header());
                }
            }
        }
        Ok(())
    }
}

/// One who knows the topic's message.
trait Listener {
    /// Takes in the oldest sample that is queued, and returns its header.
    fn receive(&mut self, state: &mut State) -> Result<Option<Header>>;
}

struct ListenerTo<T: Described> {
    samples: Subscriber<T>,
    hear: fn(&mut State, &T),
}

impl<T: Described> Listener for ListenerTo<T> {
    fn receive(&mut self, state: &mut State) -> Result<Option<Header>> {
        let Some(sample) = self.samples.receive()? else { return Ok(None) };
        (self.hear)(state, &sample);
        Ok(Some(*sample.header()))
    }
}

fn tap(session: &Session, name: &str) -> Result<Option<Tap>> {
    fn listen<T: Described>(
        session: &Session,
        topic: &Topic<T>,
        hear: fn(&mut State, &T),
    ) -> Result<Option<Tap>> {
        let samples = session.observer(topic, "")?;
        Ok(samples.map(|samples| Tap::Heard(Box::new(ListenerTo { samples, hear }))))
    }
    if name == SCAN.name {
        listen(session, &SCAN, State::hear_scan)
    } else if name == ODOMETRY.name {
        listen(session, &ODOMETRY, State::hear_odometry)
    } else if name == MOTION_STATE.name {
        listen(session, &MOTION_STATE, State::hear_motion)
    } else {
        Ok(observe::topic(session, name)?.map(Tap::Counted))
    }
}

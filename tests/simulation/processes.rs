//! Odometry, pairing and controller as their processes run them, with queues in place of ports.

use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use controller::{Controller, Pacing, check_age};
use interfaces::VelocityCommand;
use interfaces::topics::{JOINT_STATES, ODOMETRY, SCAN, SENSOR_PAIR};
use interfaces::{Header, JointState, LaserScan, Message, Odometry, SensorPair, Stamp, Topic};
use node::faults::{Faults, FaultyLink};
use node::launch::PairingParameters;
use node::pairing::{ODOMETRIES, SCANS, SensorPairing, write_ticket};
use node::{Lookup, Recent};
use odometry::WheelOdometry;

use super::CORRIDOR_FOLLOWING;
use super::plan::Plan;
use super::referee::Referee;

const LAB_ROBOT: &str = include_str!("../../config/lab_robot.toml");

/// A process, dead or alive.
pub(super) struct Process<P> {
    pub(super) alive: Option<P>,
    /// [-] Of this life, or of the last.
    pub(super) epoch: u32,
    back: Stamp,
    still_until: Stamp,
}

impl<P> Process<P> {
    pub(super) fn new(process: P) -> Self {
        Self { alive: Some(process), epoch: 1, back: Stamp::ZERO, still_until: Stamp::ZERO }
    }

    pub(super) fn kill(&mut self, now: Stamp, away: Duration) {
        self.alive = None;
        self.back = now.after(away);
    }

    pub(super) fn stop(&mut self, now: Stamp, still: Duration) {
        self.still_until = self.still_until.max(now.after(still));
    }

    /// Begins the next life where it is due.
    pub(super) fn revive(&mut self, now: Stamp, begin: impl FnOnce(u32) -> P) {
        if self.alive.is_none() && self.back <= now {
            self.epoch += 1;
            self.still_until = Stamp::ZERO;
            self.alive = Some(begin(self.epoch));
        }
    }

    /// The process, where its loop turns at all.
    pub(super) fn turning(&mut self, now: Stamp) -> Option<&mut P> {
        self.alive.as_mut().filter(|_| self.still_until <= now)
    }
}

/// One end of a topic: numbers what it sends, and sends it on its way.
pub(super) struct Sender<T: Message> {
    link: FaultyLink<T>,
    epoch: u32,
    sequence: u64,
}

impl<T: Message> Sender<T> {
    /// `stream` tells the topics apart.
    pub(super) fn new(plan: &Plan, faults: &Faults, stream: u64, epoch: u32, now: Stamp) -> Self {
        let stream = u64::from(epoch) << 8 | stream;
        let link = FaultyLink::new(&plan.left(faults, now), plan.seed, stream);
        Self { link, epoch, sequence: 0 }
    }

    pub(super) fn send(&mut self, now: Stamp, mut sample: T) {
        let header = sample.header_mut();
        (header.epoch, header.sequence) = (self.epoch, self.sequence);
        self.sequence += 1;
        self.link.push(now, sample);
    }

    /// What leaves now.
    pub(super) fn pop(&mut self, now: Stamp) -> Option<Rc<T>> {
        self.link.pop(now).map(Rc::new)
    }
}

/// The other end: a short queue that keeps the newest, of no older life than it has seen.
pub(super) struct Inbox<T> {
    queue: VecDeque<Rc<T>>,
    depth: usize,
    epoch: u32,
}

impl<T: Message> Inbox<T> {
    fn new(topic: &Topic<T>) -> Self {
        Self { queue: VecDeque::with_capacity(topic.depth + 1), depth: topic.depth, epoch: 0 }
    }

    pub(super) fn push(&mut self, sample: &Rc<T>) {
        self.queue.push_back(Rc::clone(sample));
        if self.depth < self.queue.len() {
            self.queue.pop_front();
        }
    }

    fn receive(&mut self) -> Option<Rc<T>> {
        while let Some(sample) = self.queue.pop_front() {
            let epoch = sample.header().epoch;
            if self.epoch <= epoch {
                self.epoch = epoch;
                return Some(sample);
            }
        }
        None
    }
}

pub(super) struct OdometryProcess {
    core: WheelOdometry,
    sample: Odometry,
    pub(super) joint_states: Inbox<JointState>,
    pub(super) out: Sender<Odometry>,
}

impl OdometryProcess {
    pub(super) fn new(plan: &Plan, epoch: u32, now: Stamp) -> Self {
        Self {
            core: WheelOdometry::new(&odometry::Config::default()),
            sample: Odometry::default(),
            joint_states: Inbox::new(&JOINT_STATES),
            out: Sender::new(plan, &plan.links.odometry, 3, epoch, now),
        }
    }

    pub(super) fn turn(&mut self, now: Stamp) {
        while let Some(wheels) = self.joint_states.receive() {
            if self.core.update(&wheels, &mut self.sample).is_ok() {
                self.out.send(now, self.sample);
            }
        }
    }
}

pub(super) struct PairingProcess {
    core: SensorPairing,
    pub(super) scans: Inbox<LaserScan>,
    pub(super) odometry: Inbox<Odometry>,
    pub(super) out: Sender<SensorPair>,
}

impl PairingProcess {
    pub(super) fn new(plan: &Plan, epoch: u32, now: Stamp) -> Self {
        let mut launch: toml::Table = toml::from_str(LAB_ROBOT).unwrap();
        let parameters: PairingParameters = launch.remove("pairing").unwrap().try_into().unwrap();
        Self {
            core: SensorPairing::new(&parameters.config()).unwrap(),
            scans: Inbox::new(&SCAN),
            odometry: Inbox::new(&ODOMETRY),
            out: Sender::new(plan, &plan.links.tickets, 4, epoch, now),
        }
    }

    pub(super) fn turn(&mut self, now: Stamp) {
        while let Some(scan) = self.scans.receive() {
            self.push(now, SCANS, &scan.header);
        }
        while let Some(odometry) = self.odometry.receive() {
            self.push(now, ODOMETRIES, &odometry.header);
        }
        for pair in self.core.poll(now).pairs() {
            send_ticket(&mut self.out, &pair, now);
        }
    }

    fn push(&mut self, now: Stamp, topic: usize, header: &Header) {
        for pair in self.core.push(topic, header, now).pairs() {
            send_ticket(&mut self.out, &pair, now);
        }
    }
}

fn send_ticket(out: &mut Sender<SensorPair>, pair: &node::pairing::Pair<'_>, now: Stamp) {
    let mut ticket = SensorPair::default();
    write_ticket(pair, now, &mut ticket);
    out.send(now, ticket);
}

pub(super) struct ControllerProcess {
    core: Controller,
    pacing: Pacing,
    period: Duration,
    due: Stamp,
    age_max: Duration,
    /// The ticket that waits for its samples, or that the next period is driven by.
    newest: Option<SensorPair>,
    pub(super) tickets: Inbox<SensorPair>,
    pub(super) scans: Inbox<LaserScan>,
    pub(super) odometry: Inbox<Odometry>,
    recent_scans: Recent<Rc<LaserScan>>,
    recent_odometry: Recent<Rc<Odometry>>,
    pub(super) out: Sender<VelocityCommand>,
}

/// What became of a ticket.
#[derive(PartialEq, Eq)]
enum Answer {
    Driven,
    NotYet,
    Refused,
}

impl ControllerProcess {
    pub(super) fn new(plan: &Plan, epoch: u32, now: Stamp) -> Self {
        let profile: controller::Config = toml::from_str(CORRIDOR_FOLLOWING).unwrap();
        let config = controller::Config { seed: plan.seed, ..profile };
        Self {
            core: Controller::new(&config).unwrap(),
            pacing: plan.pacing,
            period: Duration::from_secs_f64(config.period_s),
            due: now,
            age_max: Duration::from_secs_f64(config.input_age_max_s),
            newest: None,
            tickets: Inbox::new(&SENSOR_PAIR),
            scans: Inbox::new(&SCAN),
            odometry: Inbox::new(&ODOMETRY),
            recent_scans: Recent::new(SCAN.depth),
            recent_odometry: Recent::new(ODOMETRY.depth),
            out: Sender::new(plan, &plan.links.commands, 5, epoch, now),
        }
    }

    pub(super) fn turn(&mut self, now: Stamp, is_armed: bool, referee: &mut Referee) {
        while let Some(scan) = self.scans.receive() {
            self.recent_scans.push(scan);
        }
        while let Some(odometry) = self.odometry.receive() {
            self.recent_odometry.push(odometry);
        }
        match self.pacing {
            Pacing::EveryPair => {
                while let Some(ticket) = self.newest.take().or_else(|| self.next_ticket()) {
                    if self.drive(now, &ticket, is_armed, referee) == Answer::NotYet {
                        self.newest = Some(ticket);
                        break;
                    }
                }
            }
            Pacing::Timer => {
                while let Some(ticket) = self.next_ticket() {
                    self.newest = Some(ticket);
                }
                if self.due <= now {
                    self.due = now.after(self.period);
                    if let Some(ticket) = self.newest
                        && self.drive(now, &ticket, is_armed, referee) == Answer::Refused
                    {
                        self.newest = None;
                    }
                }
            }
        }
    }

    fn next_ticket(&mut self) -> Option<SensorPair> {
        self.tickets.receive().map(|ticket| *ticket)
    }

    fn drive(
        &mut self,
        now: Stamp,
        ticket: &SensorPair,
        is_armed: bool,
        referee: &mut Referee,
    ) -> Answer {
        if check_age(ticket, now, self.age_max).is_err() {
            return Answer::Refused;
        }
        let scan = self.recent_scans.find(ticket.scan_sequence, ticket.scan_epoch);
        let odometry = self.recent_odometry.find(ticket.odometry_sequence, ticket.odometry_epoch);
        let (scan, odometry) = match (scan, odometry) {
            (Lookup::Here(scan), Lookup::Here(odometry)) => (scan, odometry),
            (Lookup::Gone, _) | (_, Lookup::Gone) => return Answer::Refused,
            (Lookup::NotYet, _) | (_, Lookup::NotYet) => return Answer::NotYet,
        };
        match self.core.answer(is_armed, scan, odometry) {
            Ok(command) => {
                referee.sees_sent(now, ticket, &command);
                if is_armed {
                    referee.sees_followed(now, self.out.epoch, ticket, &command);
                }
                self.out.send(now, command);
                Answer::Driven
            }
            Err(_) => Answer::Refused,
        }
    }
}

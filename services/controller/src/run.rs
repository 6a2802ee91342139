//! The process: a pair of samples in, a command out.

use std::time::Duration;

use interfaces::topics::{MOTION_STATE, ODOMETRY, POSE, SCAN, SENSOR_PAIR, VELOCITY_COMMAND};
use interfaces::{
    Header, LaserScan, MotionState, Odometry, Permission, Pose, SensorPair, Stamp, VelocityCommand,
};
use node::config::{self, Place};
use node::{
    Clock, Error, Gauge, Lookup, Node, Publisher, Result, Sample, Settings, Subscriber, Window,
};

use crate::{Config, Controller, Pacing, is_handed_over};

/// Runs the controller as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let (config, controller) = load(node.settings())?;
    let driver = Driver::new(node, controller)?;
    match config.pacing {
        Pacing::EveryPair => every_pair(node, driver),
        Pacing::Timer => on_a_timer(node, driver, Duration::from_secs_f64(config.period_s)),
    }
}

/// Says what is wrong with the parameters, without running anything.
pub fn check(settings: &Settings) -> Result {
    load(settings).map(drop)
}

fn load(settings: &Settings) -> Result<(Config, Controller)> {
    let mut config: Config = settings.parameters()?;
    config.seed = settings.launch().seed;
    if config.pacing == Pacing::Timer && settings.clock() == Clock::Lockstep {
        let message = "a timer paces nothing in lock-step, where time is what the stamps say";
        let help = "run it in real time (--clock realtime), or write \"every_pair\"";
        return Err(config::Error::new(Place::Default, "controller.pacing", message, help).into());
    }
    let controller =
        Controller::new(&config).map_err(|cause| Error::Fault(format!("cannot drive: {cause}")))?;
    Ok((config, controller))
}

/// One command for each pair, as it comes: the lab's simulation.
fn every_pair(node: &mut Node<'_>, mut driver: Driver) -> Result {
    while let Some(tick) = node.tick()? {
        node.wake_by(None);
        while let Some(ticket) = driver.next_ticket()? {
            if !driver.drive(&ticket)? {
                driver.put_back(ticket);
                node.wake_by(Some(tick.now.after(PATIENCE)));
                break;
            }
        }
    }
    Ok(())
}

/// Far longer than a publisher takes from one reader to the next.
const PATIENCE: Duration = Duration::from_millis(1);

/// One command each period, for the newest pair there is: the lab's robot.
fn on_a_timer(node: &mut Node<'_>, mut driver: Driver, period: Duration) -> Result {
    node.set_period(period);
    let mut newest: Option<SensorPair> = None;
    while let Some(tick) = node.tick()? {
        while let Some(ticket) = driver.next_ticket()? {
            newest = Some(ticket);
        }
        // What is older than the pairs' deadline says nothing any more: silence stops the robot.
        newest = newest.filter(|ticket| is_fresh(ticket, tick.now));
        if let Some(ticket) = newest.filter(|_| tick.due) {
            // A sample that has not come yet is there by the next period.
            driver.drive(&ticket)?;
        }
    }
    Ok(())
}

fn is_fresh(ticket: &SensorPair, now: Stamp) -> bool {
    now.since(ticket.formed) <= SENSOR_PAIR.deadline
}

/// What a robot that is held hears: it may move again after a while of commands that begin with
/// zero, and the follower goes on where it was.
fn standstill(stamp: Stamp) -> VelocityCommand {
    VelocityCommand { header: Header { stamp, ..Header::default() }, ..VelocityCommand::default() }
}

/// The follower with its wires.
struct Driver {
    controller: Controller,
    tickets: Subscriber<SensorPair>,
    waiting: Option<SensorPair>,
    scans: Window<LaserScan>,
    odometry: Window<Odometry>,
    poses: Subscriber<Pose>,
    pose: Option<Sample<Pose>>,
    motion_states: Subscriber<MotionState>,
    is_armed: bool,
    commands: Publisher<VelocityCommand>,
    gone: Gauge,
}

impl Driver {
    fn new(node: &mut Node<'_>, controller: Controller) -> Result<Self> {
        Ok(Self {
            controller,
            tickets: node.subscribe(&SENSOR_PAIR)?,
            waiting: None,
            scans: Window::open(node, &SCAN)?,
            odometry: Window::open(node, &ODOMETRY)?,
            poses: node.subscribe_quietly(&POSE)?,
            pose: None,
            motion_states: node.subscribe_quietly(&MOTION_STATE)?,
            is_armed: true,
            commands: node.publish(&VELOCITY_COMMAND)?,
            gone: node.gauge("tickets_whose_sample_is_gone"),
        })
    }

    /// The next ticket, with the samples taken in that came before it.
    fn next_ticket(&mut self) -> Result<Option<SensorPair>> {
        let ticket = match self.waiting.take() {
            Some(ticket) => Some(ticket),
            None => self.tickets.receive()?.map(|ticket| *ticket),
        };
        self.scans.refresh()?;
        self.odometry.refresh()?;
        Ok(ticket)
    }

    /// Keeps a ticket whose samples have not come yet.
    fn put_back(&mut self, ticket: SensorPair) {
        self.waiting = Some(ticket);
    }

    /// Sends the command for the two samples that the ticket names, read where they lie. A sample
    /// that is gone is counted, never guessed. False where one has not come yet.
    fn drive(&mut self, ticket: &SensorPair) -> Result<bool> {
        self.pose = self.poses.latest()?.or(self.pose.take());
        let scan = self.scans.find(ticket.scan_sequence, ticket.scan_epoch);
        let odometry = self.odometry.find(ticket.odometry_sequence, ticket.odometry_epoch);
        let (scan, odometry) = match (scan, odometry) {
            (Lookup::Here(scan), Lookup::Here(odometry)) => (scan, odometry),
            (Lookup::Gone, _) | (_, Lookup::Gone) => {
                self.gone.count();
                return Ok(true);
            }
            (Lookup::NotYet, _) | (_, Lookup::NotYet) => return Ok(false),
        };
        if let Some(state) = self.motion_states.latest()? {
            self.is_armed = state.permission == Permission::Armed as u8;
        }
        let command = if self.is_armed {
            self.controller.update(scan, odometry)
        } else {
            standstill(ticket.header.stamp)
        };
        // Once a localization knows where the robot is, another node drives.
        if !is_handed_over(self.pose.as_deref()) {
            self.commands.send(command)?;
        }
        Ok(true)
    }
}

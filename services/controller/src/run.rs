//! The process: a pair of samples in, a command out.

use std::time::Duration;

use interfaces::topics::{
    AUTONOMY_COMMAND, MOTION_STATE, ODOMETRY, POSE, SCAN, SENSOR_PAIR, VELOCITY_COMMAND,
};
use interfaces::{LaserScan, MotionState, Odometry, Permission, Pose, SensorPair, VelocityCommand};
use node::config::{self, Place};
use node::{
    Clock, Diary, Error, Gauge, Latency, Lookup, Node, Publisher, Refusals, Result, Sample,
    Settings, Subscriber, Tuning, Window,
};

use crate::noted::{NOTED, note};
use crate::{
    Commands, Config, Controller, Pacing, TUNABLES, Unfit, check_age, is_handed_over, standstill,
};

/// Runs the controller as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let (config, controller) = load(node.settings())?;
    let driver = Driver::new(node, controller, &config)?;
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
        if tick.activated {
            driver.waiting = None;
        }
        driver.retune(node)?;
        node.wake_by(None);
        while let Some(ticket) = driver.next_ticket()? {
            if driver.drive(node, &ticket)? == Answer::NotYet {
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

/// One command each period, for the newest pair there is, until that is too old: the lab's robot.
fn on_a_timer(node: &mut Node<'_>, mut driver: Driver, period: Duration) -> Result {
    node.set_period(period);
    let mut newest: Option<SensorPair> = None;
    while let Some(tick) = node.tick()? {
        if tick.activated {
            newest = None;
        }
        driver.retune(node)?;
        while let Some(ticket) = driver.next_ticket()? {
            newest = Some(ticket);
        }
        if let Some(ticket) = newest.filter(|_| tick.due) {
            // A sample that has not come yet is there by the next period.
            if driver.drive(node, &ticket)? == Answer::Refused {
                newest = None;
            }
        }
    }
    Ok(())
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
    clock: Clock,
    age: Option<Latency>,
    age_max: Duration,
    gone: Gauge,
    refusals: Refusals,
    diary: Diary,
    tuning: Tuning<Config>,
}

/// What became of a ticket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// The robot is driven by it.
    Driven,
    /// One of its samples has not come yet.
    NotYet,
    /// It says nothing about where to drive.
    Refused,
}

impl Driver {
    fn new(node: &mut Node<'_>, controller: Controller, config: &Config) -> Result<Self> {
        let commands = match config.commands {
            Commands::CmdVel => &VELOCITY_COMMAND,
            Commands::AutonomyCmdVel => &AUTONOMY_COMMAND,
        };
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
            commands: node.publish(commands)?,
            clock: node.clock(),
            age: (node.clock() == Clock::Realtime).then(|| node.latency("age")),
            age_max: Duration::from_secs_f64(config.input_age_max_s),
            gone: node.gauge("tickets_whose_sample_is_gone"),
            refusals: Refusals::new(node, "unfit", Unfit::ALL.map(Unfit::label)),
            diary: node.diary(&NOTED),
            tuning: node.tuning(config.clone(), &TUNABLES)?,
        })
    }

    /// Goes on by what was changed, if something was.
    fn retune(&mut self, node: &Node<'_>) -> Result {
        let Some(config) = self.tuning.take(node)? else { return Ok(()) };
        let retuned = self.controller.retune(config);
        retuned.map_err(|cause| Error::Fault(format!("cannot drive: {cause}")))
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
    /// that is gone is counted, never guessed.
    fn drive(&mut self, node: &mut Node<'_>, ticket: &SensorPair) -> Result<Answer> {
        self.pose = self.poses.latest()?.or(self.pose.take());
        // Read after the samples have come, or an honest stamp might lie ahead of it. Lock-step knows
        // no age.
        let in_time = match self.clock {
            Clock::Lockstep => Ok(()),
            Clock::Realtime => check_age(ticket, node::clock::now(), self.age_max),
        };
        if let Err(unfit) = in_time {
            return self.refuse(node, ticket, unfit);
        }

        let scan = self.scans.find(ticket.scan_sequence, ticket.scan_epoch);
        let odometry = self.odometry.find(ticket.odometry_sequence, ticket.odometry_epoch);
        let (scan, odometry) = match (scan, odometry) {
            (Lookup::Here(scan), Lookup::Here(odometry)) => (scan, odometry),
            (Lookup::Gone, _) | (_, Lookup::Gone) => {
                self.gone.count();
                return Ok(Answer::Refused);
            }
            (Lookup::NotYet, _) | (_, Lookup::NotYet) => return Ok(Answer::NotYet),
        };
        if let Some(state) = self.motion_states.latest()? {
            self.is_armed = state.permission == Permission::Armed as u8;
        }
        match self.controller.answer(self.is_armed, scan, odometry) {
            Ok(command) => {
                note(&self.diary, scan, self.controller.activity(), &command);
                if self.refusals.accept() {
                    node.say("drives again");
                }
                self.send(command)?;
                Ok(Answer::Driven)
            }
            Err(unfit) => self.refuse(node, ticket, unfit),
        }
    }

    /// Sends nothing: whoever drives the wheels stops them where commands cease. Only in lock-step,
    /// where the world waits for each command, that is to stand still.
    fn refuse(&mut self, node: &mut Node<'_>, ticket: &SensorPair, unfit: Unfit) -> Result<Answer> {
        if self.refusals.refuse(unfit as usize) {
            node.say(&format!("gives no command: {unfit}"));
        }
        if self.clock == Clock::Lockstep {
            self.send(standstill(ticket.header.stamp))?;
        }
        Ok(Answer::Refused)
    }

    fn send(&mut self, command: VelocityCommand) -> Result {
        // Once a localization knows where the robot is, another node drives.
        if is_handed_over(self.pose.as_deref()) {
            return Ok(());
        }
        let stamp = command.header.stamp;
        self.commands.send(command)?;
        if let Some(age) = &self.age {
            age.record(node::clock::now().since(stamp));
        }
        Ok(())
    }
}

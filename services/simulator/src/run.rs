//! The process: a command in, one step of the world, what the sensors see out.

use std::time::Duration;

use interfaces::topics::{JOINT_STATES, POSE, ROBOT_POSE, SCAN};
use interfaces::{JointState, LaserScan, Outcome, Pose, Stamp};
use node::config::{self, Layers, Place};
use node::deadman::Motion;
use node::launch::Until;
use node::{
    Clock, Diary, Error, Gauge, Latency, Node, Publisher, Result, Settings, Subscriber, Tuning,
    Wheels,
};

use crate::{Config, Simulator, TUNABLES, World};

/// In lock-step one lost command stalls everything: better to end and say so.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(10);

/// Runs the simulator as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let (config, simulator) = load(node.settings())?;
    let robot = Robot::new(node, simulator, &config)?;
    match node.clock() {
        Clock::Lockstep => lockstep(node, robot),
        Clock::Realtime => realtime(node, robot, &config),
    }
}

/// Says what is wrong with the parameters and the world, without running anything.
pub fn check(settings: &Settings) -> Result {
    load(settings).map(drop)
}

fn load(settings: &Settings) -> Result<(Config, Simulator)> {
    let mut config: Config = settings.parameters()?;
    config.seed = settings.launch().seed;
    if settings.clock() == Clock::Realtime {
        config.substeps = substeps(config.dt_s);
    }
    let world: World = Layers::new().named(&config.world).parse()?;
    let simulator = Simulator::new(&config, &world).map_err(|error| misfit(&config, &error))?;
    Ok((config, simulator))
}

/// In real time the wheels are driven at least this often, whatever the measurements' period.
const STEP_MAX: Duration = Duration::from_millis(10);

/// [-] The fewest equal steps of a period that are short enough.
fn substeps(dt: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
    let steps = (dt / STEP_MAX.as_secs_f64() - 1e-9).ceil().max(1.0) as u32;
    steps
}

/// The world and the configuration do not fit each other.
fn misfit(config: &Config, error: &crate::Error) -> Error {
    let (key, help) = match error {
        crate::Error::Config(error) => (error.key(), "mend the simulator's parameters"),
        crate::Error::World(error) => (error.key(), error.help()),
    };
    let place = Place::File(config.world.path().to_owned());
    config::Error::new(place, key, error.to_string(), help).into()
}

/// The world waits for each command, and advances one period with it.
fn lockstep(node: &mut Node<'_>, mut robot: Robot) -> Result {
    while let Some(tick) = node.tick()? {
        if tick.activated {
            robot.wheels.restart();
            robot.report_rest(None)?;
            // A first step at rest sets the loop going.
            robot.step_in_time(Motion::ZERO)?;
            robot.sense(None, tick.now)?;
            node.hold();
        }
        robot.wheels.attend(node, tick.now, robot.simulator.time())?;
        while let Some((_, verdict)) = robot.wheels.hear(robot.simulator.time())? {
            if verdict.is_ok() {
                robot.age.record(tick.now.since(robot.sensed));
            }
            let motion = robot.wheels.motion(robot.simulator.time())?;
            robot.step_in_time(motion)?;
            // Everything sent so far has come to its reader: the one moment at which to pause.
            node.release();
            if robot.finish_if_ended(node)? || node.leaving()? {
                break;
            }
            robot.sense(None, tick.now)?;
            node.hold();
        }
        if !robot.has_ended && COMMAND_TIMEOUT < tick.now.since(robot.sensed) {
            let waited = COMMAND_TIMEOUT.as_secs();
            return Err(Error::Fault(format!("no command for {waited} s in lock-step")));
        }
    }
    Ok(())
}

/// The world moves on by itself, as the dead-man lets the newest command move it.
fn realtime(node: &mut Node<'_>, mut robot: Robot, config: &Config) -> Result {
    let mut pace = Pace::new(config);
    node.set_period(pace.step);
    while let Some(tick) = node.tick()? {
        if tick.activated {
            robot.wheels.restart();
            robot.report_rest(Some(tick.now))?;
            pace.start(tick.now);
        }
        robot.retune(node)?;
        robot.wheels.attend(node, tick.now, tick.now)?;
        while let Some((command, verdict)) = robot.wheels.hear(tick.now)? {
            if verdict.is_ok() {
                robot.age.record(tick.now.since(command.header.stamp));
            }
        }
        // Whoever lets go of the wheels stops them first.
        let motion = robot.wheels.motion(tick.now)?;
        node.wake_by(robot.wheels.due());
        if robot.has_ended || robot.wheels.is_at_rest(tick.now) {
            node.release();
        } else {
            node.hold();
        }
        if robot.has_ended {
            continue;
        }
        for _ in 0..pace.steps_until(tick.now) {
            robot.step(motion);
        }
        if !robot.finish_if_ended(node)? && pace.is_time_to_sense() {
            robot.sense(Some(tick.now), tick.now)?;
        }
    }
    Ok(())
}

/// How many steps the world is behind the clock, and when it is time to measure.
struct Pace {
    step: Duration,
    substeps: u32,
    due: Stamp,
    unsensed: u32,
}

impl Pace {
    fn new(config: &Config) -> Self {
        let step = Duration::from_secs_f64(config.dt_s / f64::from(config.substeps));
        Self { step, substeps: config.substeps, due: Stamp::ZERO, unsensed: 0 }
    }

    fn start(&mut self, now: Stamp) {
        self.due = now;
        // The first turn measures.
        self.unsensed = self.substeps - 1;
    }

    /// What a busy machine held up is caught up with; where this process was stopped, the world was.
    fn steps_until(&mut self, now: Stamp) -> u32 {
        let mut steps = 0;
        while self.due <= now && steps < 2 * self.substeps {
            self.due = self.due.after(self.step);
            steps += 1;
        }
        if self.due <= now {
            self.due = now.after(self.step);
        }
        self.unsensed += steps;
        steps
    }

    fn is_time_to_sense(&mut self) -> bool {
        let is_time = self.substeps <= self.unsensed;
        if is_time {
            self.unsensed %= self.substeps;
        }
        is_time
    }
}

/// What is noted of each measurement, for the report of a run.
const NOTED: [&str; 6] = ["x_m", "y_m", "yaw_rad", "clearance_m", "linear_m_s", "angular_rad_s"];

/// The simulated robot with its wires.
struct Robot {
    simulator: Simulator,
    until: Option<Until>,
    for_s: Option<f64>,
    stop_at_collision: bool,
    has_ended: bool,
    sensed: Stamp,
    joint_states: Option<Publisher<JointState>>,
    poses: Option<Publisher<Pose>>,
    scans: Publisher<LaserScan>,
    wheels: Wheels,
    estimates: Subscriber<Pose>,
    was_localized: bool,
    age: Latency,
    gauges: Gauges,
    /// Of the last step.
    motion: Motion,
    diary: Diary,
    tuning: Tuning<Config>,
}

impl Robot {
    fn new(node: &mut Node<'_>, simulator: Simulator, config: &Config) -> Result<Self> {
        let launch = node.settings().launch();
        let (until, for_s) = (launch.until, launch.for_s);
        let (joint_states, poses) = if config.reports_pose {
            (None, Some(node.publish(&ROBOT_POSE)?))
        } else {
            (Some(node.publish(&JOINT_STATES)?), None)
        };
        let gauges = Gauges::new(node);
        gauges.set(&simulator);
        Ok(Self {
            simulator,
            until,
            for_s,
            stop_at_collision: config.stop_at_collision,
            has_ended: false,
            sensed: Stamp::ZERO,
            joint_states,
            poses,
            scans: node.publish(&SCAN)?,
            wheels: Wheels::new(node, &config.deadman)?,
            estimates: node.subscribe_quietly(&POSE)?,
            was_localized: false,
            age: node.latency_by_steps("scan_to_command"),
            gauges,
            motion: Motion::ZERO,
            diary: node.diary(&NOTED),
            tuning: node.tuning(config.clone(), &TUNABLES)?,
        })
    }

    /// Goes on by what was changed, if something was.
    fn retune(&mut self, node: &Node<'_>) -> Result {
        if let Some(config) = self.tuning.take(node)? {
            self.simulator.set_noise(config.lidar.noise);
            self.stop_at_collision = config.stop_at_collision;
        }
        Ok(())
    }

    /// One step of driving; the estimated pose is compared before, as the lab does.
    fn step(&mut self, motion: Motion) {
        self.check_estimate();
        self.simulator.step(motion.linear, motion.angular);
        self.gauges.set(&self.simulator);
        self.motion = motion;
    }

    /// The same in lock-step: what the dead-man does by the end of the step is told before the scan of
    /// it. Told later, it would race with the answer to that scan, and no two runs were the same.
    fn step_in_time(&mut self, motion: Motion) -> Result {
        self.step(motion);
        self.wheels.motion(self.simulator.time()).map(drop)
    }

    fn check_estimate(&mut self) {
        let Ok(Some(estimate)) = self.estimates.latest() else { return };
        let error = self.simulator.check_estimate(&estimate);
        self.gauges.position_error.set(error.position);
        self.gauges.heading_error.set(error.heading);
        let is_localized = estimate.localized == 1;
        if is_localized && !self.was_localized {
            tracing::warn!(
                x = estimate.x,
                y = estimate.y,
                yaw = estimate.yaw,
                position_error = error.position,
                heading_error = error.heading,
                within = error.within,
                "localized"
            );
        }
        self.was_localized = is_localized;
    }

    /// The reference that a difference of poses begins with, before the first step.
    fn report_rest(&mut self, stamp: Option<Stamp>) -> Result {
        self.report_pose(stamp)
    }

    /// Publishes what the sensors see: the wheels or the pose, then the scan. `stamp` is simulated
    /// time where it is not given.
    fn sense(&mut self, stamp: Option<Stamp>, now: Stamp) -> Result {
        self.note(stamp.unwrap_or_else(|| self.simulator.time()));
        let simulator = &mut self.simulator;
        if let Some(joint_states) = &mut self.joint_states {
            joint_states.send_with(|joints| {
                simulator.fill_joint_state(joints);
                joints.header.stamp = stamp.unwrap_or(joints.header.stamp);
            })?;
        }
        self.report_pose(stamp)?;
        self.sensed = now;
        let simulator = &mut self.simulator;
        self.scans.send_with(|scan| {
            simulator.sense(scan);
            scan.header.stamp = stamp.unwrap_or(scan.header.stamp);
        })
    }

    /// Where the robot really is: for the report of the run, and for nobody else.
    fn note(&self, stamp: Stamp) {
        let place = self.simulator.world_from_base();
        let (x, y) = (place.translation.x, place.translation.y);
        let (yaw, clearance) = (place.rotation.angle(), self.simulator.clearance());
        self.diary.note(stamp, [x, y, yaw, clearance, self.motion.linear, self.motion.angular]);
    }

    fn report_pose(&mut self, stamp: Option<Stamp>) -> Result {
        let Some(poses) = &mut self.poses else { return Ok(()) };
        let world_from_base = self.simulator.world_from_base();
        let time = self.simulator.time();
        poses.send_with(|pose| {
            pose.header.stamp = stamp.unwrap_or(time);
            pose.x = world_from_base.translation.x;
            pose.y = world_from_base.translation.y;
            pose.yaw = world_from_base.rotation.angle();
        })
    }

    /// Says so, once, where the run has come to its end.
    fn finish_if_ended(&mut self, node: &mut Node<'_>) -> Result<bool> {
        if self.has_ended {
            return Ok(true);
        }
        let Some((outcome, why)) = self.ending() else { return Ok(false) };
        self.has_ended = true;
        node.finish(outcome, &why)?;
        Ok(true)
    }

    fn ending(&self) -> Option<(Outcome, String)> {
        let simulator = &self.simulator;
        let time = simulator.time().seconds();
        let progress = simulator.progress();
        // Only at the end: it takes memory, and the more the longer the run.
        let cells = || progress.path();
        if self.stop_at_collision && 0 < simulator.collisions() {
            let position = simulator.world_from_base().translation;
            let (x, y) = (position.x, position.y);
            let cells = cells();
            let why = format!(
                "touched a wall at x {x:.3} m, y {y:.3} m after {time:.2} s, cells {cells}"
            );
            return Some((Outcome::Failed, why));
        }
        match self.until {
            Some(Until::RoundTrip) if progress.is_round_trip() => {
                return Some((Outcome::Done, format!("round trip, cells {}", cells())));
            }
            Some(Until::Goal) if simulator.is_goal_reached() => {
                return Some((Outcome::Done, "goal reached".to_owned()));
            }
            Some(Until::RoundTrip | Until::Goal) | None => {}
        }
        let limit = self.for_s.filter(|&limit| limit <= time + TIME_TINY)?;
        let path = cells();
        Some(match self.until {
            None => (Outcome::Done, format!("{limit} s are over, cells {path}")),
            Some(Until::RoundTrip) => {
                (Outcome::Failed, format!("{limit} s are over, no round trip, cells {path}"))
            }
            Some(Until::Goal) => {
                (Outcome::Failed, format!("{limit} s are over, no goal, cells {path}"))
            }
        })
    }
}

/// [s] Far less than a period: what sums of periods are off by.
const TIME_TINY: f64 = 1e-9;

/// What the simulator knows about the run, for whoever looks at the node's status.
struct Gauges {
    simulated: Gauge,
    steps: Gauge,
    distance: Gauge,
    clearance: Gauge,
    clearance_min: Gauge,
    collisions: Gauge,
    commands_limited: Gauge,
    cells: Gauge,
    cells_out: Gauge,
    cells_back: Gauge,
    position_error: Gauge,
    heading_error: Gauge,
}

impl Gauges {
    fn new(node: &mut Node<'_>) -> Self {
        Self {
            simulated: node.gauge("simulated_s"),
            steps: node.gauge("steps"),
            distance: node.gauge("distance_m"),
            clearance: node.gauge("clearance_m"),
            clearance_min: node.gauge("clearance_min_m"),
            collisions: node.gauge("collisions"),
            commands_limited: node.gauge("commands_limited"),
            cells: node.gauge("cells"),
            cells_out: node.gauge("cells_out"),
            cells_back: node.gauge("cells_back"),
            position_error: node.gauge("estimate_error_m"),
            heading_error: node.gauge("estimate_error_rad"),
        }
    }

    fn set(&self, simulator: &Simulator) {
        let progress = simulator.progress();
        self.simulated.set(simulator.time().seconds());
        self.steps.set(simulator.steps() as f64);
        self.distance.set(simulator.distance());
        self.clearance.set(simulator.clearance());
        self.clearance_min.set(simulator.clearance_min());
        self.collisions.set(simulator.collisions() as f64);
        self.commands_limited.set(simulator.commands_limited() as f64);
        self.cells.set(progress.cells() as f64);
        self.cells_out.set(progress.reached() as f64);
        self.cells_back.set((progress.visited().len() - progress.reached()) as f64);
    }
}

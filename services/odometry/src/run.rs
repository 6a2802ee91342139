//! The process: one measurement in, one odometry sample out.

use interfaces::Odometry;
use interfaces::topics::{IMU, JOINT_STATES, ODOMETRY, ROBOT_POSE};
use node::{Clock, Diary, Gauge, Node, Refusals, Result, Settings};

use crate::{Config, Heading, Headings, PoseOdometry, Rejected, Source, TUNABLES, WheelOdometry};

/// Runs odometry as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let config: Config = node.parameters()?;
    match config.source {
        Source::Wheels => from_wheels(node, &config),
        Source::Poses => from_poses(node, &config),
    }
}

/// Says what is wrong with the parameters, without running anything.
pub fn check(settings: &Settings) -> Result {
    settings.parameters::<Config>().map(drop)
}

fn from_wheels(node: &mut Node<'_>, config: &Config) -> Result {
    let mut wheels = node.subscribe(&JOINT_STATES)?;
    // A heading is there before its wheels, which alone wake this node.
    let mut gyro = match config.heading {
        Heading::Wheels => None,
        Heading::Gyro => Some(node.subscribe_quietly(&IMU)?),
    };
    let mut headings = Headings::default();
    let mut odometry = node.publish(&ODOMETRY)?;
    let mut gauges = Gauges::new(node);
    let age = (node.clock() == Clock::Realtime).then(|| node.latency("age"));
    let mut core = WheelOdometry::new(config);
    let mut tuning = node.tuning(*config, &TUNABLES)?;
    let mut sample = Odometry::default();
    while node.tick()?.is_some() {
        if let Some(config) = tuning.take(node)? {
            core.retune(config);
        }
        while let Some(wheels) = wheels.receive()? {
            while let Some(imu) = gyro.as_mut().map_or(Ok(None), node::Subscriber::receive)? {
                headings.keep(&imu);
            }
            let heading = headings.find(wheels.header.stamp);
            match core.update_with(&wheels, heading, &mut sample) {
                Ok(()) => {
                    gauges.accept(node, &sample);
                    odometry.send(sample)?;
                    if let Some(age) = &age {
                        age.record(node::clock::now().since(wheels.header.stamp));
                    }
                }
                Err(rejected) => gauges.reject(node, rejected),
            }
        }
        gauges.rebases.set(core.rebases() as f64);
    }
    Ok(())
}

fn from_poses(node: &mut Node<'_>, config: &Config) -> Result {
    let mut poses = node.subscribe(&ROBOT_POSE)?;
    let mut odometry = node.publish(&ODOMETRY)?;
    let mut gauges = Gauges::new(node);
    let mut core = PoseOdometry::new(config);
    let mut tuning = node.tuning(*config, &TUNABLES)?;
    let mut sample = Odometry::default();
    while node.tick()?.is_some() {
        if let Some(config) = tuning.take(node)? {
            core.retune(config);
        }
        while let Some(reported) = poses.receive()? {
            match core.update(&reported, &mut sample) {
                Ok(true) => {
                    gauges.accept(node, &sample);
                    odometry.send(sample)?;
                }
                Ok(false) => {}
                Err(rejected) => gauges.reject(node, rejected),
            }
        }
        gauges.rebases.set(core.rebases() as f64);
    }
    Ok(())
}

/// What a pose is told by.
const POSE: [&str; 3] = ["x_m", "y_m", "yaw_rad"];

/// Where the robot believes to be and what it did not believe, for whoever looks at the node's
/// status.
struct Gauges {
    pose: [Gauge; 3],
    diary: Diary,
    rebases: Gauge,
    refusals: Refusals,
}

impl Gauges {
    fn new(node: &mut Node<'_>) -> Self {
        Self {
            pose: POSE.map(|key| node.gauge(key)),
            diary: node.diary(&POSE),
            rebases: node.gauge("rebases"),
            refusals: Refusals::new(node, "rejected", Rejected::ALL.map(Rejected::label)),
        }
    }

    fn accept(&mut self, node: &mut Node<'_>, odometry: &Odometry) {
        if self.refusals.accept() {
            node.say("measures again");
        }
        let [x, y, yaw] = &self.pose;
        x.set(odometry.x);
        y.set(odometry.y);
        yaw.set(odometry.yaw);
        self.diary.note(odometry.header.stamp, [odometry.x, odometry.y, odometry.yaw]);
    }

    fn reject(&mut self, node: &mut Node<'_>, rejected: Rejected) {
        if self.refusals.refuse(rejected as usize) {
            node.say(&format!("publishes nothing: {rejected}"));
        }
    }
}

//! The process: one measurement in, one odometry sample out.

use interfaces::Odometry;
use interfaces::topics::{JOINT_STATES, ODOMETRY, ROBOT_POSE};
use node::{Gauge, Node, Result, Settings};

use crate::{Config, PoseOdometry, Source, WheelOdometry};

/// Runs odometry as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let config: Config = node.parameters()?;
    match config.source {
        Source::Wheels => from_wheels(node, &config),
        Source::Poses => from_poses(node),
    }
}

/// Says what is wrong with the parameters, without running anything.
pub fn check(settings: &Settings) -> Result {
    settings.parameters::<Config>().map(drop)
}

fn from_wheels(node: &mut Node<'_>, config: &Config) -> Result {
    let mut wheels = node.subscribe(&JOINT_STATES)?;
    let mut odometry = node.publish(&ODOMETRY)?;
    let pose = PoseGauges::new(node);
    let mut core = WheelOdometry::new(config);
    let mut sample = Odometry::default();
    while node.tick()?.is_some() {
        while let Some(wheels) = wheels.receive()? {
            if core.update(&wheels, &mut sample) {
                pose.set(&sample);
                odometry.send(sample)?;
            }
        }
    }
    Ok(())
}

fn from_poses(node: &mut Node<'_>) -> Result {
    let mut poses = node.subscribe(&ROBOT_POSE)?;
    let mut odometry = node.publish(&ODOMETRY)?;
    let pose = PoseGauges::new(node);
    let mut core = PoseOdometry::default();
    let mut sample = Odometry::default();
    while node.tick()?.is_some() {
        while let Some(reported) = poses.receive()? {
            if core.update(&reported, &mut sample) {
                pose.set(&sample);
                odometry.send(sample)?;
            }
        }
    }
    Ok(())
}

/// Where the robot believes to be, for whoever looks at the node's status.
struct PoseGauges([Gauge; 3]);

impl PoseGauges {
    fn new(node: &mut Node<'_>) -> Self {
        Self(["x_m", "y_m", "yaw_rad"].map(|key| node.gauge(key)))
    }

    fn set(&self, odometry: &Odometry) {
        let [x, y, yaw] = &self.0;
        x.set(odometry.x);
        y.set(odometry.y);
        yaw.set(odometry.yaw);
    }
}

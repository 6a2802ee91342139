//! What odometry can be told; the defaults are the lab's simulation.

use std::time::Duration;

use node::Tunable;
use node::config::{Parameters, Report};
use serde::{Deserialize, Serialize};

/// Which measurement, and the robot's geometry.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What the robot reports.
    pub source: Source,
    /// Where the heading comes from, if the robot reports its wheels.
    pub heading: Heading,
    /// Which way a robot turns whose right wheel is faster than its left.
    pub faster_right: Turning,
    /// [m] Radius of a wheel.
    pub wheel_radius_m: f64,
    /// [m] Between the two wheels.
    pub track_m: f64,
    /// [m] Where in `odom` the robot starts.
    pub x_m: f64,
    /// [m] Where in `odom` the robot starts.
    pub y_m: f64,
    /// [rad] How the robot stands in `odom` when it starts.
    pub yaw_rad: f64,
    /// [rad/s] No wheel turns faster: what says so is a fault. Poses are judged by it too, with the
    /// geometry.
    pub wheel_speed_max_rad_s: f64,
    /// [s] Measurements that are farther apart do not tell what was between them.
    pub stamp_gap_max_s: f64,
}

/// What the robot reports about its motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Wheel angles, on `joint_states`: pose and velocity by forward kinematics.
    #[default]
    Wheels,
    /// Only a pose, on `robot_pose`: velocity by differencing.
    Poses,
}

/// Where the heading comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Heading {
    /// The wheels' difference: exact until one slips.
    #[default]
    Wheels,
    /// The orientation on `imu`, where there is one with the wheels' stamp; else the wheels. It does
    /// not notice slipping wheels, and drifts.
    Gyro,
}

/// Which way something turns, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Turning {
    /// To the left, as it should be.
    #[default]
    Counterclockwise,
    /// To the right: the wheels are told in the wrong order.
    Clockwise,
}

impl Turning {
    /// [-] Of its angles.
    pub(crate) const fn sign(self) -> f64 {
        match self {
            Self::Counterclockwise => 1.0,
            Self::Clockwise => -1.0,
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            source: Source::Wheels,
            heading: Heading::Wheels,
            faster_right: Turning::Counterclockwise,
            wheel_radius_m: 0.033,
            track_m: 0.160,
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
            // 1 m/s on a Burger, more than four times what its wheels can do: stamps that are off by
            // most of a period make no fault of an honest wheel.
            wheel_speed_max_rad_s: 30.0,
            // Twenty of the lab's periods: a restart of the publisher is a matter of epochs, a
            // second without measurements one of luck.
            stamp_gap_max_s: 1.0,
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        for (key, length) in [("wheel_radius_m", self.wheel_radius_m), ("track_m", self.track_m)] {
            if length <= 0.0 {
                report.refuse(key, "is no length", "give metres above zero");
            } else if !LENGTHS.contains(&length) {
                report.refuse(key, "is no robot's", "give metres, from 0.001 to 1000");
            }
        }
        let speed = self.wheel_speed_max_rad_s;
        if !(0.0 < speed && speed <= WHEEL_SPEED_MAX) {
            let key = "wheel_speed_max_rad_s";
            report.refuse(key, "is no wheel's", "give rad/s, above zero and up to 10000");
        }
        let gap = self.stamp_gap_max_s;
        if !(0.0 < gap && gap <= GAP_MAX) {
            let help = "give seconds, above zero and up to 60";
            report.refuse("stamp_gap_max_s", "is no gap between measurements", help);
        }
    }
}

/// [m] From a toy's wheel to a mine's lorry, and some more: quotients of two stay finite.
const LENGTHS: std::ops::RangeInclusive<f64> = 0.001..=1_000.0;

/// [rad/s] A turbine.
const WHEEL_SPEED_MAX: f64 = 10_000.0;

/// [s] After a minute nobody knows where a robot has been meanwhile.
const GAP_MAX: f64 = 60.0;

/// What may be changed while the robot drives: its measures, for one who calibrates it, and what is taken
/// for a fault. What it measures, and where it started, may not.
pub static TUNABLES: [Tunable; 3] = [
    Tunable::number("wheel_radius_m", 0.01..=0.2),
    Tunable::number("track_m", 0.05..=1.0),
    Tunable::number("wheel_speed_max_rad_s", 5.0..=100.0),
];

impl Config {
    /// How far measurements may be apart.
    pub(crate) fn stamp_gap_max(&self) -> Duration {
        Duration::from_secs_f64(self.stamp_gap_max_s)
    }
}

//! What odometry can be told; the defaults are the lab's simulation.

use node::config::{Parameters, Report};
use serde::Deserialize;

/// Which measurement, and the robot's geometry.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What the robot reports.
    pub source: Source,
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
}

/// What the robot reports about its motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Wheel angles, on `joint_states`: pose and velocity by forward kinematics.
    #[default]
    Wheels,
    /// Only a pose, on `robot_pose`: velocity by differencing.
    Poses,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            source: Source::Wheels,
            wheel_radius_m: 0.033,
            track_m: 0.160,
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        for (key, length) in [("wheel_radius_m", self.wheel_radius_m), ("track_m", self.track_m)] {
            if length <= 0.0 {
                report.refuse(key, "is no length", "give metres above zero");
            }
        }
    }
}

//! What the robot is and how it is simulated; the defaults are the lab's.

use std::fmt;

use interfaces::BEAMS_MAX;
use node::config::{FileName, Parameters, Report};
use node::{Tunable, deadman};
use serde::{Deserialize, Serialize};

use crate::{Noise, WheelLimit};

/// The robot, its start and its goal.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The world's file.
    pub world: FileName,
    /// [-] Which of the world's starts.
    pub start: String,
    /// [-] What everything random is derived from: the launch file's.
    #[serde(skip)]
    pub seed: u64,
    /// [s] Between two measurements.
    pub dt_s: f64,
    /// [-] Steps of the world between two measurements: one, unless the world moves by itself.
    #[serde(skip)]
    pub substeps: u32,
    /// [m] Radius of a wheel.
    pub wheel_radius_m: f64,
    /// [m] Between the two wheels.
    pub track_m: f64,
    /// [-] What happens to a command that asks too much of a wheel.
    pub wheel_limit: WheelLimit,
    /// [rad/s] More no wheel does.
    pub wheel_speed_max_rad_s: f64,
    /// [m] Radius of the robot, a disc about the middle of its axle.
    pub robot_radius_m: f64,
    /// The LiDAR.
    pub lidar: LidarConfig,
    /// [m] Where the robot shall come to, if anywhere.
    pub goal_m: Option<[f64; 2]>,
    /// [m] So far from the goal, or from the truth, is still there.
    pub position_tolerance_m: f64,
    /// [rad] So far from the true heading is still right.
    pub heading_tolerance_rad: f64,
    /// [-] Whether the run ends where the robot touches a wall.
    pub stop_at_collision: bool,
    /// [-] Whether the robot reports its pose instead of its wheels.
    pub reports_pose: bool,
    /// Which commands may drive the wheels, and what stops them.
    pub deadman: deadman::Config,
}

/// The LiDAR and where it sits.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarConfig {
    /// [-] In one turn, at most [`BEAMS_MAX`].
    pub beams: usize,
    /// [m] Nearer walls are too close to measure.
    pub range_min_m: f64,
    /// [m] Farther walls are not seen.
    pub range_max_m: f64,
    /// [m] Ahead of the axle; negative is behind.
    pub sensor_x_m: f64,
    /// [-] How far measurements are from the truth.
    pub noise: Noise,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            world: FileName::from("config/worlds/lab02.toml"),
            start: "outer".into(),
            seed: 1,
            dt_s: 0.05,
            substeps: 1,
            wheel_radius_m: 0.033,
            track_m: 0.160,
            wheel_limit: WheelLimit::Hold,
            wheel_speed_max_rad_s: 0.22 / 0.033,
            robot_radius_m: 0.105,
            lidar: LidarConfig::default(),
            goal_m: None,
            position_tolerance_m: 0.1,
            heading_tolerance_rad: 10_f64.to_radians(),
            stop_at_collision: true,
            reports_pose: false,
            deadman: deadman::Config::default(),
        }
    }
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            beams: 240,
            range_min_m: 0.12,
            range_max_m: 8.0,
            sensor_x_m: -0.032,
            noise: Noise::Ideal,
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        if let Err(error) = self.validate() {
            report.refuse(error.key(), error.to_string(), "leave it out for the lab's value");
        }
        self.deadman.check("deadman", report);
    }
}

impl Config {
    /// Refuses what no robot can have.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("dt_s", self.dt_s)?;
        positive("wheel_radius_m", self.wheel_radius_m)?;
        positive("track_m", self.track_m)?;
        positive("wheel_speed_max_rad_s", self.wheel_speed_max_rad_s)?;
        positive("robot_radius_m", self.robot_radius_m)?;
        positive("position_tolerance_m", self.position_tolerance_m)?;
        positive("heading_tolerance_rad", self.heading_tolerance_rad)?;
        for value in self.goal_m.into_iter().flatten() {
            finite("goal_m", value)?;
        }
        self.lidar.validate(self.robot_radius_m)
    }
}

/// What may be changed while the robot drives: what its sensor is like, and whether a touch ends the run.
/// What the world and the robot are made of may not, nor what stops the robot.
pub static TUNABLES: [Tunable; 2] = [
    Tunable::word("lidar.noise", &["ideal", "gazebo", "lds01"]),
    Tunable::switch("stop_at_collision"),
];

impl LidarConfig {
    fn validate(&self, robot_radius: f64) -> Result<(), ConfigError> {
        let &Self { beams, range_min_m, range_max_m, sensor_x_m, noise: _ } = self;
        if !(1..=BEAMS_MAX).contains(&beams) {
            return Err(ConfigError::Beams { beams });
        }
        finite("lidar.range_min_m", range_min_m)?;
        if range_min_m < 0.0 {
            return Err(ConfigError::Negative { key: "lidar.range_min_m", value: range_min_m });
        }
        positive("lidar.range_max_m", range_max_m)?;
        if range_max_m <= range_min_m {
            return Err(ConfigError::EmptyRange { range_min_m, range_max_m });
        }
        finite("lidar.sensor_x_m", sensor_x_m)?;
        if sensor_x_m.abs() > robot_radius {
            return Err(ConfigError::SensorOutside { sensor_x_m });
        }
        Ok(())
    }
}

fn finite(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() { Ok(()) } else { Err(ConfigError::NotFinite { key, value }) }
}

fn positive(key: &'static str, value: f64) -> Result<(), ConfigError> {
    finite(key, value)?;
    if value > 0.0 { Ok(()) } else { Err(ConfigError::NotPositive { key, value }) }
}

/// What is wrong with a configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ConfigError {
    /// The value is NaN or infinite.
    NotFinite {
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// The value must be above zero.
    NotPositive {
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// The value must not be below zero.
    Negative {
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// A scan has at least one beam and at most [`BEAMS_MAX`].
    Beams {
        /// [-] Beams asked for.
        beams: usize,
    },
    /// The LiDAR could measure nothing.
    EmptyRange {
        /// [m] Least range.
        range_min_m: f64,
        /// [m] Greatest range.
        range_max_m: f64,
    },
    /// The LiDAR would stick out of the robot, and could be inside a wall.
    SensorOutside {
        /// [m] Ahead of the axle.
        sensor_x_m: f64,
    },
}

impl ConfigError {
    /// [-] The key of the value that is wrong.
    pub const fn key(&self) -> &'static str {
        match self {
            Self::NotFinite { key, .. }
            | Self::NotPositive { key, .. }
            | Self::Negative { key, .. } => key,
            Self::Beams { .. } => "lidar.beams",
            Self::EmptyRange { .. } => "lidar.range_max_m",
            Self::SensorOutside { .. } => "lidar.sensor_x_m",
        }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotFinite { key, value } => {
                write!(formatter, "`{key}` is {value}, which is not a finite number")
            }
            Self::NotPositive { key, value } => {
                write!(formatter, "`{key}` is {value}, but must be above zero")
            }
            Self::Negative { key, value } => {
                write!(formatter, "`{key}` is {value}, but must not be negative")
            }
            Self::Beams { beams } => {
                write!(formatter, "`lidar.beams` is {beams}, but must be 1 to {BEAMS_MAX}")
            }
            Self::EmptyRange { range_min_m, range_max_m } => write!(
                formatter,
                "`lidar.range_max_m` is {range_max_m}, but must be above `lidar.range_min_m`, \
                 which is {range_min_m}"
            ),
            Self::SensorOutside { sensor_x_m } => write!(
                formatter,
                "`lidar.sensor_x_m` is {sensor_x_m}, which is outside of `robot_radius_m`"
            ),
        }
    }
}

impl std::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_lab_and_valid() {
        assert_eq!(Config::default().validate(), Ok(()));
        assert_eq!(toml::from_str(""), Ok(Config::default()));
    }

    #[test]
    fn a_configuration_that_no_robot_can_have_is_refused_by_key() {
        let table = [
            ("dt_s = 0.0", "`dt_s` is 0, but must be above zero"),
            ("track_m = nan", "`track_m` is NaN, which is not a finite number"),
            ("robot_radius_m = -1", "`robot_radius_m` is -1, but must be above zero"),
            ("goal_m = [1.0, inf]", "`goal_m` is inf, which is not a finite number"),
            ("lidar.beams = 0", "`lidar.beams` is 0, but must be 1 to 1440"),
            ("lidar.beams = 1441", "`lidar.beams` is 1441, but must be 1 to 1440"),
            ("lidar.range_min_m = -0.1", "`lidar.range_min_m` is -0.1, but must not be negative"),
            (
                "lidar.range_max_m = 0.12",
                "`lidar.range_max_m` is 0.12, but must be above `lidar.range_min_m`, which is 0.12",
            ),
            (
                "lidar.sensor_x_m = 0.2",
                "`lidar.sensor_x_m` is 0.2, which is outside of `robot_radius_m`",
            ),
        ];
        for (text, message) in table {
            let config: Config = toml::from_str(text).unwrap();
            assert_eq!(config.validate().unwrap_err().to_string(), message, "{text}");
        }
    }

    #[test]
    fn an_unknown_key_is_refused() {
        for text in ["speed = 1.0", "lidar.beam = 240", "wheel_limit = \"clip\""] {
            assert!(toml::from_str::<Config>(text).is_err(), "{text}");
        }
    }
}

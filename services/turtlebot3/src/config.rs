//! What the bridge can be told; the defaults are a TurtleBot3 Burger's as it comes out of its box.

use std::time::Duration;

use node::config::{Parameters, Report};
use node::{Tunable, deadman};
use serde::{Deserialize, Serialize};

use crate::lidar::Model;

/// The robot's ports and what is at them.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// [-] The OpenCR board's serial port.
    pub board_port: String,
    /// [-] The LiDAR's serial port.
    pub lidar_port: String,
    /// Which LiDAR it is.
    pub lidar: LidarChoice,
    /// [m] Nearer returns are not to be believed; the data sheet's where it is absent.
    pub lidar_range_min_m: Option<f32>,
    /// [-] Whether an LDS-02's ranges below a metre that are probably sunshine are dropped.
    pub near_filter: bool,
    /// [ms] Between two readings of the board, which gathers anew every 20 ms; 5 to 20.
    pub read_period_ms: f64,
    /// [-] Whether the gyro's bias is measured when the robot is first started, for which it has to
    /// stand still for 5 s.
    pub calibrates_gyro: bool,
    /// Which way the board turns the robot for a positive turning speed.
    pub positive_turn: PositiveTurn,
    /// Which commands may drive the wheels, and what stops them.
    pub deadman: deadman::Config,
}

/// Which LiDAR it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
pub enum LidarChoice {
    /// Found out: each is listened for in turn.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// HLS-LFCD2.
    #[serde(rename = "lds-01")]
    Lds01,
    /// LD08.
    #[serde(rename = "lds-02")]
    Lds02,
}

impl LidarChoice {
    /// The one that it is, where that is known.
    pub fn model(self) -> Option<Model> {
        match self {
            Self::Auto => None,
            Self::Lds01 => Some(Model::Lds01),
            Self::Lds02 => Some(Model::Lds02),
        }
    }
}

/// Which way the board turns the robot for a positive turning speed. Here and on every topic
/// positive is counterclockwise; a robot has been seen that turned the other way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PositiveTurn {
    /// As it should be.
    #[default]
    Counterclockwise,
    /// The wrong way round: what it is told is inverted.
    Clockwise,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            board_port: "/dev/ttyACM0".into(),
            lidar_port: "/dev/ttyUSB0".into(),
            lidar: LidarChoice::Auto,
            lidar_range_min_m: None,
            near_filter: false,
            // Twice as often as the board gathers, so that no reading is missed.
            read_period_ms: 10.0,
            calibrates_gyro: true,
            positive_turn: PositiveTurn::Counterclockwise,
            deadman: deadman::Config::default(),
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        for (key, port) in [("board_port", &self.board_port), ("lidar_port", &self.lidar_port)] {
            if !port.starts_with('/') {
                let help = "give its whole path, such as /dev/ttyACM0; see /dev/serial/by-id";
                report.refuse(key, "is no port", help);
            }
        }
        if self.board_port == self.lidar_port {
            report.refuse("lidar_port", "is the board's port too", "each has a port of its own");
        }
        if !(5.0..=20.0).contains(&self.read_period_ms) {
            report.refuse("read_period_ms", "is out of range", "give 5 to 20 milliseconds");
        }
        if self.lidar_range_min_m.is_some_and(|range| !(0.01..=1.0).contains(&range)) {
            report.refuse("lidar_range_min_m", "is out of range", "give 0.01 to 1 metre");
        }
        self.deadman.check("deadman", report);
    }
}

/// What may be changed while the robot drives: which of the LiDAR's returns are believed. Its ports, its
/// directions and what stops it may not.
pub static TUNABLES: [Tunable; 2] =
    [Tunable::switch("near_filter"), Tunable::number("lidar_range_min_m", 0.05..=1.0)];

impl Config {
    /// Between two readings of the board.
    pub(crate) fn read_period(&self) -> Duration {
        Duration::from_secs_f64(self.read_period_ms / 1e3)
    }
}

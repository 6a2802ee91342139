//! What a dead-man is asked to hold a robot to, and which requests it refuses.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::braking::Deceleration;
use crate::config::Report;

/// [-] So often a robot is armed again by itself within `rearm_window_s`.
pub const REARMS_MAX: usize = 3;

/// The dead-man's settings: `[process.parameters.deadman]` of whatever drives the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// [ms] Without a valid command for longer than this the robot stops; 50 to 500.
    pub timeout_ms: f64,
    /// [m/s] A command that asks for more is refused.
    pub linear_max_m_s: f64,
    /// [rad/s] A command that asks for more is refused.
    pub angular_max_rad_s: f64,
    /// [ms] A command's stamp may be so far from now.
    pub skew_max_ms: f64,
    /// [m/s^2] How fast the robot slows down where commands cease.
    pub deceleration_m_s2: f64,
    /// [rad/s^2] The same for its turning.
    pub angular_deceleration_rad_s2: f64,
    /// [m/s^2] How fast it slows down in an emergency.
    pub emergency_deceleration_m_s2: f64,
    /// [rad/s^2] The same for its turning.
    pub emergency_angular_deceleration_rad_s2: f64,
    /// [ms] Commands have to come for so long without a break before the robot is armed again.
    pub rearm_after_ms: f64,
    /// [s] It is armed again by itself at most three times within this.
    pub rearm_window_s: f64,
    /// [-] Whether it starts armed, or waits for `teseo arm`.
    pub start_armed: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            timeout_ms: 200.0,
            // A TurtleBot3 Burger's: e-manual, "Specifications".
            linear_max_m_s: 0.22,
            angular_max_rad_s: 2.84,
            // Two lost periods of the slowest LiDAR, and a pair that is driven by once more.
            skew_max_ms: 500.0,
            deceleration_m_s2: 1.0,
            angular_deceleration_rad_s2: 12.0,
            // From full speed to rest within 50 ms.
            emergency_deceleration_m_s2: 5.0,
            emergency_angular_deceleration_rad_s2: 60.0,
            rearm_after_ms: 500.0,
            rearm_window_s: 60.0,
            start_armed: true,
        }
    }
}

/// [-] What is meant to be the limit itself is not refused for its last bit.
const LIMIT_TOLERANCE: f64 = 1e-9;

impl Config {
    /// Says what is wrong with it; `table` is where it stands in its process's parameters.
    pub fn check(&self, table: &str, report: &mut Report<'_>) {
        let mut bounds = |key: &str, value: f64, min: f64, max: f64, help: &str| {
            if !(min..=max).contains(&value) {
                report.refuse(format!("{table}.{key}"), "is out of range", help);
            }
        };
        bounds("timeout_ms", self.timeout_ms, 50.0, 500.0, "give 50 to 500 milliseconds");
        bounds("skew_max_ms", self.skew_max_ms, 1.0, 60_000.0, "give 1 to 60000 milliseconds");
        bounds(
            "rearm_after_ms",
            self.rearm_after_ms,
            0.0,
            60_000.0,
            "give 0 to 60000 milliseconds",
        );
        bounds("rearm_window_s", self.rearm_window_s, 1.0, 3_600.0, "give 1 to 3600 seconds");
        let speed = "give 0.001 to 1000";
        bounds("linear_max_m_s", self.linear_max_m_s, 1e-3, 1e3, speed);
        bounds("angular_max_rad_s", self.angular_max_rad_s, 1e-3, 1e3, speed);
        for (key, value) in [
            ("deceleration_m_s2", self.deceleration_m_s2),
            ("angular_deceleration_rad_s2", self.angular_deceleration_rad_s2),
            ("emergency_deceleration_m_s2", self.emergency_deceleration_m_s2),
            ("emergency_angular_deceleration_rad_s2", self.emergency_angular_deceleration_rad_s2),
        ] {
            bounds(key, value, 0.01, 1e4, "give 0.01 to 10000");
        }
    }

    /// How long no valid command may come.
    pub fn timeout(&self) -> Duration {
        milliseconds(self.timeout_ms)
    }

    pub(super) fn skew_max(&self) -> Duration {
        milliseconds(self.skew_max_ms)
    }

    pub(super) fn rearm_after(&self) -> Duration {
        milliseconds(self.rearm_after_ms)
    }

    pub(super) fn linear_max(&self) -> f64 {
        self.linear_max_m_s * (1.0 + LIMIT_TOLERANCE)
    }

    pub(super) fn angular_max(&self) -> f64 {
        self.angular_max_rad_s * (1.0 + LIMIT_TOLERANCE)
    }

    pub(super) fn deceleration(&self) -> Deceleration {
        Deceleration { linear: self.deceleration_m_s2, angular: self.angular_deceleration_rad_s2 }
    }

    pub(super) fn emergency_deceleration(&self) -> Deceleration {
        Deceleration {
            linear: self.emergency_deceleration_m_s2,
            angular: self.emergency_angular_deceleration_rad_s2,
        }
    }
}

fn milliseconds(value: f64) -> Duration {
    Duration::from_secs_f64(value / 1e3)
}

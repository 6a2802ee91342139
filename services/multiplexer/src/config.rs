//! What the multiplexer can be told: for how long each source is waited for.

use std::time::Duration;

use node::Tunable;
use node::config::{Parameters, Report};
use serde::{Deserialize, Serialize};

use crate::Source;

/// How long each source may be silent before those of lower priority are heard again.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// [ms] Of a person's commands. Longer than the dead-man's time at the wheels: a robot whose
    /// person falls silent stops before it goes on by itself.
    pub teleop_timeout_ms: f64,
    /// [ms] Of the controller's.
    pub autonomy_timeout_ms: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            // twist_mux's, for each of its sources.
            teleop_timeout_ms: 500.0,
            // The dead-man's at the wheels.
            autonomy_timeout_ms: 200.0,
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        let timeouts = [
            ("teleop_timeout_ms", self.teleop_timeout_ms),
            ("autonomy_timeout_ms", self.autonomy_timeout_ms),
        ];
        for (key, milliseconds) in timeouts {
            if !(50.0..=10_000.0).contains(&milliseconds) {
                report.refuse(key, "is out of range", "give 50 to 10000 milliseconds");
            }
        }
    }
}

/// What may be changed while the robot drives. A person's is never shorter than the longest dead-man's time
/// at the wheels.
pub static TUNABLES: [Tunable; 2] = [
    Tunable::number("teleop_timeout_ms", 500.0..=5_000.0),
    Tunable::number("autonomy_timeout_ms", 100.0..=1_000.0),
];

impl Config {
    pub(crate) fn timeout(&self, source: Source) -> Duration {
        let milliseconds = match source {
            Source::Teleop => self.teleop_timeout_ms,
            Source::Autonomy => self.autonomy_timeout_ms,
        };
        Duration::from_secs_f64(milliseconds / 1e3)
    }
}

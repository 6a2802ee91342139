//! What goes wrong on purpose between a publisher and its readers: pure, seeded, and the same in a
//! robot's processes as in a test of one thread.
//!
//! ```
//! use interfaces::{Stamp, VelocityCommand};
//! use node::faults::{Faults, FaultyLink};
//!
//! let faults = Faults { loss: 0.5, ..Faults::default() };
//! let mut link = FaultyLink::new(&faults, 1, 0);
//! let mut arrived = 0;
//! for millisecond in 0..1_000 {
//!     let now = Stamp::from_nanoseconds(1_000_000 * millisecond);
//!     link.push(now, VelocityCommand::default());
//!     while link.pop(now).is_some() {
//!         arrived += 1;
//!     }
//! }
//! assert_eq!(arrived + link.counts().lost, 1_000);
//! ```

mod damage;
mod link;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::Deserialize;

pub use link::{FaultCounts, FaultyLink, QUEUE_MAX};

use crate::config::{Parameters, Report};

/// What happens to the samples of one topic, none of it by default. The probabilities are those of
/// each sample, independent of each other.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// [-] It is never sent.
    pub loss: f64,
    /// [s] It is sent up to this much late, any delay being as likely as another.
    pub delay_max_s: f64,
    /// [-] It is sent twice, each time with a delay of its own.
    pub duplicate: f64,
    /// [-] It is sent after its successor; no two are held back at once.
    pub reorder: f64,
    /// [-] What follows its header is overwritten in part.
    pub corrupt: f64,
    /// [-] Its stamp is moved.
    pub stamp_jump: f64,
    /// [s] By up to this much, forward or back.
    pub stamp_jump_max_s: f64,
    /// [-] Nothing passes from now on, for `stall_s`: what is sent meanwhile is lost, this one too,
    /// and what is under way already arrives after.
    pub stall: f64,
    /// [s] How long that takes.
    pub stall_s: f64,
    /// [s] All is well for so long, from the first sample.
    pub from_s: f64,
    /// [s] All is well after so long, from the first sample.
    pub until_s: Option<f64>,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            loss: 0.0,
            delay_max_s: 0.0,
            duplicate: 0.0,
            reorder: 0.0,
            corrupt: 0.0,
            stamp_jump: 0.0,
            // What a clock that changes to summer time does.
            stamp_jump_max_s: 3_600.0,
            stall: 0.0,
            // Long enough to be seen by the supervisor.
            stall_s: 1.0,
            from_s: 0.0,
            until_s: None,
        }
    }
}

/// [s] Thirty years: longer than any run, and counted in nanoseconds still.
const TIME_MAX: f64 = 1e9;

impl Faults {
    /// Whether nothing ever goes wrong.
    pub fn is_none(&self) -> bool {
        self.probabilities().iter().all(|(_, value)| *value <= 0.0) && self.delay_max_s <= 0.0
    }

    /// Refuses what is no probability or no time.
    pub fn validate(&self) -> Result<(), FaultsError> {
        self.mistakes().next().map_or(Ok(()), Err)
    }

    fn mistakes(&self) -> impl Iterator<Item = FaultsError> {
        let probabilities = self.probabilities().into_iter();
        let wrong = probabilities.filter(|(_, value)| !(0.0..=1.0).contains(value));
        let wrong = wrong.map(|(key, value)| FaultsError::Probability { key, value });
        let times = self.times().into_iter().filter(|(_, value)| !(0.0..=TIME_MAX).contains(value));
        let times = times.map(|(key, value)| FaultsError::Time { key, value });
        let until = self.until_s.filter(|until| *until <= self.from_s);
        let window = until.map(|until| FaultsError::NoTime { from: self.from_s, until });
        wrong.chain(times).chain(window)
    }

    fn probabilities(&self) -> [(&'static str, f64); 6] {
        [
            ("loss", self.loss),
            ("duplicate", self.duplicate),
            ("reorder", self.reorder),
            ("corrupt", self.corrupt),
            ("stamp_jump", self.stamp_jump),
            ("stall", self.stall),
        ]
    }

    fn times(&self) -> [(&'static str, f64); 5] {
        [
            ("delay_max_s", self.delay_max_s),
            ("stamp_jump_max_s", self.stamp_jump_max_s),
            ("stall_s", self.stall_s),
            ("from_s", self.from_s),
            ("until_s", self.until_s.unwrap_or_default()),
        ]
    }
}

impl Parameters for Faults {
    fn check(&self, report: &mut Report<'_>) {
        for mistake in self.mistakes() {
            report.refuse(mistake.key(), mistake.to_string(), mistake.help());
        }
    }
}

impl Parameters for FaultsByTopic {
    fn check(&self, report: &mut Report<'_>) {
        for (topic, faults) in self {
            faults.check(&mut report.within(topic));
        }
    }
}

/// What goes wrong on purpose with the topics of one process, by topic.
pub(crate) type FaultsByTopic = BTreeMap<String, Faults>;

/// What a node's status says of the faults of one topic.
pub(crate) struct Figure {
    /// [-] What has happened.
    pub(crate) name: &'static str,
    /// The setting without which it never does.
    setting: fn(&Faults) -> f64,
    /// [-] How often it has.
    pub(crate) count: fn(&FaultCounts) -> u64,
}

impl Faults {
    /// The figures that can be other than zero: a status has room for few.
    pub(crate) fn figures(&self) -> impl Iterator<Item = &'static Figure> {
        FIGURES.iter().filter(|figure| 0.0 < (figure.setting)(self))
    }
}

const FIGURES: [Figure; 7] = [
    Figure { name: "lost", setting: |_| 1.0, count: FaultCounts::missing },
    Figure { name: "delayed", setting: |set| set.delay_max_s, count: |counts| counts.delayed },
    Figure { name: "duplicated", setting: |set| set.duplicate, count: |counts| counts.duplicated },
    Figure { name: "reordered", setting: |set| set.reorder, count: |counts| counts.reordered },
    Figure { name: "corrupted", setting: |set| set.corrupt, count: |counts| counts.corrupted },
    Figure {
        name: "stamps_moved",
        setting: |set| set.stamp_jump,
        count: |counts| counts.stamps_moved,
    },
    Figure { name: "stalls", setting: |set| set.stall, count: |counts| counts.stalls },
];

/// What is wrong with [`Faults`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultsError {
    /// The value is not in `0..=1`.
    Probability {
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// The value is negative, or not finite, or absurdly large.
    Time {
        /// [-] The key.
        key: &'static str,
        /// [s] Its value.
        value: f64,
    },
    /// The faults would cease before they begin.
    NoTime {
        /// [s] When they begin.
        from: f64,
        /// [s] When they cease.
        until: f64,
    },
}

impl FaultsError {
    /// [-] The key of the value that is wrong.
    pub const fn key(&self) -> &'static str {
        match self {
            Self::Probability { key, .. } | Self::Time { key, .. } => key,
            Self::NoTime { .. } => "until_s",
        }
    }

    const fn help(&self) -> &'static str {
        match self {
            Self::Probability { .. } => "give 0 for never, 1 for always, or what lies between",
            Self::Time { .. } => "give a number of seconds, 0 or more",
            Self::NoTime { .. } => "give more than `from_s`, or leave it out",
        }
    }
}

impl fmt::Display for FaultsError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Probability { key, value } => {
                write!(formatter, "`{key}` is {value}, which is no probability")
            }
            Self::Time { key, value } => {
                write!(formatter, "`{key}` is {value}, which is no length of time")
            }
            Self::NoTime { from, until } => write!(
                formatter,
                "`until_s` is {until}, but must be above `from_s`, which is {from}"
            ),
        }
    }
}

impl std::error::Error for FaultsError {}

/// For values that `validate` lets pass; any other is none at all.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

//! What a pairing is asked to do, and which requests it refuses.

use std::fmt;
use std::time::Duration;

/// [-] Topics that one pairing takes at most.
pub const TOPICS_MAX: usize = 8;

/// [-] Samples that one queue holds at most: at 1 kHz, ten seconds.
pub const QUEUE_SIZE_MAX: usize = 10_000;

/// Samples a minute apart do not show the same moment, whatever the robot; ROS 2's default is 68
/// years.
const DURATION_MAX: Duration = Duration::from_secs(60);

/// Ten thousand times ROS 2's default.
const AGE_PENALTY_MAX: f64 = 1_000.0;

/// `nearest` may try every combination of queued samples: about 10 ms.
const COMBINATIONS_MAX: usize = 1_000_000;

/// Which of ROS 2's two algorithms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Policy {
    /// An arriving sample at once takes the nearest queued partners (Python's
    /// `ApproximateTimeSynchronizer`).
    Nearest,
    /// A set waits until no better one can follow (C++'s `sync_policies::ApproximateTime`).
    Adaptive {
        /// [-] How much better a later set must be to be preferred; 0.1 by default.
        age_penalty: f64,
        /// The least time between two stamps of each topic, where known; zero where not. It helps
        /// to decide sooner.
        period_min: [Duration; TOPICS_MAX],
    },
}

impl Policy {
    /// [`Policy::Adaptive`] with ROS 2's defaults.
    pub const ADAPTIVE: Self =
        Self::Adaptive { age_penalty: 0.1, period_min: [Duration::ZERO; TOPICS_MAX] };
}

/// What ends a wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bounds {
    /// Only what ends it in ROS 2: a full queue. Time may run backwards. For reference vectors and
    /// for questions about recordings; not for a robot.
    Unlimited,
    /// Age, delay, and order. A backward step of the clock starts afresh, and with
    /// [`Policy::Adaptive`] a sample behind its predecessor is dropped.
    Limited {
        /// A sample received longer ago than this is in no pair.
        max_age: Duration,
        /// With [`Policy::Adaptive`], the most that a pair waits for a better one, from the moment
        /// at which the last member was received of the first set that it competes with.
        /// [`Policy::Nearest`] never waits.
        max_delay: Duration,
    },
}

/// How to pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// Which algorithm.
    pub policy: Policy,
    /// [-] How many topics, from 2 to [`TOPICS_MAX`].
    pub topics: usize,
    /// [-] Samples that wait, per topic.
    pub queue_size: usize,
    /// All stamps of a pair are less than this apart.
    pub slop: Duration,
    /// What ends a wait.
    pub bounds: Bounds,
}

impl Config {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if !(2..=TOPICS_MAX).contains(&self.topics) {
            return Err(ConfigError::Topics);
        }
        if !(1..=QUEUE_SIZE_MAX).contains(&self.queue_size) {
            return Err(ConfigError::QueueSize);
        }
        if let Policy::Adaptive { age_penalty, .. } = self.policy
            && !(0.0..=AGE_PENALTY_MAX).contains(&age_penalty)
        {
            return Err(ConfigError::AgePenalty);
        }
        match self.bounds {
            Bounds::Unlimited => Ok(()),
            Bounds::Limited { max_age, max_delay } => self.check_limits(max_age, max_delay),
        }
    }

    fn check_limits(&self, max_age: Duration, max_delay: Duration) -> Result<(), ConfigError> {
        let finite = Duration::from_nanos(1)..=DURATION_MAX;
        if !finite.contains(&self.slop) {
            return Err(ConfigError::Slop);
        }
        if !finite.contains(&max_age) {
            return Err(ConfigError::MaxAge);
        }
        if max_age < max_delay {
            return Err(ConfigError::MaxDelay);
        }
        let others = u32::try_from(self.topics - 1).unwrap_or(u32::MAX);
        let combinations = self.queue_size.saturating_pow(others);
        if self.policy == Policy::Nearest && COMBINATIONS_MAX < combinations {
            return Err(ConfigError::Combinations);
        }
        Ok(())
    }
}

/// Seconds as ROS 2's Python takes them: the product with 10^9, its fraction cut off. 1.001 s are
/// 1 000 999 999 ns.
pub fn slop_from_seconds(seconds: f64) -> Result<Duration, ConfigError> {
    let nanoseconds = seconds * 1e9;
    if !(0.0..9_223_372_036_854_775_808.0).contains(&nanoseconds) {
        return Err(ConfigError::Slop);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
    Ok(Duration::from_nanos(nanoseconds as u64))
}

/// Why a pairing cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConfigError {
    /// One topic has nothing to be paired with; more than eight are too many.
    Topics,
    /// A queue holds at least one sample, and at most ten thousand.
    QueueSize,
    /// The slop is finite and greater than zero: stamps must be *less* than it apart.
    Slop,
    /// The age penalty is a number from 0 to 1000.
    AgePenalty,
    /// The greatest age is finite and greater than zero.
    MaxAge,
    /// A pair that may wait longer than its samples may live would never be given out.
    MaxDelay,
    /// So many topics with queues so long take too long to search.
    Combinations,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Topics => "pairing takes 2 to 8 topics",
            Self::QueueSize => "the queue must hold 1 to 10000 samples",
            Self::Slop => "the slop must be more than zero and at most 60 s",
            Self::AgePenalty => "the age penalty must be a number from 0 to 1000",
            Self::MaxAge => "the greatest age must be more than zero and at most 60 s",
            Self::MaxDelay => "the greatest delay must not exceed the greatest age",
            Self::Combinations => "too many topics with queues too long: size^(topics - 1) > 10^6",
        })
    }
}

impl std::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_cut_off_and_not_rounded() {
        let cases = [(1.001, 1_000_999_999), (0.05, 50_000_000), (4e-9, 4), (0.0, 0), (1e-10, 0)];
        for (seconds, nanoseconds) in cases {
            assert_eq!(slop_from_seconds(seconds), Ok(Duration::from_nanos(nanoseconds)));
        }
        for seconds in [f64::NAN, f64::INFINITY, -0.1, 1e10] {
            assert_eq!(slop_from_seconds(seconds), Err(ConfigError::Slop));
        }
    }
}

//! How a robot that is stopped comes to rest: on the path it was on, with bounded deceleration.

use std::time::Duration;

use interfaces::Stamp;

use super::Motion;

/// How fast a robot slows down at the most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deceleration {
    /// [m/s^2] Along x.
    pub(super) linear: f64,
    /// [rad/s^2] About z.
    pub(super) angular: f64,
}

/// One way to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Braking {
    begun: Stamp,
    from: Motion,
    takes: Duration,
    is_told: bool,
}

impl Braking {
    /// Both speeds shrink alike, so that the path keeps its curvature, and neither faster than its
    /// `rate`.
    pub(super) fn new(begun: Stamp, from: Motion, rate: Deceleration) -> Self {
        let seconds = (from.linear.abs() / rate.linear).max(from.angular.abs() / rate.angular);
        Self { begun, from, takes: Duration::from_secs_f64(seconds), is_told: from.is_zero() }
    }

    pub(super) fn at_rest() -> Self {
        Self { begun: Stamp::ZERO, from: Motion::ZERO, takes: Duration::ZERO, is_told: true }
    }

    pub(super) fn motion(&self, now: Stamp) -> Motion {
        let gone = now.since(self.begun);
        if self.takes <= gone {
            return Motion::ZERO;
        }
        let left = 1.0 - gone.as_secs_f64() / self.takes.as_secs_f64();
        Motion { linear: self.from.linear * left, angular: self.from.angular * left }
    }

    /// Whether the robot is at rest now and was not when this was last asked.
    pub(super) fn comes_to_rest(&mut self, now: Stamp) -> bool {
        let is_at_rest = self.motion(now).is_zero();
        is_at_rest && !std::mem::replace(&mut self.is_told, is_at_rest)
    }
}

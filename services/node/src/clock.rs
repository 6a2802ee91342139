//! The one place that reads the clock and the one that sleeps.

use std::num::NonZeroU64;
use std::time::Duration;

use interfaces::Stamp;
use rustix::thread::{ClockId, NanosleepRelativeResult, clock_nanosleep_relative};
use serde::Deserialize;

/// Whose time the robot lives in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// The world waits for each command; stamps are simulated time; nothing waits for the wall.
    #[default]
    Lockstep,
    /// The world moves on its own; stamps are `CLOCK_MONOTONIC`.
    Realtime,
}

/// The moment it is, on `CLOCK_MONOTONIC`.
pub fn now() -> Stamp {
    let time = rustix::time::clock_gettime(ClockId::Monotonic);
    let seconds = u64::try_from(time.tv_sec).unwrap_or_default();
    let nanoseconds = u64::try_from(time.tv_nsec).unwrap_or_default();
    Stamp::from_nanoseconds(seconds * 1_000_000_000 + nanoseconds)
}

/// What people's clocks say, for what people read; it may jump.
#[expect(clippy::disallowed_methods, reason = "the one place; nothing but text is made of it")]
pub fn wall() -> std::time::SystemTime {
    std::time::SystemTime::now()
}

/// From now on this thread is woken when its time has come, and not up to 50 us later, which is how
/// long the kernel may otherwise wait to wake several at once.
pub(crate) fn be_punctual() {
    // Who is refused is late, as everybody is by default.
    if let Err(cause) = rustix::thread::set_current_timer_slack(Some(SLACK_MIN)) {
        tracing::debug!(%cause, "wakes up to 50 us late");
    }
}

/// [ns] The least that is not the default.
const SLACK_MIN: NonZeroU64 = NonZeroU64::MIN;

/// Sleeps for `duration`, or less where a signal arrives.
pub fn nap(duration: Duration) {
    let Ok(request) = rustix::time::Timespec::try_from(duration) else { return };
    match clock_nanosleep_relative(ClockId::Monotonic, &request) {
        // A signal ends it early: whoever sleeps looks at the stop flag next.
        NanosleepRelativeResult::Ok
        | NanosleepRelativeResult::Interrupted(_)
        | NanosleepRelativeResult::Err(_) => {}
    }
}

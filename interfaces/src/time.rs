//! A moment on the robot's one clock.

use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// [ns] A moment, counted from the start of `CLOCK_MONOTONIC`, or of simulated time.
///
/// All processes of one machine share that start, which `std::time::Instant` does not promise.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Pod, Zeroable, ZeroCopySend,
)]
#[type_name("Stamp/1")]
#[repr(C)]
pub struct Stamp {
    /// [ns] Since the clock's start.
    pub nanoseconds: u64,
}

impl Stamp {
    /// The clock's start.
    pub const ZERO: Self = Self { nanoseconds: 0 };

    /// The moment this many nanoseconds after the clock's start.
    pub const fn from_nanoseconds(nanoseconds: u64) -> Self {
        Self { nanoseconds }
    }

    /// The time from `earlier` to here; zero where `earlier` is later, since a clock that another
    /// process read can be ahead of ours.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.nanoseconds.saturating_sub(earlier.nanoseconds))
    }

    /// The moment `duration` after this one, or the last there is.
    #[must_use]
    pub fn after(self, duration: Duration) -> Self {
        let nanoseconds = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        Self { nanoseconds: self.nanoseconds.saturating_add(nanoseconds) }
    }

    /// The moment `duration` before this one, or the clock's start.
    #[must_use]
    pub fn before(self, duration: Duration) -> Self {
        let nanoseconds = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        Self { nanoseconds: self.nanoseconds.saturating_sub(nanoseconds) }
    }

    /// [s] Since the clock's start.
    pub fn seconds(self) -> f64 {
        self.nanoseconds as f64 * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_saturate_where_the_other_clock_is_ahead() {
        let (early, late) = (Stamp::from_nanoseconds(5), Stamp::from_nanoseconds(8));

        assert_eq!(late.since(early), Duration::from_nanos(3));
        assert_eq!(early.since(late), Duration::ZERO);
        assert_eq!(late.after(Duration::MAX).nanoseconds, u64::MAX);
    }
}

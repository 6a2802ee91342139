//! Why a command may not move the robot.

use std::fmt;

/// Why a command may not move the robot: the index of its counter in
/// [`MotionState::rejected`](interfaces::MotionState).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Rejection {
    /// It is of a former life of its publisher.
    OldEpoch = 0,
    /// Its number is not above that of the command before: repeated, or overtaken.
    NotNewer = 1,
    /// A speed is NaN or infinite.
    NotFinite = 2,
    /// A speed is beyond what this robot may do.
    BeyondLimits = 3,
    /// What it was computed from is too old.
    StampTooOld = 4,
    /// What it was computed from lies in the future.
    StampAhead = 5,
}

impl Rejection {
    /// All of them, by number.
    pub const ALL: [Self; 6] = [
        Self::OldEpoch,
        Self::NotNewer,
        Self::NotFinite,
        Self::BeyondLimits,
        Self::StampTooOld,
        Self::StampAhead,
    ];

    /// For counters: `old_epoch`.
    pub fn key(self) -> &'static str {
        match self {
            Self::OldEpoch => "old_epoch",
            Self::NotNewer => "not_newer",
            Self::NotFinite => "not_finite",
            Self::BeyondLimits => "beyond_limits",
            Self::StampTooOld => "stamp_too_old",
            Self::StampAhead => "stamp_ahead",
        }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::OldEpoch => "it is of a former life of its publisher",
            Self::NotNewer => "its number is not above that of the command before",
            Self::NotFinite => "a speed is no finite number",
            Self::BeyondLimits => "a speed is beyond this robot's limits",
            Self::StampTooOld => "what it was computed from is too old",
            Self::StampAhead => "what it was computed from lies in the future",
        })
    }
}

//! Whether a robot may move: what whoever drives the wheels says about it, and is asked.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::{Header, Stamp, UnknownNumber};

/// [-] Kinds of refused commands that fit in a [`MotionState`].
pub const REJECTIONS_MAX: usize = 8;

/// Whether commands move the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Permission {
    /// They do.
    Armed = 0,
    /// They do not: the robot slows down.
    Braking = 1,
    /// They do not: the wheels are held at zero.
    Held = 2,
}

impl Permission {
    /// In a word for people.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Armed => "armed",
            Self::Braking => "braking",
            Self::Held => "held",
        }
    }
}

impl TryFrom<u8> for Permission {
    type Error = UnknownNumber;

    fn try_from(number: u8) -> Result<Self, UnknownNumber> {
        [Self::Armed, Self::Braking, Self::Held]
            .into_iter()
            .find(|&permission| permission as u8 == number)
            .ok_or(UnknownNumber(number))
    }
}

/// Why commands do not move the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum StopCause {
    /// They do.
    #[default]
    None = 0,
    /// It was not armed since its start.
    NotArmed = 1,
    /// No valid command came for the dead-man's time.
    Silence = 2,
    /// Somebody latched the emergency stop.
    EmergencyStop = 3,
    /// The supervisor is gone.
    SupervisorLost = 4,
    /// Whoever drives the wheels was told to let go.
    Paused = 5,
    /// Whoever drives the wheels cannot reach them.
    DriveLost = 6,
}

impl StopCause {
    /// In words for people.
    pub const fn label(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::NotArmed => "not armed",
            Self::Silence => "dead-man",
            Self::EmergencyStop => "emergency stop",
            Self::SupervisorLost => "supervisor lost",
            Self::Paused => "paused",
            Self::DriveLost => "drive lost",
        }
    }
}

impl TryFrom<u8> for StopCause {
    type Error = UnknownNumber;

    fn try_from(number: u8) -> Result<Self, UnknownNumber> {
        [
            Self::None,
            Self::NotArmed,
            Self::Silence,
            Self::EmergencyStop,
            Self::SupervisorLost,
            Self::Paused,
            Self::DriveLost,
        ]
        .into_iter()
        .find(|&cause| cause as u8 == number)
        .ok_or(UnknownNumber(number))
    }
}

/// Whether the robot may move, and why not: told by whoever drives the wheels, at every change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("MotionState/1")]
#[repr(C)]
pub struct MotionState {
    /// Stamp of the change, sequence, epoch.
    pub header: Header,
    /// [-] A [`Permission`], by number.
    pub permission: u8,
    /// [-] A [`StopCause`], by number.
    pub cause: u8,
    /// [-] 1 where only a person can arm the robot again, else 0.
    pub needs_person: u8,
    /// [-] 1 while the emergency stop is latched, else 0.
    pub emergency_stop: u8,
    /// [-] Epoch of the last valid command's publisher.
    pub command_epoch: u32,
    /// [-] Sequence number of the last valid command.
    pub command_sequence: u64,
    /// [ns] When the last valid command was received; zero where none was.
    pub command_received: Stamp,
    /// [-] Valid commands so far.
    pub accepted: u64,
    /// [-] Refused commands so far, by reason.
    pub rejected: [u64; REJECTIONS_MAX],
    /// [-] How often commands ceased so far.
    pub trips: u64,
}

/// What a person asks of whoever drives the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("MotionRequest/1")]
#[repr(C)]
pub struct MotionRequest {
    /// Stamp of the request, sequence, epoch.
    pub header: Header,
    /// [-] 1: arm the robot again.
    pub arm: u8,
    /// [-] Zero.
    pub reserved: [u8; 7],
}

/// Sizes are part of the agreement: a change is a new type name and a line in the changelog.
const _: () = {
    assert!(size_of::<MotionState>() == 128);
    assert!(size_of::<MotionRequest>() == 32);
};

//! Managed nodes with ROS 2's states, transitions and numbers (design.ros2.org, "Managed nodes").

use std::fmt;

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::{Header, Text};

/// Where a node stands in its life; the numbers are `lifecycle_msgs/State`'s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum State {
    /// Nobody has heard of it.
    Unknown = 0,
    /// Running, holding nothing.
    Unconfigured = 1,
    /// Ports open and parameters read; its own code waits.
    Inactive = 2,
    /// Its own code runs.
    Active = 3,
    /// About to end.
    Finalized = 4,
    /// On the way to `Inactive`.
    Configuring = 10,
    /// On the way back to `Unconfigured`.
    CleaningUp = 11,
    /// On the way to `Finalized`.
    ShuttingDown = 12,
    /// On the way to `Active`.
    Activating = 13,
    /// On the way back to `Inactive`.
    Deactivating = 14,
    /// After an error, deciding between `Unconfigured` and `Finalized`.
    ErrorProcessing = 15,
}

impl State {
    /// Whether a node can stay in it (ROS 2's primary states), and is not on its way to another.
    pub const fn is_primary(self) -> bool {
        match self {
            Self::Unconfigured | Self::Inactive | Self::Active | Self::Finalized => true,
            Self::Unknown
            | Self::Configuring
            | Self::CleaningUp
            | Self::ShuttingDown
            | Self::Activating
            | Self::Deactivating
            | Self::ErrorProcessing => false,
        }
    }

    /// ROS 2's word for it.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Unconfigured => "unconfigured",
            Self::Inactive => "inactive",
            Self::Active => "active",
            Self::Finalized => "finalized",
            Self::Configuring => "configuring",
            Self::CleaningUp => "cleaningup",
            Self::ShuttingDown => "shuttingdown",
            Self::Activating => "activating",
            Self::Deactivating => "deactivating",
            Self::ErrorProcessing => "errorprocessing",
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.label())
    }
}

impl TryFrom<u8> for State {
    type Error = UnknownNumber;

    fn try_from(number: u8) -> Result<Self, UnknownNumber> {
        [
            Self::Unknown,
            Self::Unconfigured,
            Self::Inactive,
            Self::Active,
            Self::Finalized,
            Self::Configuring,
            Self::CleaningUp,
            Self::ShuttingDown,
            Self::Activating,
            Self::Deactivating,
            Self::ErrorProcessing,
        ]
        .into_iter()
        .find(|&state| state as u8 == number)
        .ok_or(UnknownNumber(number))
    }
}

/// What a supervisor asks of a node; the numbers are `lifecycle_msgs/Transition`'s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Transition {
    /// Unconfigured to inactive: read parameters, open ports.
    Configure = 1,
    /// Inactive to unconfigured: let go of everything.
    CleanUp = 2,
    /// Inactive to active: begin.
    Activate = 3,
    /// Active to inactive: pause.
    Deactivate = 4,
    /// Unconfigured to finalized: end.
    ShutdownUnconfigured = 5,
    /// Inactive to finalized: end.
    ShutdownInactive = 6,
    /// Active to finalized: end.
    ShutdownActive = 7,
}

impl Transition {
    /// ROS 2's word for it.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Configure => "configure",
            Self::CleanUp => "cleanup",
            Self::Activate => "activate",
            Self::Deactivate => "deactivate",
            Self::ShutdownUnconfigured | Self::ShutdownInactive | Self::ShutdownActive => {
                "shutdown"
            }
        }
    }

    /// The state in which it may be asked for.
    pub const fn start(self) -> State {
        match self {
            Self::Configure | Self::ShutdownUnconfigured => State::Unconfigured,
            Self::CleanUp | Self::Activate | Self::ShutdownInactive => State::Inactive,
            Self::Deactivate | Self::ShutdownActive => State::Active,
        }
    }

    /// The state while it is under way.
    pub const fn through(self) -> State {
        match self {
            Self::Configure => State::Configuring,
            Self::CleanUp => State::CleaningUp,
            Self::Activate => State::Activating,
            Self::Deactivate => State::Deactivating,
            Self::ShutdownUnconfigured | Self::ShutdownInactive | Self::ShutdownActive => {
                State::ShuttingDown
            }
        }
    }

    /// The state after success.
    pub const fn goal(self) -> State {
        match self {
            Self::Configure | Self::Deactivate => State::Inactive,
            Self::CleanUp => State::Unconfigured,
            Self::Activate => State::Active,
            Self::ShutdownUnconfigured | Self::ShutdownInactive | Self::ShutdownActive => {
                State::Finalized
            }
        }
    }

    /// The shutdown that may be asked for in `state`, if there is one.
    pub const fn shutdown_from(state: State) -> Option<Self> {
        match state {
            State::Unconfigured => Some(Self::ShutdownUnconfigured),
            State::Inactive => Some(Self::ShutdownInactive),
            State::Active => Some(Self::ShutdownActive),
            State::Unknown
            | State::Finalized
            | State::Configuring
            | State::CleaningUp
            | State::ShuttingDown
            | State::Activating
            | State::Deactivating
            | State::ErrorProcessing => None,
        }
    }
}

impl fmt::Display for Transition {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.label())
    }
}

impl TryFrom<u8> for Transition {
    type Error = UnknownNumber;

    fn try_from(number: u8) -> Result<Self, UnknownNumber> {
        [
            Self::Configure,
            Self::CleanUp,
            Self::Activate,
            Self::Deactivate,
            Self::ShutdownUnconfigured,
            Self::ShutdownInactive,
            Self::ShutdownActive,
        ]
        .into_iter()
        .find(|&transition| transition as u8 == number)
        .ok_or(UnknownNumber(number))
    }
}

/// A number in shared memory that names nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownNumber(pub u8);

impl fmt::Display for UnknownNumber {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} names no state, transition or outcome", self.0)
    }
}

impl std::error::Error for UnknownNumber {}

/// The supervisor asks a node for a transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("ChangeState/1")]
#[repr(C)]
pub struct ChangeState {
    /// Stamp of the request, sequence, epoch of the supervisor.
    pub header: Header,
    /// [-] A [`Transition`], by number.
    pub transition: u8,
    /// [-] Zero.
    pub reserved: [u8; 7],
}

/// A node has come from one state to another, after `lifecycle_msgs/TransitionEvent`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("TransitionEvent/1")]
#[repr(C)]
pub struct TransitionEvent {
    /// Stamp of the change, sequence, epoch of the node.
    pub header: Header,
    /// [-] The [`State`] it left, by number.
    pub start_state: u8,
    /// [-] The [`State`] it is in, by number.
    pub goal_state: u8,
    /// [-] Zero.
    pub reserved: [u8; 6],
    /// [-] Why, where the change was not asked for; else empty.
    pub reason: Text,
}

const _: () = {
    assert!(size_of::<ChangeState>() == 32);
    assert!(size_of::<TransitionEvent>() == 32 + Text::CAPACITY);
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_ros_2() {
        let states = [(1, "unconfigured"), (2, "inactive"), (3, "active"), (4, "finalized")];
        for (number, label) in states {
            assert_eq!(State::try_from(number).map(State::label), Ok(label));
        }
        let transitions = [(1, "configure"), (2, "cleanup"), (3, "activate"), (4, "deactivate")];
        for (number, label) in transitions {
            assert_eq!(Transition::try_from(number).map(Transition::label), Ok(label));
        }
    }

    #[test]
    fn a_byte_that_another_process_wrote_may_be_nothing() {
        assert_eq!(State::try_from(9), Err(UnknownNumber(9)));
        assert_eq!(Transition::try_from(0), Err(UnknownNumber(0)));
    }
}

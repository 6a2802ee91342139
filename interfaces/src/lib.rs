//! What the processes of a robot agree on: messages, topics, lifecycle, time.
//!
//! Everything here lies in shared memory or describes what does. Units are SI, in brackets first;
//! frames follow REP 103 and REP 105 (x forward, y left, yaw counterclockwise positive).

#![forbid(unsafe_code)]

mod fields;
mod lifecycle;
mod messages;
mod motion;
mod parameters;
mod sensors;
mod status;
mod text;
mod time;
pub mod topics;

pub use fields::{Described, Field, FieldValue, SetError};
pub use lifecycle::{ChangeState, State, Transition, TransitionEvent, UnknownNumber};
pub use messages::{
    BEAMS_MAX, Header, JointState, LEFT, LaserScan, Odometry, Pose, RIGHT, SensorPair,
    VelocityCommand,
};
pub use motion::{MotionRequest, MotionState, Permission, REJECTIONS_MAX, StopCause};
pub use parameters::{ParameterChange, SetParameter};
pub use sensors::{BatteryState, BoardRequest, Imu, SensorState};
pub use status::{NodeStatus, Outcome, PORTS_MAX, PortStatus, VALUES_MAX, Value};
pub use text::Text;
pub use time::Stamp;
pub use topics::{Loss, Message, Scope, Topic};

//! The topic table: every stream of samples, once, with its quality of service.
//!
//! | topic | type | frame | rate | publisher |
//! |---|---|---|---|---|
//! | `scan` | `LaserScan` | `base_scan` | once per simulated step, or the LiDAR's own | simulator or bridge |
//! | `joint_states` | `JointState` | | once per simulated step, or 50 Hz | simulator or bridge |
//! | `robot_pose` | `Pose` | `odom` | as `joint_states`, for robots that report only a pose | simulator or bridge |
//! | `imu` | `Imu` | `imu_link` | as `joint_states`, just before each | bridge |
//! | `battery_state` | `BatteryState` | | 1 Hz | bridge |
//! | `sensor_state` | `SensorState` | | 10 Hz and by change | bridge |
//! | `board_request` | `BoardRequest` | | by request | anybody |
//! | `odom` | `Odometry` | `odom`, twist in `base_link` | one per measurement | odometry |
//! | `sensor_pair` | `SensorPair` | | one per pair | supervisor |
//! | `cmd_vel` | `VelocityCommand` | `base_link` | one per pair, or the controller's period | controller or multiplexer |
//! | `autonomy_cmd_vel` | `VelocityCommand` | `base_link` | as `cmd_vel`, where a multiplexer chooses | controller |
//! | `teleop_cmd_vel` | `VelocityCommand` | `base_link` | 20 Hz while somebody drives | teleop |
//! | `motion_state` | `MotionState` | | by change | simulator or bridge |
//! | `motion_request` | `MotionRequest` | | by request | `teseo arm` |
//! | `pose` | `Pose` | `map` | optional | a localization |
//! | `~/change_state` | `ChangeState` | | by request | supervisor |
//! | `~/transition_event` | `TransitionEvent` | | by change | the node |
//! | `~/set_parameter` | `SetParameter` | | by request | supervisor |
//! | `~/parameter_change` | `ParameterChange` | | by request | the node |
//! | `~/status` | `NodeStatus` | | 10 Hz and by change | the node |
//!
//! Each topic has one publisher; shared memory refuses a second.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::time::Duration;

use bytemuck::Pod;
use iceoryx2::prelude::ZeroCopySend;

use crate::{
    BatteryState, BoardRequest, ChangeState, Described, Header, Imu, JointState, LaserScan,
    MotionRequest, MotionState, NodeStatus, Odometry, ParameterChange, Pose, SensorPair,
    SensorState, SetParameter, TransitionEvent, VelocityCommand,
};

/// A sample that can travel on a topic.
pub trait Message: ZeroCopySend + Pod + Default + Debug {
    /// Its header.
    fn header(&self) -> &Header;

    /// Its header, to be written by the port that sends it.
    fn header_mut(&mut self) -> &mut Header;
}

/// What happens to a sample that finds a reader's queue full, or no reader at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// The oldest queued sample makes room; one who comes late sees only what comes later.
    KeepNewest,
    /// The same, and one who comes late first sees the newest sample that was ever sent.
    Latched,
}

/// Whose a topic is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The robot has one.
    Robot,
    /// Every node has one of its own, `NODE/name`.
    Node,
}

/// One row of the table.
#[derive(Debug)]
pub struct Topic<T> {
    /// [-] The topic's name, without a leading slash.
    pub name: &'static str,
    /// Whose it is.
    pub scope: Scope,
    /// [-] Samples that a reader's queue holds.
    pub depth: usize,
    /// [-] The age past which a sample says nothing any more.
    pub deadline: Duration,
    /// What happens where a queue is full.
    pub loss: Loss,
    /// [-] The only one who publishes, by role.
    pub publisher: &'static str,
    message: PhantomData<T>,
}

impl<T: Message> Topic<T> {
    /// A topic that the robot has once, `depth` deep, that keeps the newest.
    pub const fn new(
        name: &'static str,
        depth: usize,
        deadline: Duration,
        publisher: &'static str,
    ) -> Self {
        Self {
            name,
            scope: Scope::Robot,
            depth,
            deadline,
            loss: Loss::KeepNewest,
            publisher,
            message: PhantomData,
        }
    }

    const fn of_each_node(mut self) -> Self {
        self.scope = Scope::Node;
        self
    }

    const fn latched(mut self) -> Self {
        self.loss = Loss::Latched;
        self
    }

    /// The full name: `scan`, or `odometry/status`.
    pub fn full_name(&self, node: &str) -> String {
        match self.scope {
            Scope::Robot => self.name.to_owned(),
            Scope::Node => format!("{node}/{}", self.name),
        }
    }
}

/// [-] As deep as the lab's queues.
const DEPTH: usize = 10;

/// [-] A scan of the slowest LiDAR, 5 Hz, is stamped with its first ray and a turn old when it comes;
/// what the robot did then, at 50 Hz, is still to be found when it is driven by, half a second later.
const DEPTH_ODOMETRY: usize = 32;

/// Two periods of the lab's 20 Hz may go missing before data is stale.
const DEADLINE: Duration = Duration::from_millis(150);

/// Two periods of 10 Hz may go missing before data is stale.
const DEADLINE_SLOW: Duration = Duration::from_millis(300);

/// Longer than any of the supervisor's own pauses.
const DEADLINE_LIFECYCLE: Duration = Duration::from_secs(5);

/// The LiDAR's turns.
pub const SCAN: Topic<LaserScan> = Topic::new("scan", DEPTH, DEADLINE, "simulator or bridge");

/// The wheels' encoders.
pub const JOINT_STATES: Topic<JointState> =
    Topic::new("joint_states", DEPTH, DEADLINE, "simulator or bridge");

/// The pose that the robot itself reports, where it reports no wheels.
pub const ROBOT_POSE: Topic<Pose> =
    Topic::new("robot_pose", DEPTH, DEADLINE, "simulator or bridge");

/// How the robot stands and is moved; the sample with a wheels' stamp is there before them.
pub const IMU: Topic<Imu> = Topic::new("imu", DEPTH, DEADLINE, "bridge");

/// The battery.
pub const BATTERY_STATE: Topic<BatteryState> =
    Topic::new("battery_state", 4, DEADLINE_LIFECYCLE, "bridge").latched();

/// Buttons, bumpers and motors.
pub const SENSOR_STATE: Topic<SensorState> =
    Topic::new("sensor_state", DEPTH, DEADLINE_SLOW, "bridge");

/// What the robot's board is asked.
pub const BOARD_REQUEST: Topic<BoardRequest> =
    Topic::new("board_request", 4, DEADLINE_LIFECYCLE, "anybody");

/// Pose and velocity from odometry.
pub const ODOMETRY: Topic<Odometry> = Topic::new("odom", DEPTH_ODOMETRY, DEADLINE, "odometry");

/// Tickets for a scan and an odometry sample that belong together.
pub const SENSOR_PAIR: Topic<SensorPair> = Topic::new("sensor_pair", DEPTH, DEADLINE, "supervisor");

/// How the robot shall move; never latched, since a late joiner must not act on an old command.
pub const VELOCITY_COMMAND: Topic<VelocityCommand> =
    Topic::new("cmd_vel", DEPTH, DEADLINE, "controller or multiplexer");

/// How the controller would move the robot, where a multiplexer chooses between several.
pub const AUTONOMY_COMMAND: Topic<VelocityCommand> =
    Topic::new("autonomy_cmd_vel", DEPTH, DEADLINE, "controller");

/// How a person would move the robot.
pub const TELEOP_COMMAND: Topic<VelocityCommand> =
    Topic::new("teleop_cmd_vel", DEPTH, DEADLINE, "teleop");

/// Whether the robot may move, and why not.
pub const MOTION_STATE: Topic<MotionState> =
    Topic::new("motion_state", 16, DEADLINE_LIFECYCLE, "simulator or bridge").latched();

/// What a person asks of whoever drives the wheels.
pub const MOTION_REQUEST: Topic<MotionRequest> =
    Topic::new("motion_request", 4, DEADLINE_LIFECYCLE, "teseo arm");

/// Where a localization believes the robot to be.
pub const POSE: Topic<Pose> = Topic::new("pose", DEPTH, DEADLINE, "a localization");

/// The supervisor's requests to one node.
pub const CHANGE_STATE: Topic<ChangeState> =
    Topic::new("change_state", DEPTH, DEADLINE_LIFECYCLE, "supervisor").of_each_node();

/// One node's changes of state.
pub const TRANSITION_EVENT: Topic<TransitionEvent> =
    Topic::new("transition_event", 16, DEADLINE_LIFECYCLE, "the node").of_each_node().latched();

/// What the supervisor asks of one node's parameters.
pub const SET_PARAMETER: Topic<SetParameter> =
    Topic::new("set_parameter", 2, DEADLINE_LIFECYCLE, "supervisor").of_each_node();

/// What one node made of that.
pub const PARAMETER_CHANGE: Topic<ParameterChange> =
    Topic::new("parameter_change", 2, DEADLINE_LIFECYCLE, "the node").of_each_node();

/// What one node says about itself.
pub const STATUS: Topic<NodeStatus> =
    Topic::new("status", 4, DEADLINE_LIFECYCLE, "the node").of_each_node().latched();

/// What is to be done with a topic of which only the name is known, and so with any of the table.
pub trait Visitor {
    /// What it comes to.
    type Output;

    /// Does it; `owner` is the node whose topic it is, or empty where the robot has one.
    fn visit<T: Described>(self, topic: &'static Topic<T>, owner: &str) -> Self::Output;
}

macro_rules! table {
    ($($topic:ident),* $(,)?) => {
        /// [-] The names of the topics that a robot has once.
        pub fn names() -> Vec<&'static str> {
            names_in(Scope::Robot)
        }

        /// [-] The names of the topics that each node has, without its own.
        pub fn names_of_each_node() -> Vec<&'static str> {
            names_in(Scope::Node)
        }

        fn names_in(scope: Scope) -> Vec<&'static str> {
            let rows = [$(($topic.name, $topic.scope)),*];
            rows.into_iter().filter(|row| row.1 == scope).map(|row| row.0).collect()
        }

        /// Takes `visitor` to the topic of this full name: `scan`, or `odometry/status`. `None` where
        /// the table has none.
        pub fn find<V: Visitor>(full_name: &str, visitor: V) -> Option<V::Output> {
            let (owner, name) = full_name.split_once('/').unwrap_or(("", full_name));
            let scope = if owner.is_empty() { Scope::Robot } else { Scope::Node };
            $(
                if $topic.name == name && $topic.scope == scope {
                    return Some(visitor.visit(&$topic, owner));
                }
            )*
            None
        }
    };
}

table!(
    SCAN,
    JOINT_STATES,
    ROBOT_POSE,
    IMU,
    BATTERY_STATE,
    SENSOR_STATE,
    BOARD_REQUEST,
    ODOMETRY,
    SENSOR_PAIR,
    VELOCITY_COMMAND,
    AUTONOMY_COMMAND,
    TELEOP_COMMAND,
    MOTION_STATE,
    MOTION_REQUEST,
    POSE,
    CHANGE_STATE,
    TRANSITION_EVENT,
    SET_PARAMETER,
    PARAMETER_CHANGE,
    STATUS,
);

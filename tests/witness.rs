//! One who watches a robot's wheels from beside it: whether they may move, and how they do.

use std::time::Duration;

use interfaces::topics::{JOINT_STATES, MOTION_STATE};
use interfaces::{JointState, MotionState, Permission, Stamp, StopCause};
use node::{Session, Subscriber};

use crate::robot::wait_until;

/// [m] A TurtleBot3 Burger's, as the simulator's default.
pub(crate) const WHEEL_RADIUS: f64 = 0.033;

/// Whatever a robot does, it does it sooner, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

/// What was told about the wheels since the witness joined.
pub(crate) struct Witness {
    states: Subscriber<MotionState>,
    joints: Subscriber<JointState>,
    /// Every change, in order.
    pub(crate) told: Vec<MotionState>,
    /// Every measurement of the wheels, in order.
    pub(crate) wheels: Vec<JointState>,
    /// [-] Of `told`, those that were awaited already.
    awaited: usize,
}

impl Witness {
    pub(crate) fn new(session: &Session) -> Self {
        Self {
            states: session.subscriber(&MOTION_STATE).unwrap(),
            joints: session.subscriber(&JOINT_STATES).unwrap(),
            told: Vec::new(),
            wheels: Vec::new(),
            awaited: 0,
        }
    }

    /// Takes in all that has come.
    pub(crate) fn look(&mut self) {
        while let Some(state) = self.states.receive().unwrap() {
            self.told.push(*state);
        }
        while let Some(joints) = self.joints.receive().unwrap() {
            self.wheels.push(*joints);
        }
    }

    /// What was told so far is awaited no more.
    pub(crate) fn forget(&mut self) {
        self.awaited = self.told.len();
    }

    /// Watches until `is_enough` holds; false where it never did.
    pub(crate) fn watch_until(&mut self, mut is_enough: impl FnMut(&Self) -> bool) -> bool {
        wait_until(PATIENCE, || {
            self.look();
            is_enough(self)
        })
    }

    /// Watches for this long.
    pub(crate) fn watch_for(&mut self, duration: Duration) {
        wait_until(duration, || {
            self.look();
            false
        });
    }

    /// The first state from now on that is this one.
    #[track_caller]
    pub(crate) fn await_state(&mut self, permission: Permission, cause: StopCause) -> MotionState {
        let is_it = |state: &MotionState| {
            state.permission == permission as u8 && state.cause == cause as u8
        };
        let from = self.awaited;
        let found = self.watch_until(|witness| witness.told[from..].iter().any(is_it));
        assert!(found, "never {permission:?} for {cause:?}, but {:?}", self.told.last());
        self.awaited = from + 1 + self.told[from..].iter().position(is_it).unwrap();
        self.told[self.awaited - 1]
    }

    /// [m] How far the wheel that turned more has rolled between two moments.
    pub(crate) fn way(&self, from: Stamp, until: Stamp) -> f64 {
        let (from, until) = (self.position(from), self.position(until.max(from)));
        let turned = [until[0] - from[0], until[1] - from[1]].map(f64::abs);
        WHEEL_RADIUS * turned[0].max(turned[1])
    }

    /// [rad] The wheels' positions at a moment, between the measurements around it; beyond the last
    /// one, as if the wheels had kept their speed.
    fn position(&self, moment: Stamp) -> [f64; 2] {
        let later = self.wheels.partition_point(|joints| joints.header.stamp < moment);
        let before = &self.wheels[later.saturating_sub(1)];
        let gone = moment.since(before.header.stamp).as_secs_f64();
        let speed = |wheel: usize| match self.wheels.get(later) {
            Some(after) if 0 < later => {
                let period = after.header.stamp.since(before.header.stamp).as_secs_f64();
                (after.position[wheel] - before.position[wheel]) / period
            }
            _ => before.velocity[wheel],
        };
        [0, 1].map(|wheel| before.position[wheel] + speed(wheel) * gone)
    }
}

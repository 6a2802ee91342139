//! Whether the robot may move, as whoever drives its wheels tells it: for people and programs.

use interfaces::topics::MOTION_STATE;
use interfaces::{MotionState, Permission, StopCause};
use node::deadman::Rejection;
use node::{Result, Session, Subscriber};
use serde_json::{Value, json};

/// The newest word about the robot's motion.
#[derive(Debug)]
pub(crate) struct Motion {
    states: Subscriber<MotionState>,
    newest: Option<MotionState>,
}

impl Motion {
    pub(crate) fn new(session: &Session) -> Result<Self> {
        Ok(Self { states: session.subscriber(&MOTION_STATE)?, newest: None })
    }

    /// The next change that is worth a line: the line, and all that is known.
    pub(crate) fn hear(&mut self) -> Result<Option<(String, Value)>> {
        while let Some(state) = self.states.receive()? {
            let former = self.newest.replace(*state);
            if let Some(text) = sentence(former.as_ref(), &state) {
                return Ok(Some((text, describe(&state))));
            }
        }
        Ok(None)
    }

    /// Why the robot stands still, where that is not because its commands say so.
    pub(crate) fn hold(&self) -> Option<String> {
        let held = |state: &&MotionState| state.permission == Permission::Held as u8;
        self.newest.as_ref().filter(held).and_then(|state| sentence(None, state))
    }

    /// As the control socket tells it; null where nobody drives wheels.
    pub(crate) fn status(&self) -> Value {
        self.newest.as_ref().map_or(Value::Null, describe)
    }
}

fn sentence(former: Option<&MotionState>, state: &MotionState) -> Option<String> {
    let cause = StopCause::try_from(state.cause).unwrap_or_default();
    let silent = state.header.stamp.since(state.command_received).as_millis();
    let hand = if state.needs_person == 1 { "; a person has to arm it: teseo arm" } else { "" };
    match Permission::try_from(state.permission).ok()? {
        Permission::Armed => {
            let was_held = former.is_some_and(|former| former.permission != state.permission);
            was_held.then(|| "armed: commands move the robot".to_owned())
        }
        Permission::Braking => Some(match cause {
            StopCause::Silence => format!("dead-man: no valid command for {silent} ms, brakes"),
            other => format!("{}: brakes", other.label()),
        }),
        Permission::Held => {
            let was_told = former.is_some_and(|former| {
                former.permission == state.permission
                    && former.cause == state.cause
                    && former.needs_person == state.needs_person
                    && former.emergency_stop == state.emergency_stop
            });
            (!was_told).then(|| match cause {
                StopCause::EmergencyStop if state.emergency_stop == 0 => {
                    "emergency stop released: waits for commands that begin with zero".to_owned()
                }
                StopCause::EmergencyStop => {
                    "emergency stop: stands still until teseo estop --clear".to_owned()
                }
                other => format!("{}: stands still{hand}", other.label()),
            })
        }
    }
}

fn describe(state: &MotionState) -> Value {
    let permission = Permission::try_from(state.permission).map_or("unknown", Permission::label);
    let cause = StopCause::try_from(state.cause).unwrap_or_default();
    let rejected = Rejection::ALL.map(|reason| (reason.key(), state.rejected[reason as usize]));
    json!({
        "permission": permission,
        "cause": cause.label(),
        "needs_person": state.needs_person == 1,
        "emergency_stop": state.emergency_stop == 1,
        "trips": state.trips,
        "accepted": state.accepted,
        "rejected": rejected.into_iter().collect::<std::collections::BTreeMap<_, _>>(),
        "since_s": state.header.stamp.seconds(),
        "command_received_s": state.command_received.seconds(),
        "command_epoch": state.command_epoch,
        "command_sequence": state.command_sequence,
    })
}

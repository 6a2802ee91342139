//! What a person is shown: how they drive, and whether the robot may move at all.

use interfaces::{MotionState, Permission, StopCause};
use node::deadman::Motion;

/// Whether the robot may move, as far as anybody has said.
pub(crate) fn may_move(state: Option<&MotionState>) -> bool {
    state.is_none_or(|state| Permission::try_from(state.permission) == Ok(Permission::Armed))
}

/// One line, short enough for any terminal.
pub(crate) fn line(
    robot: &str,
    motion: Option<Motion>,
    state: Option<&MotionState>,
    is_heard: bool,
) -> String {
    let driving = motion.map_or("the first key takes over".to_owned(), |motion| {
        format!("{:5.2} m/s {:5.2} rad/s", motion.linear, motion.angular)
    });
    let permission = match state {
        _ if !is_heard => "no multiplexer listens".to_owned(),
        None => "nobody says whether it may move".to_owned(),
        Some(state) => permission(state),
    };
    format!("{robot}: {driving}; {permission}")
}

fn permission(state: &MotionState) -> String {
    let cause = StopCause::try_from(state.cause).map_or("unknown cause", StopCause::label);
    let what = match Permission::try_from(state.permission) {
        Ok(Permission::Armed) => return "armed".to_owned(),
        Ok(Permission::Braking) => "braking",
        Ok(Permission::Held) => "held",
        Err(_) => "in an unknown state",
    };
    let help = match state {
        _ if state.cause == StopCause::SupervisorLost as u8 => "",
        _ if state.emergency_stop != 0 => ", until `teseo estop --clear`",
        _ if state.needs_person != 0 => ", needs `teseo arm`",
        _ => "",
    };
    format!("{what}: {cause}{help}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(permission: Permission, cause: StopCause) -> MotionState {
        let (permission, cause) = (permission as u8, cause as u8);
        MotionState { permission, cause, ..MotionState::default() }
    }

    #[test]
    fn a_robot_of_which_nobody_speaks_may_move_and_one_that_is_not_armed_may_not() {
        assert!(may_move(None));
        assert!(may_move(Some(&state(Permission::Armed, StopCause::None))));
        for permission in [Permission::Braking, Permission::Held] {
            assert!(!may_move(Some(&state(permission, StopCause::Silence))));
        }
        let strange = MotionState { permission: 99, ..MotionState::default() };
        assert!(!may_move(Some(&strange)));
    }

    #[test]
    fn the_line_says_how_one_drives_and_what_keeps_the_robot() {
        let motion = Some(Motion { linear: 0.05, angular: -0.1 });
        let armed = state(Permission::Armed, StopCause::None);
        let held = state(Permission::Held, StopCause::Silence);
        let person = MotionState { needs_person: 1, ..held };
        let stopped = state(Permission::Braking, StopCause::EmergencyStop);
        let latched = MotionState { emergency_stop: 1, needs_person: 1, ..stopped };
        let lost = state(Permission::Held, StopCause::SupervisorLost);
        let table = [
            (None, Some(armed), "r: the first key takes over; armed"),
            (motion, Some(armed), "r:  0.05 m/s -0.10 rad/s; armed"),
            (motion, None, "r:  0.05 m/s -0.10 rad/s; nobody says whether it may move"),
            (motion, Some(held), "r:  0.05 m/s -0.10 rad/s; held: dead-man"),
            (motion, Some(person), "r:  0.05 m/s -0.10 rad/s; held: dead-man, needs `teseo arm`"),
            (
                None,
                Some(latched),
                "r: the first key takes over; \
                 braking: emergency stop, until `teseo estop --clear`",
            ),
            (None, Some(lost), "r: the first key takes over; held: supervisor lost"),
        ];
        for (motion, state, expected) in table {
            assert_eq!(line("r", motion, state.as_ref(), true), expected);
        }
        assert!(line("r", motion, Some(&armed), false).ends_with("; no multiplexer listens"));
    }
}

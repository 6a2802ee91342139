//! `teseo estop` and `teseo arm`: whether the robot may move, said to whoever drives its wheels. The
//! supervisor has no part in either.

use std::time::Duration;

use interfaces::topics::{MOTION_REQUEST, MOTION_STATE};
use interfaces::{MotionState, Permission, StopCause};
use node::control::{self, Failure};
use node::{Clock, EmergencyStop, Namespace, Publisher, Session, clock};

use node::say::say;

/// Whoever drives wheels answers within one turn of its loop.
const PATIENCE: Duration = Duration::from_secs(2);

/// Between two looks for the answer.
const POLL: Duration = Duration::from_millis(5);

/// Latches the emergency stop of the robot of this name, or else of every robot that there is: who
/// is in a hurry does not look up a name.
pub(super) fn stop(robot: Option<&str>, reason: &str) -> Result<u8, Failure> {
    let robots = robots(robot)?;
    if robots.is_empty() {
        return Err(Failure::NotRunning(
            "no robot is running; --robot NAME latches it for the next start of that one"
                .to_owned(),
        ));
    }
    for namespace in robots {
        let latch = EmergencyStop::of(&namespace);
        let is_new = latch.latch(&namespace, reason).map_err(|error| refused(&error))?;
        let robot = namespace.robot();
        let before = if is_new { "" } else { "already " };
        say(&format!("robot '{robot}': emergency stop {before}latched; teseo estop --clear\n"))?;
    }
    Ok(0)
}

/// Releases the emergency stop. The robot moves again once commands come that begin with zero.
pub(super) fn release(robot: Option<&str>) -> Result<u8, Failure> {
    for namespace in robots(robot)? {
        let latch = EmergencyStop::of(&namespace);
        let reason = latch.reason().unwrap_or_default();
        let robot = namespace.robot();
        if latch.release().map_err(|error| refused(&error))? {
            say(&format!(
                "robot '{robot}': emergency stop released; it was latched by {reason}\n"
            ))?;
        } else {
            say(&format!("robot '{robot}': the emergency stop is not latched\n"))?;
        }
    }
    Ok(0)
}

fn robots(name: Option<&str>) -> Result<Vec<Namespace>, Failure> {
    let Some(name) = name else {
        return Ok(Namespace::all_under(&Namespace::runtime_directory()));
    };
    let named = Namespace::new(name).map_err(|error| Failure::Unclear(error.to_string()))?;
    Ok(vec![named])
}

/// Arms a robot that was stopped too often, or has not been armed since its start.
pub(super) fn arm(robot: Option<&str>) -> Result<u8, Failure> {
    let namespace = control::find(robot)?;
    // To join what is not there would make it.
    if !namespace.lock().exists() {
        return Err(control::not_running(&namespace));
    }
    let status = control::look(&namespace);
    let is_lockstep = status.is_some_and(|status| status["clock"] == "lockstep");
    let clock = if is_lockstep { Clock::Lockstep } else { Clock::Realtime };
    let session =
        Session::guest(&namespace, "arm").map_err(|error| refused(&error))?.with_clock(clock);
    let mut answers = session.subscriber(&MOTION_STATE).map_err(|error| refused(&error))?;
    let mut requests = session.publisher(&MOTION_REQUEST).map_err(|error| refused(&error))?;
    let until = clock::now().after(PATIENCE);
    let mut asked = false;
    loop {
        let newest = answers.latest().map_err(|error| refused(&error))?;
        // What was told before the request may come after it.
        if asked && let Some(state) = newest.filter(|state| state.needs_person == 0) {
            // Armed under an emergency stop it moves no more than before.
            let code = u8::from(state.emergency_stop == 1);
            return say(&outcome(namespace.robot(), &state)).map(|()| code);
        }
        if !asked && 0 < requests.readers() {
            ask(&mut requests)?;
            asked = true;
        }
        if until <= clock::now() {
            let robot = namespace.robot();
            let why = format!("robot '{robot}': whoever drives its wheels does not answer");
            return Err(Failure::TooLong(why));
        }
        control::check_stop()?;
        clock::nap(POLL);
    }
}

fn ask(requests: &mut Publisher<interfaces::MotionRequest>) -> Result<(), Failure> {
    let send = requests.send_with(|request| {
        request.header.stamp = clock::now();
        request.arm = 1;
    });
    send.map_err(|error| refused(&error))
}

fn outcome(robot: &str, state: &MotionState) -> String {
    let cause = StopCause::try_from(state.cause).unwrap_or_default();
    let what = if state.permission == Permission::Armed as u8 {
        "armed"
    } else if state.emergency_stop == 1 {
        "may be armed, but its emergency stop is latched: teseo estop --clear"
    } else if cause == StopCause::SupervisorLost || cause == StopCause::Paused {
        "is about to go down"
    } else {
        "moves as soon as commands come that begin with zero"
    };
    format!("robot '{robot}': {what}\n")
}

fn refused(error: &node::Error) -> Failure {
    Failure::Refused(error.to_string())
}

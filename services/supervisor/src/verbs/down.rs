//! `teseo down`: returns when the next `teseo up` would find nothing in its way.

use std::fs;
use std::time::Duration;

use node::control::{self, Connection, Failure, Heard, Request, told};
use node::{Namespace, clock};
use rustix::fs::FlockOperation;
use serde_json::Value;

use crate::{guardian, last_words};
use node::say::{say, shown};

/// Between two looks at what is left.
const POLL: Duration = Duration::from_millis(5);

/// Takes the robot down. One that does not run is down already.
pub(super) fn down(robot: Option<&str>, wait: Duration) -> Result<u8, Failure> {
    let until = clock::now().after(wait);
    let opened = control::find(robot)
        .and_then(|namespace| Ok((Connection::open(&namespace, &Request::Down)?, namespace)));
    let (mut connection, namespace) = match opened {
        Ok(opened) => opened,
        Err(Failure::NotRunning(why)) => return say(&why).map(|()| 0),
        Err(failure) => return Err(failure),
    };
    let robot = namespace.robot();
    let late = || Failure::TooLong(format!("robot '{robot}' is still going down after {wait:?}"));
    let mut guardian = control::guardian(&namespace);
    let ended = loop {
        match connection.hear(Some(until))? {
            Heard::Line(line) => {
                let answer = told(&line)?;
                if let Some(ended) = answer.get("ended") {
                    break Some(ended.clone());
                }
                let pid = answer["guardian"].as_u64().and_then(|pid| u32::try_from(pid).ok());
                guardian = pid.or(guardian);
            }
            Heard::End => break None,
            Heard::Nothing => return Err(late()),
        }
    };
    while !is_free(&namespace, guardian) {
        if until <= clock::now() {
            return Err(late());
        }
        clock::nap(POLL);
    }
    last_words::forget(&namespace);
    conclude(robot, ended.as_ref())
}

/// Whether nothing of the run that had this guardian holds the robot any more.
fn is_free(namespace: &Namespace, guardian: Option<u32>) -> bool {
    if guardian.is_some_and(guardian::is_alive) {
        return false;
    }
    let Ok(lock) = fs::File::open(namespace.lock()) else { return true };
    let holder = fs::read_to_string(namespace.lock()).unwrap_or_default();
    if holder.trim().parse().ok() != guardian {
        // The next run has begun.
        return true;
    }
    // The guardian is dead, so that whoever is turned away meanwhile tries again; its supervisor
    // may be about to remove what is left.
    rustix::fs::flock(&lock, FlockOperation::NonBlockingLockShared).is_ok()
}

fn conclude(robot: &str, ended: Option<&Value>) -> Result<u8, Failure> {
    let Some(ended) = ended else {
        return Err(Failure::Refused(format!(
            "robot '{robot}' is down; its supervisor was killed"
        )));
    };
    let cause = shown(ended["cause"].as_str().unwrap_or_default());
    say(&format!("robot '{robot}' is down: {cause}"))?;
    Ok(ended["code"].as_u64().and_then(|code| u8::try_from(code).ok()).unwrap_or(1))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_exit_code_is_the_run_s_own() {
        let killed = json!({ "code": 6, "cause": "asked to stop; a node had to be killed" });

        assert!(matches!(conclude("burger", Some(&killed)), Ok(6)));
        assert!(matches!(conclude("burger", Some(&json!({}))), Ok(1)));
        assert!(matches!(conclude("burger", None), Err(Failure::Refused(_))));
    }
}

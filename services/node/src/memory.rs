//! Memory: how much of it a robot shares, and keeping it from ever being paged.

use interfaces::topics::{
    AUTONOMY_COMMAND, BATTERY_STATE, CHANGE_STATE, IMU, JOINT_STATES, ODOMETRY, PARAMETER_CHANGE,
    POSE, ROBOT_POSE, SCAN, SENSOR_PAIR, SENSOR_STATE, SET_PARAMETER, STATUS, TELEOP_COMMAND,
    TRANSITION_EVENT, VELOCITY_COMMAND,
};
use interfaces::{Message, Topic};
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};

use crate::launch::Launch;
use crate::session::{BORROWED_SPARE, SUBSCRIBERS_MAX};
use crate::{Clock, Error, Result, Settings};

/// [byte] A sample's header in the transport, and what alignment costs.
const SAMPLE_OVERHEAD: usize = 64;

/// [byte] Beside the samples: the tables of topics, channels and connections, for each process.
const TABLES_PER_PROCESS: usize = 512 * 1024;

/// Keeps this process's memory from being paged, where it should be and may be. What is mapped
/// later is locked too where no limit could make that fail in motion.
pub(crate) fn lock(settings: &Settings) -> Result {
    let process = settings.launch().process(settings.name());
    let wanted = process.and_then(|process| process.memory_lock);
    let is_usual = settings.clock() == Clock::Realtime && settings.heeds_signals();
    if !wanted.unwrap_or(is_usual) {
        return Ok(());
    }
    let limit = getrlimit(Resource::Memlock).current;
    let flags = match limit {
        None => MlockAllFlags::CURRENT | MlockAllFlags::FUTURE,
        Some(_) => MlockAllFlags::CURRENT,
    };
    match mlockall(flags) {
        Err(cause) if wanted == Some(true) => {
            let limit = limit.map_or(String::new(), |limit| format!(" of {} KiB", limit / 1024));
            let help = "raise it (ulimit -l, LimitMEMLOCK=), or leave out `memory_lock`";
            let why = format!("cannot lock its memory within the limit{limit}: {cause}; {help}");
            Err(Error::Fault(why))
        }
        Err(cause) => {
            tracing::debug!(%cause, "memory is not locked");
            Ok(())
        }
        Ok(()) => Ok(()),
    }
}

/// [byte] The shared memory that the robot of `launch` takes at the most.
pub(crate) fn need(launch: &Launch) -> u64 {
    // The pairing is a node too, and so is the supervisor, as far as tables go.
    let nodes = launch.process.len() + 1;
    let of_robot = segment(&SCAN)
        + segment(&JOINT_STATES)
        + segment(&ROBOT_POSE)
        + segment(&IMU)
        + segment(&BATTERY_STATE)
        + segment(&SENSOR_STATE)
        + segment(&ODOMETRY)
        + segment(&SENSOR_PAIR)
        + segment(&VELOCITY_COMMAND)
        + segment(&AUTONOMY_COMMAND)
        + segment(&TELEOP_COMMAND)
        + segment(&POSE);
    let of_node = segment(&CHANGE_STATE)
        + segment(&TRANSITION_EVENT)
        + segment(&STATUS)
        + segment(&SET_PARAMETER)
        + segment(&PARAMETER_CHANGE);
    (of_robot + nodes * of_node + (nodes + 1) * TABLES_PER_PROCESS) as u64
}

/// [byte] What the one publisher of a topic holds: for each reader a full queue and what it has
/// borrowed, one sample at hand, and one latched.
fn segment<T: Message>(topic: &Topic<T>) -> usize {
    let samples = SUBSCRIBERS_MAX * (2 * topic.depth + BORROWED_SPARE) + 2;
    samples * (size_of::<T>() + SAMPLE_OVERHEAD)
}

//! What a robot at rest on the desk costs: processors, memory, and how long it takes to start.

use std::time::Duration;

use node::{Error, Namespace, Result, Wait, clock};

use crate::Effort;
use crate::measured::{Unit, Values};
use crate::robot::{Cores, Robot, processor_time};

/// A robot at the lab's 20 Hz, by how it waits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cost {
    robot: Robot,
}

/// [Hz]
const RATE: u32 = 20;

/// Until what a start costs is over.
const SETTLE: Duration = Duration::from_millis(1_200);

/// How long the processors' time is counted.
const WINDOW: Duration = Duration::from_secs(2);

/// Who is asked for.
const PROCESSES: [&str; 4] = ["supervisor", "odometry", "controller", "simulator"];

/// Each way to wait.
pub(crate) fn configurations() -> Vec<Cost> {
    let robot = |wait| Robot {
        wait,
        cores: Cores::Any,
        rate: Some(RATE),
        length_s: 4.0,
        beams: 240,
        more_walls: 0,
    };
    Wait::ALL.map(|wait| Cost { robot: robot(wait) }).into()
}

impl Cost {
    /// What it yields, in the order of [`Cost::measure`].
    pub(crate) fn names(&self) -> Vec<(String, Unit)> {
        let wait = self.robot.wait.label();
        let share = PROCESSES.map(|process| {
            let process = if process == "supervisor" { "supervisor and pairing" } else { process };
            (format!("{process}, share of a core, {wait}, {RATE} Hz"), Unit::PercentOfACore)
        });
        let memory = (format!("largest process, memory, {wait}"), Unit::Kibibytes);
        let ready = (format!("from `teseo up` until data flows, {wait}"), Unit::Nanoseconds);
        share.into_iter().chain([memory, ready]).collect()
    }

    /// One round.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        let (settle, window) = match effort {
            Effort::Whole => (SETTLE, WINDOW),
            Effort::Quick => (SETTLE / 2, WINDOW / 10),
        };
        let mut robot = self.robot;
        robot.length_s = (2 * settle + window).as_secs_f64();
        let running = robot.start(namespace, 0)?;
        clock::nap(settle);
        let before = used(&running.processes());
        let begun = clock::now();
        clock::nap(window);
        let after = used(&running.processes());
        let wall = clock::now().since(begun).as_nanos() as f64;
        let ran = running.finish()?;
        let mut values = Vec::new();
        for (before, after) in before.iter().zip(after) {
            let used = after.zip(*before).map(|(after, before)| after - before);
            let used = used.ok_or_else(|| Error::Fault("a process was not found".to_owned()))?;
            values.push(Values::One(100.0 * used / wall));
        }
        let peaks = ran.report["memory_peak_kib"].as_object().into_iter().flatten();
        let peaks = peaks.filter_map(|(_, peak)| peak.as_f64());
        values.push(Values::One(peaks.fold(0.0, f64::max)));
        values.push(Values::One(ran.ready_ms * 1e6));
        Ok(values)
    }
}

/// [ns] What each of [`PROCESSES`] has used so far.
fn used(processes: &[(String, u32)]) -> [Option<f64>; 4] {
    PROCESSES.map(|name| {
        let process = processes.iter().find(|(process, _)| process == name);
        process.and_then(|(_, id)| processor_time(*id))
    })
}

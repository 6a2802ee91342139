//! A machine that has no time: nobody is taken for hung who only waits for a processor.
//!
//! `LASTS` is for how many seconds; scripts/hogs takes ten minutes.

use std::process::{Child, Command};

use crate::robot::{Robot, lasts};

/// The robot that bears noise, and goes round and round.
const ROBOT: &str = include_str!("../config/noisy_simulation.toml");

/// [s] In a test, for both watchdogs together.
const LASTS: u64 = 5;

/// [-] As many as there are processors twice, on a small machine.
const HOGS: usize = 4;

/// One process that never rests.
struct Hog(Child);

impl Hog {
    fn new() -> Self {
        Self(Command::new("sh").args(["-c", "while :; do :; done"]).spawn().unwrap())
    }
}

impl Drop for Hog {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

// Broken on purpose: with a watchdog of 20 ms, nodes were killed.
#[test]
fn beside_processes_that_never_rest_no_node_is_taken_for_hung() {
    let _hogs: Vec<_> = (0..HOGS).map(|_| Hog::new()).collect();
    for watchdog_ms in [300, 500] {
        let robot = Robot::new();
        let supervised = |name: &str| {
            format!("name = \"{name}\"\nrestart = \"on-failure\"\nwatchdog_ms = {watchdog_ms}")
        };
        let nodes = ["odometry", "controller", "simulator"].map(|name| {
            let plain = format!("name = \"{name}\"");
            (plain, supervised(name))
        });
        let mut changes: Vec<_> =
            nodes.iter().map(|(old, new)| (old.as_str(), new.as_str())).collect();
        changes.push(("clock = \"lockstep\"", "clock = \"realtime\""));
        // As in lab_robot.toml, whose clock is the same.
        changes.push(("slop_ms = 10000.0", "slop_ms = 150.0"));
        changes.push(("max_age_ms = 10000.0", "max_age_ms = 500.0"));
        let launch_file = robot.launch_file_from(ROBOT, &changes);
        let half = lasts(LASTS) / 2;
        let run = robot.start_up(&[&launch_file]).await_count("READY", 1).go_on(half);
        let ended = run.stop();

        let figure = |node: &str, name: &str| ended.figure(node, name);
        let milliseconds = |name: &str| figure("simulator", name) / 1e3;
        println!(
            "F24 {HOGS} hogs for {half:?}, watchdog {watchdog_ms} ms: {} failures, {} dead-man trips, \
             collisions {}, simulator {} overruns of 10 ms, late p50 {:.2} p99 {:.2} max {:.2} ms",
            ended.out.matches("failed").count(),
            figure("simulator", "dead_man_trips"),
            figure("simulator", "collisions"),
            figure("simulator", "overruns"),
            milliseconds("late_p50_us"),
            milliseconds("late_p99_us"),
            milliseconds("late_max_us"),
        );
        assert!(!ended.out.contains("failed"), "{}", ended.story());
        assert!(0.0 < figure("simulator", "distance_m"), "{}", ended.story());
    }
}

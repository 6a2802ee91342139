//! A node killed in the middle of its start-up, at each of its system calls: the robot comes up all
//! the same, without hands. Needs strace.
//!
//! `STRIDE` says every how many calls; scripts/kill-points takes each.

use std::collections::BTreeMap;
use std::process::Command;
use std::time::Duration;

use node::clock;

use crate::robot::Robot;

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// [-] Of some 400 calls, as many as a test has time for.
const STRIDE: usize = 40;

#[test]
fn a_node_killed_at_any_system_call_of_its_start_up_comes_up_again() {
    if Command::new("strace").arg("-V").output().is_err() {
        println!("skipped: there is no strace, with which to kill a process at a system call");
        return;
    }
    let stride = std::env::var("STRIDE").map_or(STRIDE, |text| text.parse().unwrap());
    for node in ["simulator", "odometry", "controller"] {
        let points = start_up_calls(node);
        let mut worst = Duration::ZERO;
        let mut count = 0;
        for (call, number) in points.iter().step_by(stride) {
            worst = worst.max(come_up_in_spite_of(node, call, *number));
            count += 1;
        }
        assert!(0 < count, "{node} made no system call");
        println!(
            "{node}: killed at {count} of {} calls, ready again after {worst:?} at most",
            points.len()
        );
    }
}

/// The system calls of a node until it is active: each by name and how often it had been made.
fn start_up_calls(node: &str) -> Vec<(String, usize)> {
    let robot = Robot::new();
    let trace = robot.file("trace", "");
    let launch_file = under_strace(&robot, node, &format!("-o {trace}"));
    robot.start_up(&[&launch_file]).await_count("READY", 1).stop();
    let mut counts = BTreeMap::new();
    let text = std::fs::read_to_string(&trace).unwrap();
    // READY=1 is the last thing of a start.
    let start_up = text.lines().take_while(|line| !line.contains("READY=1"));
    let calls =
        start_up.filter_map(|line| line.split_whitespace().find_map(|word| word.split_once('(')));
    let calls = calls
        .filter(|(call, _)| call.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_'));
    calls
        .map(|(call, _)| {
            let count = counts.entry(call.to_owned()).and_modify(|count| *count += 1).or_insert(1);
            (call.to_owned(), *count)
        })
        .collect()
}

/// Kills the first life of the node at its `number`th `call`; returns how long the robot took to be
/// ready.
fn come_up_in_spite_of(node: &str, call: &str, number: usize) -> Duration {
    let robot = Robot::new();
    let injection = format!("-o /dev/null -e inject={call}:signal=KILL:when={number}");
    let launch_file = under_strace(&robot, node, &injection);
    let begun = clock::now();
    let run = robot.start_up(&[&launch_file]).await_output("READY");
    let took = clock::now().since(begun);
    println!("{node} killed at {call} {number}: ready after {took:?}");
    let ended = run.wait_or(|_| true).unwrap_or_else(|run| run.stop());
    ended.assert_code(0);
    robot.assert_nothing_left();
    took
}

/// `config/lab_robot.toml` with the first life of `node` under strace.
fn under_strace(robot: &Robot, node: &str, options: &str) -> String {
    let teseo = env!("CARGO_BIN_EXE_teseo");
    // The tracer as a grandchild: the node keeps the process id that the supervisor knows.
    let shell = format!(
        "[ $TESEO_EPOCH = 1 ] && exec strace -D -qq {options} {teseo} __exec --parent=$PPID -- {teseo} {node} \\\"$@\\\"; \
         exec {teseo} {node} \\\"$@\\\""
    );
    let name = format!("name = \"{node}\"\n");
    let traced = format!("{name}exec = [\"/bin/sh\", \"-c\", \"{shell}\", \"sh\"]\n");
    robot.launch_file_from(
        LAB_ROBOT,
        &[(&name, &traced), ("watchdog_ms = 500", "start_timeout_ms = 3000")],
    )
}

//! `teseo doctor` looks at everything once, and tells what is left of former runs from what is in use.

use std::fs::{self, File};
use std::io::Write;
use std::path::PathBuf;

use rustix::fs::FlockOperation;
use serde_json::Value;

use crate::emulated::Emulated;
use crate::robot::{Ended, Robot};

const TOPICS: [&str; 15] = [
    "launch file",
    "shared memory",
    "locked memory",
    "real-time priority",
    "open files",
    "serial ports",
    "runtime directory",
    "former runs",
    "running robots",
    "processors",
    "waiting",
    "frequency scaling",
    "clock source",
    "systemd",
    "logout",
];

/// [-] No process has this number: the kernel's highest is below.
const NOBODY: u32 = 1 << 30;

#[test]
fn every_topic_is_named_once_and_something_is_wrong_with_an_exit_code_of_one_alone() {
    let robot = Robot::new();
    let ended = robot.start(&["doctor"]).wait();

    let topic = |line: &str| {
        let (level, rest) = (line.get(..9)?.trim_end(), line.get(9..29)?.trim_end());
        ["ok", "note", "warning", "failure"].contains(&level).then(|| rest.to_owned())
    };
    let topics: Vec<_> = ended.out.lines().filter_map(topic).collect();
    assert_eq!(topics, TOPICS, "{}", ended.story());
    let has_failure = ended.out.lines().any(|line| line.starts_with("failure "));
    ended.assert_code(i32::from(has_failure));
    assert!(!ended.out.contains('\x1b'), "colours for no terminal\n{}", ended.story());
    robot.assert_nothing_left();
}

#[test]
fn programs_get_the_same_as_json() {
    let robot = Robot::new();
    let ended = robot.start(&["doctor", "--json"]).wait();

    let whats: Vec<_> = findings(&ended).iter().map(|finding| finding["what"].clone()).collect();
    assert_eq!(whats, TOPICS, "{}", ended.story());
    for finding in findings(&ended) {
        let is_well = finding["level"] == "ok";
        let mend = finding["mend"].as_array().unwrap();
        assert_eq!(mend.is_empty(), is_well, "{finding}");
        assert!(finding["found"].is_string(), "{finding}");
    }
}

#[test]
fn what_a_dead_robot_has_left_is_found_with_the_command_that_removes_it() {
    let robot = Robot::new();
    let (directory, _lock) = leave_directory(&robot, NOBODY);
    let ended = robot.start(&["doctor", "--json"]).wait();
    fs::remove_dir_all(robot.runtime()).unwrap();

    let finding = finding(&ended, "former runs");
    assert_ne!(finding["level"], "ok", "{finding}");
    assert!(finding["found"].as_str().unwrap().contains(&directory), "{finding}");
    let commands = finding["mend"].as_array().unwrap();
    assert!(commands.contains(&"teseo clear --robot burger".into()), "{finding}");
}

#[test]
fn a_robot_that_runs_is_named_with_its_process_and_has_left_nothing() {
    let robot = Robot::new();
    let (directory, lock) = leave_directory(&robot, std::process::id());
    rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).unwrap();
    let ended = robot.start(&["doctor", "--json"]).wait();
    fs::remove_dir_all(robot.runtime()).unwrap();

    let former = finding(&ended, "former runs");
    assert!(!former["found"].as_str().unwrap().contains(&directory), "{former}");
    let running = finding(&ended, "running robots");
    let found = running["found"].as_str().unwrap();
    let who = format!("'burger' by process {} in {directory}", std::process::id());
    assert!(found.contains(&who), "{found}");
    let commands = running["mend"].as_array().unwrap();
    assert!(commands.contains(&"teseo down --robot burger".into()), "{running}");
}

#[test]
fn a_processor_that_is_not_there_is_a_failure_which_names_it() {
    let robot = Robot::new();
    let bound = "name = \"controller\"\ncpu_affinity = [999]";
    let pairing = "[pairing]\ncpu_affinity = [998]";
    let file = robot.launch_file(&[("name = \"controller\"", bound), ("[pairing]", pairing)]);
    let ended = robot.start(&["doctor", &file, "--json"]).wait();

    ended.assert_code(1);
    let finding = finding(&ended, "processors");
    assert_eq!(finding["level"], "failure", "{finding}");
    let found = finding["found"].as_str().unwrap();
    assert!(found.contains("`pairing` on 998, `controller` on 999"), "{finding}");
}

#[test]
fn a_robot_s_ports_are_looked_at_where_it_would_look_for_them() {
    let robot = Robot::new();
    let emulated = Emulated::start(&robot, &[]);
    let (board, lidar) = (emulated.port("board"), emulated.port("lidar"));
    let ports = |board: &str, lidar: &str| {
        let sets =
            [format!("turtlebot3.board_port={board}"), format!("turtlebot3.lidar_port={lidar}")];
        let words =
            ["doctor", "config/turtlebot3.toml", "--json", "--set", &sets[0], "--set", &sets[1]];
        finding(&robot.start(&words).wait(), "serial ports")
    };
    let well = ports(&board, &lidar);
    assert_eq!(well["level"], "ok", "{well}");
    let none = ports("/dev/null", "/dev/teseo-nobody");
    assert_eq!(none["level"], "failure", "{none}");
    let found = none["found"].as_str().unwrap();
    assert!(found.starts_with("/dev/null is no serial port: set `board_port`"), "{none}");
    assert!(
        found.ends_with("/dev/teseo-nobody is not there: plug it in, or set `lidar_port`"),
        "{none}"
    );
    emulated.stop();
}

#[test]
fn a_wrong_launch_file_is_a_failure_and_the_rest_is_looked_at_all_the_same() {
    let robot = Robot::new();
    let file = robot.launch_file(&[("seed = 1", "sead = 1")]);
    let ended = robot.start(&["doctor", &file, "--json"]).wait();

    ended.assert_code(1).assert_says(&["`sead`", "did you mean `seed`?"]);
    assert_eq!(finding(&ended, "launch file")["level"], "failure", "{}", ended.story());
    assert_eq!(findings(&ended).len(), TOPICS.len());
}

/// What a robot called burger leaves that is killed with all its processes; `process` held its lock.
fn leave_directory(robot: &Robot, process: u32) -> (String, File) {
    let directory: PathBuf = robot.runtime().join("burger");
    fs::create_dir_all(&directory).unwrap();
    let mut lock = File::create(directory.join("lock")).unwrap();
    writeln!(lock, "{process}").unwrap();
    (directory.to_str().unwrap().to_owned(), lock)
}

fn findings(ended: &Ended) -> Vec<Value> {
    let parsed: Result<Vec<Value>, _> = serde_json::from_str(&ended.out);
    parsed.unwrap_or_else(|cause| panic!("no JSON: {cause}\n{}", ended.story()))
}

fn finding(ended: &Ended, what: &str) -> Value {
    let found = findings(ended).into_iter().find(|finding| finding["what"] == what);
    found.unwrap_or_else(|| panic!("nothing about '{what}'\n{}", ended.story()))
}

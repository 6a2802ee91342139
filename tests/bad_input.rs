//! Bad input ends a run with a message that names the place, an exit code, and nothing left behind.

use std::time::Duration;

use crate::example::build_trip_meter;
use crate::robot::{Ended, Robot, SIMULATION};

/// The configuration is wrong: do not start me again.
const CONFIG: i32 = 78;

/// The command line is wrong, by the convention of command lines.
const USAGE: i32 = 2;

/// Somebody else runs this robot.
const HELD: i32 = 5;

const LAB02: &str = include_str!("../config/worlds/lab02.toml");

#[test]
fn a_start_inside_a_wall_is_refused_by_file_and_wall() {
    let text = LAB02.replacen("x_m = 1.0\n", "x_m = 1.18\n", 1);
    let ended = refused_world(&text);

    ended.assert_code(CONFIG).assert_says(&["world.toml", "`outer`", "`outer_right`"]);
}

#[test]
fn a_nan_in_a_world_is_refused_by_file_line_and_key() {
    let text = LAB02.replacen("y_m = -1.25", "y_m = nan", 1);
    let ended = refused_world(&text);

    ended.assert_code(CONFIG).assert_says(&["world.toml:10:", "`box[0].y_m`", "nan"]);
}

#[test]
fn an_unknown_key_in_a_world_is_refused_with_a_suggestion() {
    let text = LAB02.replacen("size_y_m = 0.1", "size_ym = 0.1", 1);
    let ended = refused_world(&text);

    ended.assert_code(CONFIG);
    ended.assert_says(&["world.toml:12:", "`box[0].size_ym`", "did you mean `size_y_m`?"]);
}

#[test]
fn a_world_that_is_no_toml_is_refused_by_file_and_line() {
    let text = LAB02.replacen("size_y_m = 0.1", "size_y_m 0.1", 1);
    let ended = refused_world(&text);

    ended.assert_code(CONFIG).assert_says(&["world.toml:12:"]);
}

#[test]
fn a_wall_of_negative_size_is_refused_by_file_wall_and_key() {
    let text = LAB02.replacen("size_y_m = 0.1", "size_y_m = -0.1", 1);
    let ended = refused_world(&text);

    ended.assert_code(CONFIG).assert_says(&["`outer_bottom`", "`size_y_m`", "-0.1"]);
    assert!(complaint(&ended).contains("world.toml"), "names no file\n{}", ended.story());
}

#[test]
fn a_world_without_walls_is_refused_by_file() {
    let ended = refused_world("");

    ended.assert_code(CONFIG).assert_says(&["no `box`"]);
    assert!(complaint(&ended).contains("world.toml"), "names no file\n{}", ended.story());
}

#[test]
fn a_missing_world_is_refused_by_name() {
    let ended = refused(&["--world", "config/worlds/lab03.toml"]);

    ended.assert_code(CONFIG).assert_says(&["no such file", "config/worlds/lab03.toml"]);
    // What there is instead, also where worlds are and somebody has not looked.
    ended.assert_says(&["lab02.toml"]);
    let ended = refused(&["--world", "nosuch"]);
    ended.assert_says(&["files in `config/worlds`: `lab02.toml`, `loop.toml`"]);
    refused(&["--world", "loop"]).assert_says(&["did you mean `config/worlds/loop.toml`?"]);
}

#[test]
fn an_unknown_start_is_refused_with_those_there_are() {
    let ended = refused(&["--start", "nowhere"]);

    ended.assert_code(CONFIG).assert_says(&["lab02.toml", "`nowhere`", "`inner`", "`outer`"]);
}

#[test]
fn a_missing_launch_file_is_refused_by_name() {
    let ended = refused(&["config/simulator.toml"]);

    ended.assert_code(CONFIG).assert_says(&["no such file", "config/simulator.toml"]);
    ended.assert_says(&["simulation.toml"]);
}

#[test]
fn a_file_that_is_no_launch_file_is_told_by_what_it_looks_like_and_nothing_else_is() {
    let robot = Robot::new();
    for (file, looks, instead) in [
        ("config/worlds/lab02.toml", "it looks like a world", "with --world"),
        ("config/controller/lab_robot.toml", "like a node's parameters", "`parameters_file`"),
    ] {
        for verb in [&["check"][..], &["up"], &["up", "--detach"], &["units"]] {
            let ended = robot.start(&[verb, &[file]].concat()).wait();
            ended.assert_code(CONFIG).assert_says(&[looks, instead, file, "1 error"]);
        }
    }
}

#[test]
fn a_controller_that_does_not_exist_is_refused_by_name() {
    let ended = refused_launch_file(&[("lab_simulation.toml", "genius.toml")]);

    ended.assert_code(CONFIG).assert_says(&["no such file", "controller/genius.toml"]);
}

#[test]
fn an_algorithm_that_does_not_exist_is_refused_with_those_there_are() {
    let ended = refused(&["--set", "controller.algorithm=genius"]);

    ended.assert_code(CONFIG);
    ended.assert_says(&["`controller.algorithm`", "genius", "wall_following"]);
}

#[test]
fn a_launch_file_that_is_no_toml_is_refused_by_file_and_line() {
    let line = 1 + SIMULATION.lines().position(|line| line == "seed = 1").unwrap();
    let ended = refused_launch_file(&[("seed = 1", "seed 1")]);

    ended.assert_code(CONFIG).assert_says(&[&format!("launch.toml:{line}:")]);
}

#[test]
fn an_unknown_key_in_a_launch_file_is_refused_with_a_suggestion() {
    let ended = refused_launch_file(&[("queue_size", "queue_sise")]);

    ended.assert_code(CONFIG);
    ended.assert_says(&["launch.toml:", "`pairing.queue_sise`", "did you mean `queue_size`?"]);
}

#[test]
fn all_mistakes_are_told_at_once() {
    let ended = refused_launch_file(&[("queue_size", "queue_sise"), ("seed = 1", "sead = 1")]);

    ended.assert_code(CONFIG).assert_says(&["`pairing.queue_sise`", "`sead`", "2 errors"]);
}

#[test]
fn two_processes_of_one_name_are_refused() {
    let ended = refused_launch_file(&[("name = \"controller\"", "name = \"odometry\"")]);

    ended.assert_code(CONFIG).assert_says(&["odometry"]);
}

#[test]
fn an_unknown_process_in_a_setting_is_refused_with_a_suggestion() {
    let ended = refused(&["--set", "simulatr.start=inner"]);

    ended.assert_code(CONFIG).assert_says(&["`simulatr`", "did you mean `simulator`?"]);
}

#[test]
fn an_unknown_key_in_a_setting_is_refused_with_a_suggestion() {
    let ended = refused(&["--set", "simulator.lidar.beems=100"]);

    ended.assert_code(CONFIG).assert_says(&["`simulator.lidar.beems`", "did you mean `beams`?"]);
}

#[test]
fn a_setting_without_a_value_is_refused() {
    refused(&["--set", "seed"]).assert_code(CONFIG).assert_says(&["KEY=VALUE"]);
}

#[test]
fn a_negative_length_is_refused_by_key() {
    for set in ["simulator.dt_s=-1", "odometry.track_m=-0.1", "pairing.slop_ms=-50"] {
        let (key, _) = set.split_once('=').unwrap();
        refused(&["--set", set]).assert_code(CONFIG).assert_says(&[&format!("`{key}`")]);
    }
}

#[test]
fn a_value_that_is_no_number_is_refused_by_key() {
    for (set, key) in [
        ("odometry.track_m=nan", "`odometry.track_m`"),
        ("simulator.robot_radius_m=wide", "`simulator.robot_radius_m`"),
        ("pairing.slop_ms=inf", "`pairing.slop_ms`"),
    ] {
        refused(&["--set", set]).assert_code(CONFIG).assert_says(&[key]);
    }
}

#[test]
fn a_run_that_shall_last_no_time_is_refused() {
    for seconds in ["--for=-3", "--for=0", "--for=nan", "--for=inf"] {
        refused(&[seconds]).assert_code(USAGE).assert_says(&["'--for <SECONDS>'", "above zero"]);
    }
}

#[test]
fn an_end_that_does_not_exist_is_refused_with_those_there_are() {
    let ended = refused(&["--until", "teatime"]);

    ended.assert_code(USAGE).assert_says(&["'--until <END>'", "teatime", "round-trip", "goal"]);
    refused(&["--set", "until=teatime"]).assert_code(CONFIG).assert_says(&["`round-trip`"]);
}

#[test]
fn a_clock_that_does_not_exist_is_refused_with_those_there_are() {
    let ended = refused(&["--clock", "cuckoo"]);

    ended.assert_code(USAGE);
    ended.assert_says(&["'--clock <CLOCK>'", "cuckoo", "lockstep", "realtime"]);
}

#[test]
fn a_robot_s_name_that_leaves_its_directory_is_refused() {
    let ended = refused(&["--robot", "../burger"]);

    ended.assert_code(USAGE).assert_says(&["'--robot <NAME>'", "1 to 32 of a-z"]);
    refused(&["--set", "robot=../burger"]).assert_code(CONFIG).assert_says(&["`robot`"]);
}

#[test]
fn an_unknown_option_is_refused_with_a_suggestion() {
    refused(&["--sed", "3"]).assert_code(USAGE).assert_says(&["--sed", "--seed"]);
}

#[test]
fn a_report_that_cannot_be_written_fails_the_run_by_file() {
    let robot = Robot::new();
    let report = "/proc/no/such/report.json";
    let ended = robot.start(&["up", "--for", "1", "--report", report]).wait();

    assert_ne!(ended.code, 0, "{}", ended.story());
    ended.assert_says(&[report]);
}

#[test]
fn a_robot_that_runs_already_is_refused_with_its_holder_and_runs_on() {
    let robot = Robot::new();
    let first = robot.start_up(&["--clock", "realtime"]).await_active();

    let second = robot.start(&["up", "--clock", "realtime"]).wait();
    let holder = format!("process {}", first.process().pid);
    second.assert_code(HELD).assert_says(&["'burger' is already running", &holder]);

    first.go_on(Duration::from_millis(200)).stop().assert_counters_close();
}

#[test]
fn two_robots_of_different_names_run_side_by_side() {
    let robot = Robot::new();
    let first = robot.start_up(&["--clock", "realtime"]).await_active();

    let second = robot.start(&["up", "--robot", "waffle", "--for", "5"]).wait();
    second.assert_code(0).assert_says(&["5 s are over"]);

    first.stop().assert_counters_close();
}

/// The run with these arguments has ended with a message, and nothing is left of it.
fn refused(arguments: &[&str]) -> Ended {
    refused_by(&Robot::new(), arguments)
}

fn refused_world(text: &str) -> Ended {
    let robot = Robot::new();
    let world = robot.file("world.toml", text);
    refused_by(&robot, &["--world", &world])
}

fn refused_launch_file(changes: &[(&str, &str)]) -> Ended {
    let robot = Robot::new();
    let launch_file = robot.launch_file(changes);
    refused_by(&robot, &[&launch_file])
}

fn refused_by(robot: &Robot, arguments: &[&str]) -> Ended {
    // Finite even where the input is not refused.
    let finite = if arguments.iter().any(|argument| argument.starts_with("--for")) {
        arguments.to_vec()
    } else {
        [arguments, &["--for", "1"]].concat()
    };
    let ended = robot.up(&finite);
    assert_ne!(ended.code, 0, "{}", ended.story());
    assert!(!ended.err.trim().is_empty(), "no message\n{}", ended.story());
    robot.assert_nothing_left();
    ended
}

/// What the process that found the mistake says about it, and the run's own last line.
fn complaint(ended: &Ended) -> String {
    let last = ended.out.lines().last().unwrap_or_default();
    format!("{}{last}", ended.err)
}

#[test]
fn every_launch_file_that_comes_with_the_project_is_right() {
    build_trip_meter();
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/config");
    let entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<_> =
        entries.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    assert!(4 <= files.len(), "{files:?}");

    let robot = Robot::new();
    for file in files {
        let ended = robot.start(&["check", file.to_str().unwrap()]).wait();
        ended.assert_code(0).assert_says(&["no mistake"]);
    }
}

#[test]
fn check_tells_all_mistakes_of_all_processes_and_runs_nothing() {
    let robot = Robot::new();
    let file = robot.launch_file(&[("source = \"wheels\"", "sauce = 1"), ("\"outer\"", "7")]);
    let ended = robot.start(&["check", &file]).wait();

    ended.assert_code(78).assert_says(&["`source`", "start", "2 errors", &file]);
    robot.assert_nothing_left();
}

#[test]
fn a_service_that_does_not_exist_is_refused_before_anything_runs() {
    let robot = Robot::new();
    let file = robot.launch_file(&[("name = \"controller\"", "name = \"contoller\"")]);

    for ended in [robot.start(&["check", &file]).wait(), robot.up(&[&file])] {
        ended.assert_code(78).assert_says(&["there is no service `contoller`", "launch.toml"]);
    }
    robot.assert_nothing_left();
}

/// A launch file in which almost everything is wrong that can be.
const WRONG: &str = r#"robot = "burger"
clock = "lockstep"

[[process]]
name = "odometry"
after = ["simulater"]
restart = "on-failure"

[process.parameters]
sauce = "wheels"

[[process]]
name = "logger"
exec = ["no_such_program"]
requires = ["odometry", "odometri"]
restart = "on_failure"
watchdog_ms = 20
start_timeout_ms = "5s"
cpu_affinity = [0, 4096]

[process.environment]
GOOD = "1"
NOTIFY_SOCKET = "/tmp/socket"
"#;

#[test]
fn check_tells_every_mistake_in_what_a_process_says_with_its_place_and_what_mends_it() {
    let mistakes = [
        ("\"simulater\"", "`process[0].after[0]`", "there is no process `simulater`", "`logger`"),
        ("\"on-failure\"", "`process[0].restart`", "cannot be in lock-step", "\"realtime\""),
        ("sauce", "`process[0].parameters.sauce`", "unknown key", "did you mean `source`?"),
        ("\"no_such", "`process[1].exec[0]`", "cannot run no_such_program", "into PATH"),
        ("\"odometri\"", "`process[1].requires[1]`", "there is no process", "`odometry`?"),
        ("\"on_fail", "`process[1].restart`", "unknown value \"on_failure\"", "`on-failure`?"),
        ("20", "`process[1].watchdog_ms`", "would bite the innocent", "300 milliseconds"),
        ("\"5s\"", "`process[1].start_timeout_ms`", "found the string \"5s\"", "whole number"),
        ("4096", "`process[1].cpu_affinity[1]`", "names no processor", "from 0"),
        ("\"/tmp/s", "`process[1].environment.NOTIFY_SOCKET`", "supervisor's", "leave it out"),
    ];
    let ended = check(WRONG);

    ended.assert_code(CONFIG).assert_says(&[&format!("{} errors", mistakes.len())]);
    for (written, key, message, help) in mistakes {
        assert_told(&ended, &[&place(WRONG, written), key, message, help]);
    }
}

#[test]
fn check_tells_a_cycle_as_a_path_where_it_begins() {
    let text = r#"robot = "burger"
clock = "realtime"

[[process]]
name = "last"
exec = ["true"]
after = ["a"]

[[process]]
name = "a"
exec = ["true"]
after = ["free"]
requires = ["b"]

[[process]]
name = "b"
exec = ["true"]
after = ["c"]

[[process]]
name = "c"
exec = ["true"]
after = ["a"]

[[process]]
name = "free"
exec = ["true"]
"#;
    let ended = check(text);

    ended.assert_code(CONFIG).assert_says(&["1 error"]);
    let path = "nobody can be first: a -> b -> c -> a";
    assert_told(&ended, &[&place(text, "\"b\"]"), "`process[1].requires[0]`", path]);
}

#[test]
fn check_tells_a_process_that_starts_after_itself() {
    let text =
        SIMULATION.replace("name = \"odometry\"", "name = \"odometry\"\nafter = [\"odometry\"]");
    let ended = check(&text);

    ended.assert_code(CONFIG);
    assert_told(&ended, &[&place(&text, "\"odometry\"]"), "odometry -> odometry"]);
}

#[test]
fn check_tells_nothing_that_only_follows_from_another_mistake() {
    let text = r#"robot = "burger"
clock = "realtme"

[[process]]
name = "odometry"
restart = "on-failure"

[[process]]
name = "logger"
type = "notify"
exec = "logger"
"#;
    let ended = check(text);

    ended.assert_code(CONFIG).assert_says(&["2 errors"]);
    assert_told(&ended, &[&place(text, "\"realtme\""), "`clock`", "did you mean `realtime`?"]);
    assert_told(&ended, &["launch.toml:11:8\n", "`process[1].exec`", "expected an array"]);
}

#[test]
fn beside_a_wrong_clock_check_tells_the_other_mistakes_and_none_that_follows() {
    let text = r#"robot = "burger"
clock = "realtyme"
wait = "never"

[[process]]
name = "simulator"

[process.parameters]
start = "nowhere"

[[process]]
name = "odometry"

[process.parameters]
source = "whels"

[[process]]
name = "controller"
parameters_file = "missing.toml"

[[process]]
name = "multiplexer"

[[process]]
name = "turtlebot3"
"#;
    let ended = check(text);

    ended.assert_code(CONFIG).assert_says(&["5 errors"]);
    assert_told(&ended, &[&place(text, "\"realtyme\""), "did you mean `realtime`?"]);
    assert_told(&ended, &[&place(text, "\"whels\""), "parameters.source`"]);
    ended.assert_says(&["\"never\"", "nowhere", "missing.toml"]);
}

/// `teseo check` of a launch file of this text.
fn check(text: &str) -> Ended {
    let robot = Robot::new();
    let file = robot.file("launch.toml", text);
    robot.start(&["check", &file]).wait()
}

/// Where the first `written` of `text` is, as an error says it.
#[track_caller]
fn place(text: &str, written: &str) -> String {
    let at = text.find(written).unwrap_or_else(|| panic!("'{written}' is not there"));
    let before = &text[..at];
    let line_start = before.rfind('\n').map_or(0, |end| end + 1);
    let line = 1 + before.matches('\n').count();
    format!("launch.toml:{line}:{}\n", 1 + text[line_start..at].chars().count())
}

/// One of the errors contains all of `texts`.
#[track_caller]
fn assert_told(ended: &Ended, texts: &[&str]) {
    let is_told = |error: &str| texts.iter().all(|text| error.contains(text));
    let story = ended.story();
    assert!(ended.err.split("\n\n").any(is_told), "no error says all of {texts:?}\n{story}");
}

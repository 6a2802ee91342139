//! The live screen: a robot of real processes, watched by a person at a real terminal.

use std::time::Duration;

use rustix::process::Signal;
use rustix::termios::LocalModes;
use serde_json::Value;

use crate::robot::{Robot, Run, wait_until};
use crate::terminal::Terminal;

const LAB: &str = include_str!("../config/lab_robot.toml");
const TELEOP: &str = include_str!("../config/teleop.toml");

/// How long may pass until something is sure to have happened.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A follower that does not end its run at a wall, and a second's rest before it comes back: long
/// enough for the dead-man to be seen.
const CHANGES: [(&str, &str); 2] = [
    ("controller/lab_robot.toml", "controller/corridor_following.toml"),
    ("requires = [\"odometry\"]\n", "requires = [\"odometry\"]\nrestart_delay_ms = 1000\n"),
];

#[test]
fn a_person_sees_the_robot_drive_its_controller_die_and_come_back_and_leaves_it_running() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let before = terminal.modes();
    let view = terminal.start(&robot, &["view"], &[]);
    terminal.await_screen("ready, armed and on its map", |screen| {
        screen.contains(" ready ") && screen.contains(" armed ") && screen.contains("map  x")
    });
    assert!(!terminal.modes().local_modes.contains(LocalModes::ECHO), "keys are echoed");

    let place = |screen: &str| screen.lines().nth(1).unwrap().chars().take(32).collect::<String>();
    let start = place(&terminal.screen());
    terminal.await_screen("somewhere else", |screen| place(screen) != start);
    terminal.await_screen("20 Hz on its topics", |screen| {
        let row = screen.lines().find(|line| line.contains("cmd_vel")).unwrap_or_default();
        row.contains(" 20.0 ") || row.contains(" 19.9 ") || row.contains(" 20.1 ")
    });

    // The first time it comes back at once; the second time after a while, in which the robot stops.
    run.node("controller").signal(Signal::KILL);
    terminal.await_screen("its controller's end", |screen| screen.contains("controller killed by"));
    terminal.await_screen("its second life", |screen| is_alive_again(screen, "1", "2│"));
    run.node("controller").signal(Signal::KILL);
    terminal.await_screen("the stop", |screen| screen.contains("held: dead-man"));
    terminal.await_screen("its third life", |screen| is_alive_again(screen, "2", "3│"));
    terminal.await_screen("that it may move again", |screen| screen.contains(" armed "));

    terminal.press("q");
    view.wait().assert_code(0);
    terminal.assert_restored(&before);
    assert_eq!(robot.status()["state"], "ready", "the robot goes on");
    run.stop();
    robot.assert_nothing_left();
}

#[test]
fn keys_stop_the_robot_let_it_go_restart_a_node_and_turn_the_pages() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &["view"], &[]);
    terminal.await_screen("armed", |screen| screen.contains(" armed "));

    terminal.press("e");
    terminal.await_screen("the emergency stop", |screen| screen.contains("held: emergency stop"));
    terminal.press("c");
    terminal.await_screen("armed again", |screen| screen.contains(" armed "));

    terminal.press("3");
    terminal.await_screen("all of the nodes", |screen| screen.contains("says"));
    terminal.press("nnn");
    terminal.press("r");
    terminal.await_screen("a question", |screen| screen.contains("r again restarts controller"));
    terminal.press("r");
    terminal.press("6");
    terminal.await_screen("the controller going", |screen| screen.contains("controller finalized"));

    terminal.press("p");
    terminal.await_screen("that it stands still", |screen| screen.contains("PAUSED"));
    terminal.press("\x03");
    view.wait().assert_code(0);
    run.stop();
}

#[test]
fn a_person_drives_with_the_arrows_and_gives_the_robot_back() {
    let robot = Robot::new();
    let launch_file = robot.launch_file_from(TELEOP, &[]);
    let run = robot.start_up(&[&launch_file]).await_count("READY", 1);
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &["view"], &[]);
    terminal.await_screen("armed", |screen| screen.contains(" armed "));

    let turns = wait_until(TIMEOUT, || {
        terminal.press("s\x1b[D\x1b[D\x1b[D\x1b[D\x1b[D");
        node::clock::nap(Duration::from_millis(200));
        // On the spot, to the left, as nothing but a person has it.
        let screen = terminal.screen();
        screen.contains("0.00 m/s 0.50 rad/s")
    });
    assert!(turns, "it never turns\n{}", terminal.screen());
    terminal.press("\x1b");
    terminal.await_screen("its own way again", |screen| screen.contains("0.20 m/s"));

    terminal.press("q");
    view.wait().assert_code(0);
    let ended = run.stop();
    assert!(1.0 <= ended.figure("multiplexer", "take_overs"), "{}", ended.story());
}

#[test]
fn up_with_a_view_is_down_when_the_screen_is_left_and_reports() {
    let robot = Robot::new();
    let launch_file = robot.launch_file_from(LAB, &CHANGES);
    let terminal = Terminal::new(80, 24);
    let before = terminal.modes();
    let view = terminal.start(&robot, &["up", &launch_file, "--view"], &[]);
    terminal.await_screen("armed", |screen| screen.contains(" armed "));
    terminal.press("q");

    view.wait().assert_code(0);
    terminal.assert_restored(&before);
    terminal.await_shown("asked to stop (exit 0)");
    robot.assert_nothing_left();
}

#[test]
fn where_the_screen_is_killed_its_robot_goes_down() {
    let robot = Robot::new();
    let launch_file = robot.launch_file_from(LAB, &CHANGES);
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &["up", &launch_file, "--view"], &[]);
    terminal.await_screen("armed", |screen| screen.contains(" armed "));
    view.signal(Signal::KILL).wait().assert_code(137);

    robot.assert_nothing_left();
}

#[test]
fn a_run_that_ends_under_the_screen_is_told_and_its_exit_code_is_kept() {
    let robot = Robot::new();
    let launch_file = robot.launch_file_from(LAB, &CHANGES);
    let terminal = Terminal::new(80, 24);
    let words = ["up", &launch_file, "--for", "2", "--until", "round-trip", "--view"];
    let view = terminal.start(&robot, &words, &[]);
    terminal
        .await_screen("that it is gone", |screen| screen.contains("the robot is down; q leaves"));

    // The screen is left by itself.
    view.wait().assert_code(1);
    terminal.await_shown("2 s are over, no round trip");
    robot.assert_nothing_left();
}

#[test]
fn whoever_says_nothing_on_a_terminal_sees_the_robot_drive() {
    let robot = Robot::new();
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &[], &[]);
    terminal.await_screen("driving", |screen| screen.contains("0.15 m/s"));
    terminal.press("q");
    view.wait().assert_code(0);
    terminal.await_shown("asked to stop");
    robot.assert_nothing_left();
}

#[test]
fn a_wrong_launch_file_is_told_without_a_screen() {
    let robot = Robot::new();
    let terminal = Terminal::new(80, 24);
    let launch_file = robot.launch_file_from(LAB, &CHANGES);
    let set = "simulator.lidar.nose=gazebo";
    let view = terminal.start(&robot, &["up", &launch_file, "--view", "--set", set], &[]);

    view.wait().assert_code(78);
    terminal.await_shown("did you mean `noise`?");
    assert!(!terminal.shown().contains("\x1b[?1049h"), "a screen was opened");
    robot.assert_nothing_left();
}

#[test]
fn a_terminal_too_small_is_told_so_and_one_that_grows_is_used() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(60, 20);
    let view = terminal.start(&robot, &["view"], &[]);
    terminal.await_screen("what it needs", |screen| screen.contains("needs 80x24, has 60x20"));
    terminal.resize(160, 50);
    terminal.await_screen("everything", |screen| screen.contains("scan to wheel"));

    terminal.press("q");
    view.wait().assert_code(0);
    run.stop();
}

#[test]
fn without_colours_or_unicode_there_are_none() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &["view"], &[("LC_ALL", "C"), ("NO_COLOR", "1")]);
    terminal.await_screen("the robot", |screen| screen.contains(" armed "));
    terminal.press("q");
    view.wait().assert_code(0);
    let shown = terminal.shown();
    assert!(shown.is_ascii(), "{shown}");
    // Codes 30 to 49 and 90 to 107 are colours; 39 and 49 are none again.
    let codes = shown.split("\x1b[").skip(1).filter_map(|rest| rest.split_once('m'));
    let codes = codes.flat_map(|(codes, _)| codes.split(';'));
    let colours: Vec<u32> = codes.filter_map(|code| code.parse().ok()).collect();
    let is_colour = |code: &u32| (30..=107).contains(code) && ![39, 49, 59].contains(code);
    assert!(!colours.iter().any(is_colour), "{colours:?}");
    run.stop();
}

#[test]
fn one_look_is_text_for_pipes_and_json_for_programs() {
    let robot = Robot::new();
    let run = up(&robot);
    let once = |options: &[&str]| {
        let words = [&["view", "--once", "--after", "2.5"], options].concat();
        let ended = robot.start_in(&[("LC_ALL", "C.UTF-8")], &words).wait();
        ended.assert_code(0);
        ended.out
    };
    let text = once(&["--size", "100x30"]);
    assert_eq!(text.lines().count(), 30, "{text}");
    assert!(!text.contains('\x1b') && text.contains(" ready "), "{text}");

    let json: Value = serde_json::from_str(&once(&["--json"])).unwrap();
    assert_eq!(json["state"], "ready", "{json:#}");
    assert!(10 < json["walls"].as_u64().unwrap() && 10 < json["returns"].as_u64().unwrap());
    let scan = json["topics"].as_array().unwrap().iter().find(|topic| topic["name"] == "scan");
    let scan = scan.unwrap();
    assert!((15.0..25.0).contains(&scan["hz"].as_f64().unwrap()), "{scan:#}");
    assert!(scan["age_ms"].as_f64().unwrap() < 1_000.0, "{scan:#}");
    let node = &json["nodes"][1];
    assert!(node["cpu_percent"].is_f64() && node["memory_kib"].is_u64(), "{node:#}");
    let counts = json["scan_to_wheel"]["lately"].as_array().unwrap().iter();
    let counts: f64 = counts.map(|step| step["count"].as_f64().unwrap()).sum();
    assert!(5.0 < counts, "{json:#}");

    let path = robot.file("picture.svg", "");
    once(&["--svg", &path]);
    let svg = std::fs::read_to_string(&path).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains(">ready<"), "{svg}");
    run.stop();
}

#[test]
fn without_a_robot_or_a_terminal_there_is_no_screen() {
    let robot = Robot::new();
    robot.start(&["view"]).wait().assert_code(3).assert_says(&["no robot is running"]);
    let run = up(&robot);
    let blind = robot.start(&["view"]).wait();
    blind.assert_code(1).assert_says(&["needs a terminal", "--once"]);
    assert!(blind.out.is_empty(), "{}", blind.story());
    run.stop();
    let blind = robot.start(&["up", "--view"]).wait();
    blind.assert_code(1).assert_says(&["needs a terminal"]);
}

#[test]
fn in_lock_step_a_screen_holds_nobody_up_and_changes_no_byte() {
    let robot = Robot::new();
    let unseen = robot.up(&["--for", "600"]);
    let run = robot.start_up(&["--for", "600"]).await_active();
    let terminal = Terminal::new(80, 24);
    let view = terminal.start(&robot, &["view"], &[]);
    terminal.await_screen("the robot", |screen| screen.contains("lock-step"));
    // It draws no more, and reads nothing any more, for the rest of the run.
    view.process().signal(Signal::STOP);
    let seen = run.wait();
    view.process().signal(Signal::CONT);
    terminal.press("q");
    view.wait().assert_code(0);

    seen.assert_code(0).assert_nothing_lost();
    assert_eq!(seen.digest(), unseen.digest(), "SEED=1\n{}", seen.story());
    assert_eq!(seen.report["topics"], unseen.report["topics"], "{}", seen.story());
}

/// Whether the controller is active, after so many restarts, in this life.
fn is_alive_again(screen: &str, restarts: &str, epoch: &str) -> bool {
    let row = screen.lines().find(|line| line.contains("│controller")).unwrap_or_default();
    let words: Vec<_> = row.split_whitespace().collect();
    row.contains(" active ") && words.ends_with(&[restarts, epoch])
}

/// `config/lab_robot.toml`, ready, and more patient.
fn up(robot: &Robot) -> Run<'_> {
    let launch_file = robot.launch_file_from(LAB, &CHANGES);
    robot.start_up(&[&launch_file]).await_count("READY", 1)
}

//! The units that are made of launch files, as systemd itself reads them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::example::build_trip_meter;
use crate::robot::{Ended, Robot};

const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// [-] Tenths of `systemd-analyze security`'s marks, from 0 to 10.
const EXPOSURE_MAX: [(&str, u32); 2] = [("supervisor", 15), ("node", 5)];

#[test]
fn every_launch_file_becomes_units_that_systemd_takes_without_a_word() {
    build_trip_meter();
    for launch in launch_files() {
        let robot = Robot::new();
        for per_node in [false, true] {
            let (ended, files) = make(&robot, &launch, per_node, &[]);
            if per_node && fs::read_to_string(&launch).unwrap().contains("lockstep") {
                ended.assert_code(78).assert_says(&["in lock-step a run has an end"]);
                continue;
            }
            ended.assert_code(0);
            verify(&files, "--system");
            let kind = EXPOSURE_MAX[usize::from(per_node)];
            assert_exposure(&files, kind);
        }
    }
}

#[test]
fn a_user_s_units_are_taken_too() {
    let robot = Robot::new();
    let launch = robot.launch_file_from(LAB_ROBOT, &[]);
    for per_node in [false, true] {
        let (ended, files) = make(&robot, Path::new(&launch), per_node, &["--user"]);
        ended.assert_code(0);
        verify(&files, "--user");
        let (next, enable) = ended.out.split_once("enable --now").unwrap();
        assert!(enable.starts_with(" teseo-burger."), "{}", ended.story());
        for file in &files {
            let link = format!("  systemctl --user link {}\n", file.display());
            assert!(next.contains(&link), "no {link} in\n{}", ended.story());
        }
        for file in &files {
            let text = fs::read_to_string(file).unwrap();
            assert!(!text.contains("\nUser="), "{}", file.display());
        }
    }
}

#[test]
fn units_where_systemd_looks_for_them_need_no_link() {
    let robot = Robot::new();
    let launch = robot.launch_file_from(LAB_ROBOT, &[]);
    let directory = PathBuf::from(robot.folder("etc")).join("systemd/system");
    let ended = robot.start(&["units", &launch, "--out", directory.to_str().unwrap()]).wait();

    ended.assert_code(0).assert_says(&["systemctl enable --now teseo-burger.service"]);
    assert!(!ended.out.contains("link"), "{}", ended.story());
}

#[test]
fn arguments_and_variables_stay_what_they_are() {
    let robot = Robot::new();
    let more = "exec = [\"/bin/sh\", \"-c\", \"echo \\\"%n $HOME\\\"\\n; \", \";\", \"\"]\n\
                type = \"simple\"\nrestart = \"always\"\n\
                environment = { WORDS = \"a\\nExecStartPre=/bin/false\\n%n \\\" ' \\\\\" }";
    let more =
        format!("[[process]]\nname = \"stranger\"\n{more}\n\n[[process]]\nname = \"odometry\"");
    let launch = robot.launch_file_from(
        LAB_ROBOT,
        &[("[[process]]\nname = \"odometry\"", &more), ("watchdog_ms = 500\n", "")],
    );
    let (ended, files) = make(&robot, Path::new(&launch), true, &[]);
    ended.assert_code(0);
    verify(&files, "--system");
    let stranger = files.iter().find(|file| file.ends_with("teseo-burger.stranger.service"));
    let text = fs::read_to_string(stranger.unwrap()).unwrap();
    assert!(!text.contains("\nExecStartPre=/bin/false"), "{text}");
    assert!(text.contains("\nEnvironment=\"WORDS=a\\x0aExecStartPre=/bin/false"), "{text}");
    assert!(
        text.contains("\nExecStart=:/bin/sh -c \"echo \\\"%%n $HOME\\\"\\x0a; \" \";\" \"\"\n")
    );
}

#[test]
fn a_bridge_has_its_serial_ports_and_little_else() {
    let robot = Robot::new();
    let launch = robot.launch_file_from(
        LAB_ROBOT,
        &[
            ("name = \"simulator\"", "name = \"turtlebot3\"\nexec = [\"/bin/true\"]"),
            ("requires = [\"simulator\"]", "requires = [\"turtlebot3\"]"),
            ("[process.parameters]\nworld = \"worlds/lab02.toml\"\nstart = \"outer\"\n", ""),
        ],
    );
    let (ended, files) = make(&robot, Path::new(&launch), true, &[]);
    ended.assert_code(0);
    verify(&files, "--system");
    let bridge = files.iter().find(|file| file.ends_with("teseo-burger.turtlebot3.service"));
    let bridge = bridge.unwrap().clone();
    let text = fs::read_to_string(&bridge).unwrap();
    for line in
        ["DevicePolicy=closed", "DeviceAllow=/dev/ttyACM0 rw", "SupplementaryGroups=dialout"]
    {
        assert!(text.lines().any(|other| other == line), "no {line} in\n{text}");
    }
    assert_exposure(&[bridge], ("bridge", 10));
}

#[test]
fn what_systemd_cannot_do_is_refused_or_said() {
    let robot = Robot::new();
    let cases: [(&str, &str, i32, &str); 3] = [
        (
            "restart = \"on-failure\"",
            "restart = \"never\"",
            78,
            "the robot cannot end with this one",
        ),
        (
            "restart = \"on-failure\"",
            "restart = \"always\"\nstrategy = \"one-for-one\"",
            0,
            "odometry: all that start after it start again with it",
        ),
        (
            "restart = \"on-failure\"",
            "restart = \"always\"\nstrategy = \"all\"",
            0,
            "those that start before it run on",
        ),
    ];
    for (old, new, code, says) in cases {
        let launch = robot.launch_file_from(LAB_ROBOT, &[(old, new)]);
        let (ended, _) = make(&robot, Path::new(&launch), true, &["--systemd", "252"]);
        ended.assert_code(code).assert_says(&[says]);
    }
}

fn launch_files() -> Vec<PathBuf> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/config");
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> =
        paths.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    files.sort();
    assert!(!files.is_empty(), "launch files are looked for in the wrong place");
    files
}

/// Runs `teseo units` and lists what it wrote.
fn make(robot: &Robot, launch: &Path, per_node: bool, more: &[&str]) -> (Ended, Vec<PathBuf>) {
    let directory = PathBuf::from(robot.file("units", "")).with_extension(per_node.to_string());
    let mut arguments = vec!["units", launch.to_str().unwrap()];
    arguments.extend(["--out", directory.to_str().unwrap()]);
    arguments.extend(more);
    if per_node {
        arguments.push("--per-node");
    }
    let ended = robot.start(&arguments).wait();
    let entries = fs::read_dir(&directory).into_iter().flatten();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    (ended, files)
}

fn verify(files: &[PathBuf], whose: &str) {
    if let Some(output) = analyze(&[whose, "verify", "--man=no"], files) {
        assert!(output.is_empty(), "{output}");
    }
}

/// [0.1] So much more than another node a bridge may be exposed.
const BRIDGE_MORE: u32 = 4;

fn assert_exposure(files: &[PathBuf], (kind, tenths): (&str, u32)) {
    for file in files.iter().filter(|file| file.extension().is_some_and(|end| end == "service")) {
        // A bridge has devices, and a group that may open them.
        let more = if file.to_str().unwrap().contains("turtlebot3") { BRIDGE_MORE } else { 0 };
        let threshold = format!("--threshold={}", tenths + more);
        let arguments = ["security", "--offline=true", "--no-pager", &threshold];
        if let Some(output) = analyze(&arguments, std::slice::from_ref(file)) {
            println!("{kind}: {}", output.lines().last().unwrap_or_default());
        }
    }
}

/// What `systemd-analyze` says, which is content; `None` where there is none.
fn analyze(arguments: &[&str], files: &[PathBuf]) -> Option<String> {
    let mut command = Command::new("systemd-analyze");
    // A user's systemd wants a runtime directory, though only to read them.
    command.args(arguments).args(files);
    command.env("XDG_RUNTIME_DIR", files[0].parent().unwrap());
    let Ok(output) = command.output() else {
        println!("skipped: no systemd-analyze");
        return None;
    };
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    assert!(output.status.success(), "{arguments:?} {files:?}\n{text}");
    Some(text)
}

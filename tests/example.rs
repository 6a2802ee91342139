//! The example of a user's own node does what it says, in as few lines as promised.

use std::path::Path;
use std::process::Command;

use crate::robot::Robot;

/// A user's own node takes less than this, in two new files.
const LINES_MAX: usize = 50;

#[test]
fn the_trip_meter_measures_what_the_simulator_drives() {
    build_trip_meter();
    let robot = Robot::new();
    let ended = robot.up(&["config/trip_meter.toml", "--until", "round-trip"]);

    ended.assert_code(0).assert_nothing_lost();
    assert!(ended.topics()["odom"]["readers"]["trip_meter"].is_object(), "{}", ended.story());
    let trip = ended.figure("trip_meter", "trip_m");
    let distance = ended.figure("simulator", "distance_m");
    // The encoder's steps, and the standstill before its first sample, are all that differs.
    assert!((trip - distance).abs() < 0.05, "{trip} m of {distance} m\n{}", ended.story());
    ended.assert_says(&["trip_meter", "trip "]);
}

#[test]
fn the_trip_meter_changes_nothing_for_the_others() {
    build_trip_meter();
    let robot = Robot::new();
    let with = robot.up(&["config/trip_meter.toml", "--for", "20"]);
    let without = robot.up(&["--for", "20"]);

    assert_eq!(with.digest(), without.digest(), "SEED=1\n{}{}", with.story(), without.story());
}

#[test]
fn a_user_s_own_node_takes_two_files_and_few_lines() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("services/trip_meter");
    let lines = ["Cargo.toml", "src/main.rs"]
        .map(|file| std::fs::read_to_string(directory.join(file)).unwrap().lines().count());
    let files = ["", "src"].map(|folder| {
        let entries = directory.join(folder).read_dir().unwrap();
        entries.filter(|entry| entry.as_ref().unwrap().path().is_file()).count()
    });

    assert_eq!(files, [1, 1], "the example is Cargo.toml and src/main.rs, and no more");
    let lines: usize = lines.iter().sum();
    assert!(lines < LINES_MAX, "the example has {lines} lines; {LINES_MAX} are too many");
}

/// Beside `teseo`, where `up` looks for it: Cargo builds no other package's binary for a test.
pub(crate) fn build_trip_meter() {
    let teseo = Path::new(env!("CARGO_BIN_EXE_teseo"));
    let profile = teseo.parent().unwrap();
    // Of the whole workspace, so that its dependencies are those that are built already.
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--locked", "--workspace", "--bin", "trip_meter", "--target-dir"])
        .arg(profile.parent().unwrap())
        .current_dir(env!("CARGO_MANIFEST_DIR"));
    if profile.ends_with("release") {
        cargo.arg("--release");
    }
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(profile.join("trip_meter").exists(), "trip_meter is not beside {}", teseo.display());
}

//! The main job: through all 16 cells of the lab's maze and back, without touching a wall.

use crate::robot::{Ended, Robot};

/// Every topic of the simulated robot on which something is said.
const TOPICS: [&str; 6] =
    ["cmd_vel", "joint_states", "motion_state", "odom", "scan", "sensor_pair"];

#[test]
fn the_robot_drives_out_through_the_outer_corridor_and_back() {
    let robot = Robot::new();
    assert_round_trip(&robot.up(&["--until", "round-trip"]), "outer");
}

#[test]
fn the_robot_drives_out_through_the_inner_corridor_and_back() {
    let robot = Robot::new();
    assert_round_trip(&robot.up(&["--until", "round-trip", "--start", "inner"]), "inner");
}

#[test]
fn a_lidar_with_as_many_beams_as_a_scan_has_room_for_drives_the_robot_as_well() {
    let robot = Robot::new();
    let beams = |beams| robot.up(&["--until", "round-trip", "--set", beams]);
    assert_round_trip(&beams("simulator.lidar.beams=1440"), "outer");
    beams("simulator.lidar.beams=1441").assert_code(78).assert_says(&["must be 1 to 1440"]);
}

#[test]
fn without_a_verb_the_main_job_is_run() {
    let robot = Robot::new();
    let ended = robot.start(&[]).wait();

    ended.assert_code(0).assert_says(&["start outer", "round trip, cells 1-16-1"]);
}

#[test]
fn the_report_tells_the_screen_what_it_tells_the_file() {
    let robot = Robot::new();
    let ended = robot.up(&["--until", "round-trip"]);

    let cause = ended.report["exit"]["cause"].as_str().unwrap();
    ended.assert_code(0).assert_says(&[
        ended.digest(),
        cause,
        "(exit 0)",
        "collisions 0",
        "clearance min",
        "scan to wheel",
        "p99",
        "memory peak",
        "x real time",
    ]);
    for name in TOPICS {
        ended.assert_says(&[name]);
    }
}

#[test]
fn the_report_has_all_that_a_run_is_asked_for() {
    let robot = Robot::new();
    let ended = robot.up(&["--until", "round-trip", "--seed", "7"]);

    let report = &ended.report;
    assert_eq!(report["world"], "config/worlds/lab02.toml", "{}", ended.story());
    assert_eq!([&report["start"], &report["clock"]], ["outer", "lockstep"]);
    assert_eq!(report["seed"], 7);
    for key in ["wall_s", "real_time_factor"] {
        assert!(0.0 < report[key].as_f64().unwrap(), "{key}\n{}", ended.story());
    }
    for node in ["odometry", "controller", "simulator"] {
        let peak = report["memory_peak_kib"][node].as_u64().unwrap();
        assert!(0 < peak, "{node}\n{}", ended.story());
    }
    for key in ["simulated_s", "distance_m", "clearance_min_m", "scan_to_command_p50_us"] {
        assert!(0.0 < ended.figure("simulator", key), "{key}\n{}", ended.story());
    }
    let scans = ended.figure("pairing", "scan_received").to_bits();
    assert_eq!(ended.figure("pairing", "pairs").to_bits(), scans, "{}", ended.story());
}

#[test]
fn a_run_that_has_no_time_for_the_round_trip_fails_and_says_so() {
    let robot = Robot::new();
    let ended = robot.up(&["--until", "round-trip", "--for", "5"]);

    ended.assert_code(1).assert_says(&["5 s are over, no round trip, cells 1-3"]);
    ended.assert_nothing_lost();
}

#[test]
fn a_robot_that_touches_a_wall_ends_the_run_and_says_where() {
    let robot = Robot::new();
    // Blind in front: the nearest wall it believes in is the farthest there is.
    let blind = "controller.wall_following.front_threshold_m=0.001";
    let ended = robot.up(&["--for", "60", "--set", blind]);

    ended.assert_code(1).assert_says(&["touched a wall at x "]);
    assert!(1.0 <= ended.figure("simulator", "collisions"), "{}", ended.story());
    ended.assert_nothing_lost();
}

#[track_caller]
fn assert_round_trip(ended: &Ended, start: &str) {
    ended.assert_code(0).assert_says(&["round trip, cells 1-16-1"]);
    assert_eq!(ended.report["start"], start);
    assert_eq!(ended.report["exit"]["code"], 0);
    let count = |key| ended.figure("simulator", key).to_bits();
    assert_eq!(count("collisions"), 0.0_f64.to_bits(), "{}", ended.story());
    assert_eq!(count("cells_out"), 16.0_f64.to_bits(), "{}", ended.story());
    assert_eq!(count("cells_back"), 15.0_f64.to_bits(), "{}", ended.story());
    assert!(0.0 < ended.figure("simulator", "clearance_min_m"), "{}", ended.story());

    assert_eq!(ended.digest().len(), 16, "{}", ended.story());
    ended.assert_nothing_lost();
    let spoken = ended.topics().iter().filter(|(_, topic)| topic["sent"] != 0);
    assert_eq!(spoken.map(|(name, _)| name).collect::<Vec<_>>(), TOPICS);
}

//! The robot's own time, and the other ways to run the same processes.

use std::fs;

use rustix::thread::sched_getaffinity;

use crate::robot::{Process, Robot};

#[test]
fn everyone_runs_on_the_processors_that_the_launch_file_says() {
    let allowed = sched_getaffinity(None).unwrap();
    let cores: Vec<_> = (0..1024).filter(|&core| allowed.is_set(core)).collect();
    let (first, last) = (cores[0], cores[cores.len() - 1]);
    let robot = Robot::new();
    let config = robot.launch_file(&[
        ("[pairing]", &format!("[pairing]\ncpu_affinity = [{first}]")),
        ("name = \"controller\"", &format!("name = \"controller\"\ncpu_affinity = [{last}]")),
    ]);
    let run = robot.start_up(&[&config, "--clock", "realtime"]).await_output("READY");

    let here = places(Process { pid: std::process::id().cast_signed() });
    let supervisor = places(run.supervisor());
    let pairing = supervisor.iter().find(|(thread, _)| thread == "pairing").unwrap();
    assert_eq!(pairing.1, first.to_string());
    let others = supervisor.iter().filter(|(thread, _)| thread != "pairing");
    others.for_each(|(thread, cores)| assert_eq!(*cores, here[0].1, "{thread} of the supervisor"));
    assert!(places(run.node("controller")).iter().all(|(_, cores)| *cores == last.to_string()));
    assert!(places(run.node("odometry")).iter().all(|(_, cores)| *cores == here[0].1));
    run.stop().assert_code(0);
}

/// The threads of a process by name, each with the processors where it may run.
fn places(process: Process) -> Vec<(String, String)> {
    let tasks = fs::read_dir(format!("/proc/{}/task", process.pid)).unwrap();
    let place = |task: std::io::Result<fs::DirEntry>| {
        let status = fs::read_to_string(task.unwrap().path().join("status")).unwrap();
        let field = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            line.unwrap().trim().to_owned()
        };
        (field("Name:"), field("Cpus_allowed_list:"))
    };
    tasks.map(place).collect()
}

#[test]
fn in_real_time_the_run_ends_by_itself_and_the_world_takes_as_long_as_it_shows() {
    let robot = Robot::new();
    let ended = robot.up(&["--clock", "realtime", "--for", "3"]);

    ended.assert_code(0).assert_says(&["3 s are over"]).assert_counters_close();
    let simulated = ended.figure("simulator", "simulated_s");
    assert!((simulated - 3.0).abs() < 0.06, "{simulated} s\n{}", ended.story());
    // A lower bound: the world may come late, but never early.
    let wall = ended.report["wall_s"].as_f64().unwrap();
    assert!(2.9 < wall, "{wall} s of wall time\n{}", ended.story());
    let commands = ended.topics()["cmd_vel"]["sent"].as_u64().unwrap();
    assert!(10 <= commands, "{commands} commands\n{}", ended.story());
    assert_eq!(ended.figure("simulator", "collisions").to_bits(), 0, "{}", ended.story());
    assert!(0.05 < ended.figure("simulator", "distance_m"), "{}", ended.story());
}

#[test]
fn a_robot_that_reports_only_its_pose_makes_the_round_trip_too() {
    let robot = Robot::new();
    let ended = robot.up(&[
        "--until",
        "round-trip",
        "--set",
        "odometry.source=poses",
        "--set",
        "simulator.reports_pose=true",
    ]);

    ended.assert_code(0).assert_says(&["round trip, cells 1-16-1"]).assert_nothing_lost();
    assert!(ended.topics()["robot_pose"]["sent"] != 0, "{}", ended.story());
    assert!(!ended.topics().contains_key("joint_states"), "{}", ended.story());
}

#[test]
fn the_corridor_follower_takes_the_place_of_the_wall_follower() {
    let robot = Robot::new();
    let config = with_controller(&robot, "corridor_following");
    let noise = "simulator.lidar.noise=lds01";
    let ended = robot.up(&[&config, "--until", "round-trip", "--set", noise, "--seed", "3"]);

    ended.assert_code(0).assert_says(&["round trip, cells 1-16-1"]).assert_nothing_lost();
}

#[test]
fn the_lab_s_robot_sends_its_commands_by_a_timer() {
    let robot = Robot::new();
    let config = with_controller(&robot, "lab_robot");
    let ended = robot.up(&[&config, "--clock", "realtime", "--for", "3"]);

    ended.assert_code(0).assert_counters_close();
    // 60 in 3 s, and fewer where the machine is busy.
    let commands = ended.topics()["cmd_vel"]["sent"].as_u64().unwrap();
    assert!((10..=63).contains(&commands), "{commands} commands\n{}", ended.story());
    assert!(0.05 < ended.figure("simulator", "distance_m"), "{}", ended.story());
}

#[test]
fn the_robot_is_not_driven_by_old_scans() {
    let robot = Robot::new();
    // Three of four are older than half a second when they come.
    let late = "simulator.faults.scan.delay_max_s=2";
    let ended = robot.up(&["--clock", "realtime", "--for", "4", "--set", late]);

    ended.assert_code(0);
    let pairs = ended.figure("pairing", "pairs");
    let old = ended.figure("controller", "unfit_old");
    assert!(0.3 * pairs < old, "{old} of {pairs}\n{}", ended.story());
    let commands = ended.topics()["cmd_vel"]["sent"].as_f64().unwrap();
    assert!(commands <= pairs - old, "{commands} commands\n{}", ended.story());
}

#[test]
fn in_lock_step_an_unfit_scan_is_answered_with_a_command_to_stand() {
    let robot = Robot::new();
    let ended = robot.up(&["--for", "2", "--set", "simulator.lidar.beams=39"]);

    ended.assert_code(0).assert_says(&["2 s are over"]).assert_nothing_lost();
    let commands = ended.topics()["cmd_vel"]["sent"].as_f64().unwrap();
    let unfit = ended.figure("controller", "unfit_few_beams");
    assert_eq!(unfit.to_bits(), commands.to_bits(), "{}", ended.story());
    assert_eq!(ended.figure("simulator", "distance_m").to_bits(), 0, "{}", ended.story());
}

/// The simulation with another of the profiles in `config/controller`.
fn with_controller(robot: &Robot, profile: &str) -> String {
    robot.launch_file(&[("lab_simulation", profile)])
}

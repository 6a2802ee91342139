//! What goes wrong on purpose on the topics of a whole robot, and that both sides of each can tell.

use std::time::Duration;

use rustix::process::Signal;

use crate::robot::{Ended, Robot};

/// A robot in real time that bears noise.
fn up(robot: &Robot, faults: &[&str]) -> Ended {
    let sets: Vec<_> = faults.iter().map(|fault| format!("--set={fault}")).collect();
    let mut arguments = vec!["config/noisy_simulation.toml", "--clock=realtime", "--for=8"];
    arguments.extend(sets.iter().map(String::as_str));
    robot.up(&arguments)
}

/// A counter of one of a topic's readers.
fn counter(ended: &Ended, topic: &str, reader: &str, name: &str) -> f64 {
    let counter = ended.topics()[topic]["readers"][reader][name].as_f64();
    counter.unwrap_or_else(|| panic!("no {name} of {topic} at {reader}\n{}", ended.story()))
}

// Broken on purpose: a lost sample that used up no number made the readers miss none.
#[test]
fn a_robot_that_loses_a_third_of_its_odometry_goes_on_and_its_readers_miss_as_many() {
    let robot = Robot::new();
    let ended = up(&robot, &["odometry.faults.odom.loss=0.33", "odometry.faults.odom.until_s=6"]);

    ended.assert_code(0).assert_says(&["8 s are over"]).assert_counters_close();
    assert!(1.0 < ended.figure("simulator", "distance_m"), "{}", ended.story());
    assert_eq!(ended.figure("simulator", "collisions").to_bits(), 0, "{}", ended.story());
    let lost = ended.figure("odometry", "faults_odom_lost");
    // Of 120.
    assert!((20.0..60.0).contains(&lost), "{}", ended.story());
    for reader in ["controller", "pairing"] {
        let missed = counter(&ended, "odom", reader, "lost");
        assert!((missed - lost).abs() < 0.5, "{reader} misses {missed}\n{}", ended.story());
    }
}

// Broken on purpose: a reader that took the number that came last for the newest missed some twice.
#[test]
fn samples_that_are_late_swapped_twice_or_stalled_leave_no_hole_in_the_books() {
    let robot = Robot::new();
    let faults = "[process.faults.odom]\ndelay_max_s = 0.08\nduplicate = 0.2\nreorder = 0.2\n\
                  stall = 0.02\nstall_s = 0.2\nuntil_s = 6.0\n";
    let source = "source = \"wheels\"\n";
    let file = robot.launch_file(&[
        ("clock = \"lockstep\"", "clock = \"realtime\""),
        (source, &format!("{source}\n{faults}")),
    ]);
    let ended = robot.up(&[&file, "--for=8"]);

    ended.assert_code(0).assert_counters_close();
    let figure = |name: &str| ended.figure("odometry", &format!("faults_odom_{name}"));
    for name in ["delayed", "duplicated", "reordered", "stalls", "lost"] {
        assert!(0.5 < figure(name), "no sample was {name}\n{}", ended.story());
    }
    for reader in ["controller", "pairing"] {
        let missed = counter(&ended, "odom", reader, "lost");
        assert!((missed - figure("lost")).abs() < 0.5, "{reader}: {missed}\n{}", ended.story());
    }
    let silent = ended.report["nodes"]["simulator"].as_object().unwrap().keys();
    assert!(silent.clone().all(|key| !key.starts_with("faults")), "{}", ended.story());
}

// Broken on purpose: where `Node::tick` sent nothing, the last sample waited for one after it.
#[test]
fn a_late_sample_is_sent_when_it_is_due_though_nothing_follows_it() {
    let robot = Robot::new();
    let run = robot.start_up(&[
        "config/noisy_simulation.toml",
        "--clock=realtime",
        "--set=odometry.faults.odom.delay_max_s=0.3",
    ]);
    let run = run.await_active().go_on(Duration::from_secs(2));
    run.node("simulator").signal(Signal::STOP);
    let ended = run.go_on(Duration::from_millis(1_500)).signal(Signal::INT).wait();

    assert!(10.0 < ended.figure("odometry", "faults_odom_delayed"), "{}", ended.story());
    assert_eq!(ended.figure("odometry", "faults_odom_lost").to_bits(), 0, "{}", ended.story());
}

#[test]
fn damaged_samples_end_no_process_of_ours() {
    let robot = Robot::new();
    let topics = [
        ("simulator", "scan"),
        ("simulator", "joint_states"),
        ("odometry", "odom"),
        ("controller", "cmd_vel"),
    ];
    let mut faults =
        topics.map(|(node, topic)| format!("{node}.faults.{topic}.corrupt=0.2")).to_vec();
    faults.push("controller.faults.cmd_vel.stamp_jump=0.2".into());
    faults.push("simulator.stop_at_collision=false".into());
    let faults: Vec<_> = faults.iter().map(String::as_str).collect();
    let ended = up(&robot, &faults);

    ended.assert_code(0).assert_says(&["8 s are over"]);
    let count = |node, figure: &str| ended.figure(node, &format!("faults_{figure}"));
    for (node, topic) in topics {
        assert!(0.5 < count(node, &format!("{topic}_corrupted")), "{topic}\n{}", ended.story());
    }
    assert!(0.5 < count("controller", "cmd_vel_stamps_moved"), "{}", ended.story());
}

#[test]
fn faults_that_cannot_be_are_refused_where_they_were_written() {
    let robot = Robot::new();
    let start = "start = \"outer\"\n";
    let faults = format!("{start}\n[process.faults.scan]\nloss = 1.5\nstal = 0.1\n");
    let file =
        robot.launch_file(&[(start, &faults), ("clock = \"lockstep\"", "clock = \"realtime\"")]);
    let lines = std::fs::read_to_string(&file).unwrap().lines().count();
    let ended = robot.start(&["check", &file]).wait();

    ended.assert_code(78).assert_says(&[
        &format!("{file}:{}:8", lines - 1),
        "`loss` is 1.5, which is no probability",
        &format!("{file}:{lines}:1"),
        "did you mean `stall`?",
        "2 errors",
    ]);
}

#[test]
fn faults_are_refused_in_lock_step_and_on_topics_that_the_process_does_not_publish() {
    let robot = Robot::new();
    let set = "--set=simulator.faults.scan.loss=0.1";
    robot
        .up(&["config/simulation.toml", set])
        .assert_code(78)
        .assert_says(&["`simulator.faults.scan`", "would stall a robot in lock-step for good"]);
    // What never happens may stand there.
    robot
        .start(&["check", "config/simulation.toml", "--set=simulator.faults.scan.loss=0"])
        .wait()
        .assert_code(0);

    up(&robot, &["odometry.faults.odm.loss=0.1"])
        .assert_code(78)
        .assert_says(&["is no topic that `odometry` publishes", "did you mean `odom`?"]);
}

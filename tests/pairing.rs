//! Pairing on a robot whose data is bad, and offline on recorded streams.

use std::time::Duration;

use rustix::process::Signal;

use crate::robot::Robot;

/// ROS 2's own streams and what its own code made of them.
const STREAMS: &str = "tests/data/pairing/approximate_time_public.jsonl";

#[test]
fn a_robot_with_lost_late_and_stalled_samples_keeps_going_and_can_explain_every_loss() {
    let robot = Robot::new();
    let run = robot.start_up(&[
        "config/noisy_simulation.toml",
        "--clock=realtime",
        "--for=60",
        "--set=simulator.faults.scan.loss=0.2",
        "--set=simulator.faults.scan.delay_max_s=0.01",
        "--set=pairing.slop_ms=50",
        "--set=pairing.max_age_ms=500",
        // Lost scans and a stopped node must not leave it standing until a person comes.
        "--set=simulator.deadman.timeout_ms=500",
    ]);
    let run = run.await_active().go_on(Duration::from_secs(20));
    let odometry = run.node("odometry");
    odometry.signal(Signal::STOP);
    let run = run.go_on(Duration::from_millis(200));
    odometry.signal(Signal::CONT);
    let ended = run.wait();

    ended.assert_code(0).assert_says(&["60 s are over"]);
    assert_eq!(ended.figure("simulator", "collisions").to_bits(), 0, "{}", ended.story());
    // The whole corridor out, and some of the way back.
    assert!(16.0 <= ended.figure("simulator", "cells_out"), "{}", ended.story());
    let pairs = ended.figure("pairing", "pairs");
    for topic in ["scan", "odom"] {
        let counter = |name: &str| ended.figure("pairing", &format!("{topic}_{name}"));
        let reasons: f64 = node::pairing::Reason::ALL.iter().map(|why| counter(why.label())).sum();
        let received = counter("received");
        assert!(
            (received - pairs - reasons - counter("queued")).abs() < 0.5,
            "the books of {topic} do not close\n{}",
            ended.story()
        );
        let lost_on_purpose = match topic {
            "scan" => ended.figure("simulator", "faults_scan_lost"),
            _ => 0.0,
        };
        let lost = ended.topics()[topic]["readers"]["pairing"]["lost"].as_f64().unwrap();
        // The last one may be lost unseen.
        assert!((lost_on_purpose - lost).abs() < 1.5, "{lost} of {topic}\n{}", ended.story());
    }
    // Of 1200 scans a fifth is never sent; its odometry finds no partner.
    assert!((700.0..1100.0).contains(&pairs), "{pairs} pairs\n{}", ended.story());
    let alone = ended.figure("pairing", "odom_no_partner")
        + ended.figure("pairing", "odom_superseded")
        + ended.figure("pairing", "odom_too_old");
    assert!(100.0 < alone, "{alone} odometry samples without a scan\n{}", ended.story());
}

#[test]
fn recorded_streams_are_paired_as_ros_2_does_and_every_loss_is_told() {
    let robot = Robot::new();
    let ended = robot.start(&["pair", STREAMS, "--json"]).wait();
    ended.assert_code(0);

    let streams = std::fs::read_to_string(STREAMS).unwrap();
    let replays: Vec<_> = ended.out.lines().collect();
    assert_eq!(replays.len(), streams.lines().count());
    for (stream, replay) in streams.lines().zip(replays) {
        let stream: serde_json::Value = serde_json::from_str(stream).unwrap();
        let replay: serde_json::Value = serde_json::from_str(replay).unwrap();
        assert_eq!(replay["matches"], stream["matches"], "{}", stream["id"]);
        assert_eq!(replay["match_at"], stream["match_at"], "{}", stream["id"]);
    }
}

#[test]
fn a_narrower_slop_and_another_policy_change_what_pairs() {
    let robot = Robot::new();
    let count = |arguments: &[&str]| {
        let ended = robot.start(&[&["pair", STREAMS], arguments].concat()).wait();
        ended.assert_code(0);
        ended.out.lines().filter(|line| line.contains(" pair ")).count()
    };

    let recorded = count(&[]);
    assert!(0 < recorded);
    assert!(count(&["--slop", "0.000001"]) < recorded);
    assert_ne!(count(&["--policy", "adaptive"]), recorded);
}

#[test]
fn a_line_that_is_no_stream_is_named() {
    let robot = Robot::new();
    let file =
        robot.file("streams.jsonl", "{\"topics\": [\"a\", \"b\"], \"events\": []}\nnonsense\n");
    let ended = robot.start(&["pair", &file]).wait();

    ended.assert_code(1).assert_says(&[&file, "line 2"]);
}

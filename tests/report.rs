//! The page of a run: it tells what the run was, needs nothing else, and costs the run nothing.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::robot::Robot;

/// The page in this directory, checked for what no page may have.
fn page(directory: &str) -> String {
    let page = fs::read_to_string(Path::new(directory).join("report.html")).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.ends_with("</html>\n"));
    // It must be whole without a network, and without any other file.
    let names_of_formats = page.replace("http://www.w3.org/2000/svg", "");
    for outside in ["http:", "https:", "src=", "href=", "@import", "url(", "<script"] {
        assert!(!names_of_formats.contains(outside), "the page asks for {outside}");
    }
    page
}

/// The points of the longest line that is drawn.
fn longest_line(page: &str) -> usize {
    let lines = page.split("<polyline").skip(1);
    let points = lines.map(|line| {
        let points = line.split_once("points=\"").unwrap().1.split_once('"').unwrap().0;
        points.split_whitespace().count()
    });
    points.max().unwrap_or_default()
}

#[test]
fn a_run_leaves_a_page_of_all_that_it_was() {
    let robot = Robot::new();
    let directory = robot.folder("run");
    let trip = ["up", "--until", "round-trip"];
    let unkept = robot.start(&trip).wait();
    let kept = robot.start(&[&trip[..], &["--report", &directory]].concat()).wait();
    kept.assert_code(0);
    let page = page(&directory);
    // What is noted changes nothing that is sent.
    let digest = unkept.out.lines().find_map(|line| line.strip_prefix("digest        ")).unwrap();
    for says in [
        digest,
        "round trip, cells 1-16-1 (exit 0)",
        "config/worlds/lab02.toml",
        "where it was",
        "where odometry believed it to be",
        "Clearance: from the robot",
        "turns right",
        "simulator: scan to command",
        "unconfigured -&gt; inactive",
        "policy = &quot;nearest&quot;",
    ] {
        assert!(page.contains(says), "the page says nothing of {says}");
    }
    // All of the trip is drawn, 1889 measurements long.
    assert!(1800 < longest_line(&page), "{}", longest_line(&page));
}

#[test]
fn the_page_can_be_made_again_and_tells_of_the_last_run_only() {
    let robot = Robot::new();
    let directory = robot.folder("run");
    let short = robot.start(&["up", "--for", "60", "--report", &directory]).wait();
    short.assert_code(0);
    let long = page(&directory);
    let other = ["up", "--for", "5", "--set", "seed=2", "--report", &directory];
    let again = robot.start(&other).wait();
    again.assert_code(0);
    let short = page(&directory);
    assert!(short.contains("5 s are over") && short.contains("seed=2"));
    assert!(longest_line(&short) * 5 < longest_line(&long), "the former run is still drawn");

    fs::remove_file(Path::new(&directory).join("report.html")).unwrap();
    let made = robot.start(&["report", &directory]).wait();
    made.assert_code(0).assert_says(&["report.html"]);
    assert_eq!(page(&directory), short);
}

#[test]
fn in_real_time_a_node_that_died_is_told_of() {
    let robot = Robot::new();
    let directory = robot.folder("run");
    let calm = "simulator.stop_at_collision=false";
    let arguments = ["up", "config/lab_robot.toml", "--set", calm, "--report", &directory];
    let run = robot.start(&arguments).await_count("READY", 1).go_on(Duration::from_secs(1));
    run.node("controller").signal(rustix::process::Signal::KILL);
    run.await_count("READY", 2).stop();
    // What it had noted until then is there, and what its next life noted goes on after it.
    let rows = |life| {
        let path = Path::new(&directory).join(format!("controller.{life}.diary.csv"));
        let text = fs::read_to_string(path).unwrap();
        let stamps =
            text.lines().skip(1).map(|row| row.split(',').next().unwrap().parse().unwrap());
        stamps.collect::<Vec<f64>>()
    };
    let (first, second) = (rows(1), rows(2));
    assert!(10 < first.len() && first.is_sorted(), "{first:?}");
    assert!(first.last() < second.first(), "{first:?} {second:?}");
    let page = page(&directory);
    assert!(page.contains("failed: was killed by signal 9 (SIGKILL)"));
    assert!(page.contains("controller: age") && page.contains("where it was"));
}

#[test]
fn a_directory_without_a_run_is_told_from_one() {
    let robot = Robot::new();
    let directory = robot.folder("empty");
    let ended = robot.start(&["report", &directory]).wait();
    assert_ne!(ended.code, 0);
    ended.assert_says(&["report.json"]);
}

// Broken on purpose: with the parts of one node left out, no way led from scan to wheel.
#[test]
fn a_timeline_leads_from_scan_to_wheel_through_every_process() {
    let robot = Robot::new();
    let directory = robot.folder("trace");
    let file = format!("{directory}/timeline.json");
    let arguments = ["up", "--clock", "realtime", "--for", "3", "--trace", &file];
    robot.start(&arguments).wait().assert_code(0);
    let timeline: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    let events = timeline["traceEvents"].as_array().unwrap();
    let name_of = |process: &Value| {
        let names = events.iter().filter(|event| event["ph"] == "M");
        let name = names.clone().find(|name| name["pid"] == *process).unwrap();
        name["args"]["name"].as_str().unwrap()
    };
    let mut ways = BTreeMap::<_, u64>::new();
    for begin in events.iter().filter(|event| event["ph"] == "s") {
        let end = events.iter().find(|event| event["ph"] == "f" && event["id"] == begin["id"]);
        let end = end.unwrap();
        assert!(begin["ts"].as_f64() <= end["ts"].as_f64(), "{begin} {end}");
        let way = (name_of(&begin["pid"]), begin["name"].as_str().unwrap(), name_of(&end["pid"]));
        *ways.entry(way).or_default() += 1;
    }
    for way in [
        ("simulator", "joint_states", "odometry"),
        ("odometry", "odom", "pairing"),
        ("simulator", "scan", "pairing"),
        ("simulator", "scan", "controller"),
        ("pairing", "sensor_pair", "controller"),
        ("controller", "cmd_vel", "simulator"),
    ] {
        assert!(Some(&30) < ways.get(&way), "{way:?}: {ways:?}");
    }
    let left = fs::read_dir(&directory).unwrap().count();
    assert_eq!(left, 1, "parts of it are left");
}

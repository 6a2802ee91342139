//! Looking at a robot that runs: what the console's verbs show of it, and that it does not notice.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

use interfaces::topics;
use node::{Namespace, Session, observe};
use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{Ended, Robot, Run, alone};

/// Long enough, in simulated time, for whoever comes in the meantime.
const FOR: [&str; 2] = ["--for", "900"];

/// Long enough for a dozen verbs.
const LONG: [&str; 2] = ["--for", "5000"];

/// As `config/lab_robot.toml`, in real time.
const REALTIME: &str = include_str!("../config/lab_robot.toml");

/// A parameter that may be changed.
const SPEED: &str = "wall_following.speed_m_s";

/// A robot in real time that is ready.
fn realtime(robot: &Robot) -> Run<'_> {
    let run = robot.start_up(&[&robot.launch_file_from(REALTIME, &[])]);
    robot.await_ready();
    run
}

/// What `teseo` says with these arguments, to which nobody objects.
#[track_caller]
fn said(robot: &Robot, arguments: &[&str]) -> Ended {
    let ended = robot.start(arguments).wait();
    ended.assert_code(0);
    assert!(!ended.out.contains('\x1b'), "an escape code in a file\n{}", ended.story());
    ended
}

/// The one line of the output that begins with `word`, in words.
#[track_caller]
fn row<'a>(ended: &'a Ended, word: &str) -> Vec<&'a str> {
    let lines = ended.out.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let found: Vec<_> = lines.filter(|words| words.first() == Some(&word)).collect();
    assert_eq!(found.len(), 1, "lines that begin with {word}\n{}", ended.story());
    found[0].clone()
}

#[track_caller]
fn refused(robot: &Robot, arguments: &[&str], code: i32, why: &str) {
    robot.start(arguments).wait().assert_code(code).assert_says(&[why]);
}

#[test]
fn one_who_looks_on_and_never_reads_holds_no_robot_up_and_changes_no_byte() {
    alone(|robot| {
        let unseen = robot.up(&FOR);
        let run = robot.start_up(&FOR).await_active();
        let session = Session::guest(&robot.namespace(), "idle").unwrap();
        let mut observers: Vec<_> = topics::names()
            .into_iter()
            .filter_map(|name| observe::topic(&session, name).unwrap().map(|found| (name, found)))
            .collect();
        let seen = run.wait();

        seen.assert_code(0).assert_nothing_lost();
        assert_eq!(seen.digest(), unseen.digest(), "SEED=1\n{}", seen.story());
        assert_eq!(seen.report["topics"], unseen.report["topics"], "{}", seen.story());
        // More was sent than its queues hold, and it is the oldest that it finds there.
        for (name, depth) in [("scan", 10), ("odom", 32), ("cmd_vel", 10)] {
            let (_, observer) = observers.iter_mut().find(|(of, _)| *of == name).unwrap();
            let numbers: Vec<_> = std::iter::from_fn(|| observer.receive().unwrap())
                .map(|sample| sample.header().sequence)
                .collect();
            let whole: Vec<_> = (numbers[0]..).take(depth).collect();
            assert_eq!(numbers, whole, "{name}");
            assert!(numbers[depth - 1] + 1 < seen.topics()[name]["sent"].as_u64().unwrap());
        }
    });
}

#[test]
fn one_who_looks_on_and_is_killed_holds_no_robot_up_either() {
    let robot = Robot::new();
    let unseen = robot.up(&LONG);
    let run = robot.start_up(&LONG).await_active();
    let echo = robot.start(&["topic", "echo", "scan", "--json"]).await_output("\"range\"");
    echo.signal(Signal::KILL).wait();
    let seen = run.wait();

    seen.assert_code(0).assert_nothing_lost();
    assert_eq!(seen.digest(), unseen.digest(), "SEED=1\n{}", seen.story());
}

#[test]
fn topics_are_listed_with_who_is_at_them() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let list = said(&robot, &["topic", "list"]);
    let scan = row(&list, "scan");
    assert_eq!(
        (scan[1], &scan[scan.len() - 3..]),
        ("LaserScan", &["simulator", "pairing,", "controller"][..])
    );
    assert_eq!(row(&list, "motion_state")[2..], ["latched", "simulator", "controller"]);
    assert_eq!(row(&list, "pose")[2], "-", "{}", list.story());
    assert!(!list.out.contains("\nimu ") && !list.out.contains('/'), "{}", list.story());
    let all = said(&robot, &["topic", "list", "--all"]);
    all.assert_says(&["\nimu ", "controller/status "]);
    let json = said(&robot, &["topic", "list", "--json"]);
    let json: Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!(json[0]["topic"], "scan");

    said(&robot, &["topic", "info", "cmd_vel"]).assert_says(&[
        "VelocityCommand, 40 bytes",
        "publisher  controller (may be: controller or multiplexer)",
        "readers    simulator (",
        "linear [m/s], angular [rad/s]",
    ]);
    for line in [&list, &all].iter().flat_map(|ended| ended.out.lines()) {
        assert!(line.chars().count() <= 100, "{line}");
    }
    refused(&robot, &["topic", "info", "scna"], 1, "did you mean `scan`?");
    run.stop();
    refused(&robot, &["topic", "list"], 3, "no robot is running");
}

#[test]
fn samples_are_printed_field_by_field_for_people_and_for_programs() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let text = said(&robot, &["topic", "echo", "odom", "--once"]);
    assert!(text.out.starts_with("stamp "), "{}", text.story());
    assert_eq!(row(&text, "linear").last(), Some(&"m/s"), "{}", text.story());
    let json = said(&robot, &["topic", "echo", "scan", "-n", "2", "--json"]);
    let samples: Vec<Value> =
        json.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(samples.len(), 2);
    assert_eq!(samples[0]["range"].as_array().map(Vec::len), Some(240));
    assert_eq!(
        samples[1]["sequence"].as_u64(),
        samples[0]["sequence"].as_u64().map(|number| number + 1)
    );
    let csv = said(&robot, &["topic", "echo", "odom", "-n", "2", "--csv"]);
    let lines: Vec<_> = csv.out.lines().collect();
    assert_eq!(lines.len(), 3, "{}", csv.story());
    assert!(lines[0].starts_with("stamp [ns],sequence,epoch,x [m],"), "{}", csv.story());
    let field = said(&robot, &["topic", "echo", "odom", "--field", "x", "-n", "3"]);
    let xs: Vec<f64> = field.out.lines().map(|line| line.parse().unwrap()).collect();
    assert!(xs.len() == 3 && xs.is_sorted(), "it drives ahead: {xs:?}");
    // What is latched is there though nothing happens.
    said(&robot, &["topic", "echo", "motion_state", "--once"]).assert_says(&["armed"]);

    refused(&robot, &["topic", "echo", "odom", "--field", "z"], 1, "odom has no field `z`");
    refused(&robot, &["topic", "echo", "imu", "--once"], 1, "has no topic `imu`");
    // It ends with the robot.
    let endless = robot.start(&["topic", "echo", "odom"]).await_output("---");
    run.stop();
    endless.wait().assert_code(3).assert_says(&["robot 'burger' went away"]);
}

#[test]
fn rate_bandwidth_and_age_are_those_of_the_topic() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let hz = said(&robot, &["topic", "hz", "scan", "--once", "--json"]);
    let hz: Value = serde_json::from_str(&hz.out).unwrap();
    // By their stamps, which a busy machine does not change.
    let rate = hz["hz_by_stamp"].as_f64().unwrap();
    assert!((rate - 20.0).abs() < 2.0, "{hz}");
    assert!(hz["jitter_s"].is_number() && hz["age_p50_s"].is_number(), "{hz}");
    said(&robot, &["topic", "hz", "scan", "--for", "1"]).assert_says(&["Hz; period", "jitter"]);
    said(&robot, &["topic", "bw", "scan", "--once"]).assert_says(&["11576 bytes a sample"]);
    said(&robot, &["topic", "delay", "odom", "--once"]).assert_says(&["median"]);
    let interrupted = robot.start(&["topic", "hz", "scan"]).await_output("Hz");
    interrupted.signal(Signal::INT).wait().assert_code(0);
    run.stop();
}

#[test]
fn words_and_options_of_ros_2_are_understood() {
    let robot = Robot::new();
    let run = realtime(&robot);

    said(&robot, &["topic", "list", "-t", "-v"]).assert_says(&["LaserScan"]);
    said(&robot, &["topic", "info", "/scan", "-v"]).assert_says(&["LaserScan"]);
    let count: usize = said(&robot, &["topic", "list", "-c"]).out.trim().parse().unwrap();
    assert!(6 < count, "{count}");
    assert_eq!(said(&robot, &["topic", "type", "/odom"]).out, "Odometry\n");
    assert_eq!(said(&robot, &["topic", "find", "sensor_msgs/msg/LaserScan"]).out, "scan\n");
    said(&robot, &["topic", "hz", "/scan", "-w", "5", "--once"]).assert_says(&["Hz"]);
    said(&robot, &["node", "info", "/controller"]).assert_says(&["cmd_vel"]);
    assert_eq!(said(&robot, &["node", "list", "-a", "-c"]).out, "4\n");
    assert_eq!(
        said(&robot, &["lifecycle", "nodes"]).out,
        "pairing\nsimulator\nodometry\ncontroller\n"
    );
    assert_eq!(said(&robot, &["lifecycle", "get", "/controller"]).out, "active [3]\n");
    said(&robot, &["restart", "/controller"]).assert_says(&["controller is active again"]);
    for (options, sent) in [
        (&["-1"][..], "sent 1 on pose"),
        (&["--once", "-r", "50"], "sent 1 on pose"),
        (&["-t", "3", "-r", "50"], "sent 3 on pose"),
        (&["--times", "2"], "sent 2 on pose"),
    ] {
        let words = [&["topic", "pub", "/pose", "x=1"], options].concat();
        said(&robot, &words).assert_says(&[sent]);
    }
    let full = said(&robot, &["topic", "echo", "/scan", "-f", "--once"]);
    assert!(row(&full, "range").len() > 240 && !full.out.contains("in all"), "{}", full.story());
    run.stop();
}

#[test]
fn one_publishes_where_nobody_does_and_is_told_who_does_where_not() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let echo = robot.start(&["topic", "echo", "pose", "-n", "2", "--field", "x"]);
    let echo = echo.await_output("nobody publishes pose");
    let sent = said(&robot, &["topic", "pub", "pose", "x=1.5", "--rate", "20", "--for", "0.5"]);
    sent.assert_says(&["sent 10 on pose"]);
    assert_eq!(echo.wait().out, "1.5\n1.5\n");

    for (arguments, why) in [
        (&["cmd_vel", "linear=0.1"][..], "on this robot that is controller (active)"),
        (&["teleop_cmd_vel", "linear=0.1"], "nobody on this robot reads `teleop_cmd_vel`"),
        (&["pose", "z=1"], "pose has no field `z`"),
        (&["pose", "x=far"], "`far` is nothing that `x` [m] can hold"),
        (&["controller/change_state"], "and nobody else"),
    ] {
        refused(&robot, &[&["topic", "pub"], arguments].concat(), 1, why);
    }
    // One who is down comes back, and would not be believed after us.
    said(&robot, &["lifecycle", "set", "controller", "shutdown"]);
    refused(&robot, &["topic", "pub", "cmd_vel"], 1, "that is controller (finalized)");
    run.stop();
}

// Nothing of the robot comes or goes meanwhile, which would clear away after the dead too.
#[test]
fn one_who_published_and_was_killed_is_in_the_way_of_nobody() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let first = robot.start(&["topic", "pub", "pose", "x=1", "--rate", "20"]);
    let heard = robot.start(&["topic", "echo", "pose", "-n", "1"]).wait();
    heard.assert_code(0);
    first.signal(Signal::KILL).wait();
    said(&robot, &["topic", "pub", "pose", "x=2"]).assert_says(&["sent 1 on pose"]);
    run.stop();
}

#[test]
fn what_a_killed_guest_left_half_made_is_swept_before_the_next_one_joins() {
    let robot = Robot::new();
    let run = realtime(&robot);
    // As one leaves it who is killed between two system calls: the transport could wait for it for ever.
    let whole = robot.segments().pop().unwrap();
    let name = format!("{}half_made.dynamic", Namespace::prefix_of(&whole).unwrap());
    let half_made = Path::new("/dev/shm").join(name);
    fs::write(&half_made, "").unwrap();
    fs::set_permissions(&half_made, Permissions::from_mode(0o200)).unwrap();

    said(&robot, &["topic", "pub", "pose", "x=2"]).assert_says(&["sent 1 on pose"]);
    assert!(!half_made.exists(), "the guest did not wait, or nobody swept");
    run.stop();
}

#[test]
fn a_pose_that_is_published_hands_the_robot_over() {
    let robot = Robot::new();
    let run = realtime(&robot);

    said(&robot, &["topic", "pub", "pose", "localized=1"]);
    // Another node is to drive now, and there is none.
    said(&robot, &["events"]);
    let run = run.await_output("dead-man");
    run.stop();
}

#[test]
fn nodes_are_shown_and_moved_by_their_supervisor() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let list = said(&robot, &["node", "list"]);
    assert_eq!(row(&list, "controller")[1], "active");
    said(&robot, &["node", "info", "controller"]).assert_says(&[
        "cmd_vel",
        "sensor_pair",
        "age_p50_us",
    ]);
    assert_eq!(said(&robot, &["lifecycle", "get", "controller"]).out, "active [3]\n");
    assert_eq!(
        said(&robot, &["lifecycle", "list", "controller"]).out,
        "shutdown  active -> finalized\n"
    );
    refused(&robot, &["lifecycle", "set", "controller", "deactivate"], 1, "active or finalized");
    refused(&robot, &["lifecycle", "set", "controller", "start"], 1, "there is no transition");
    refused(&robot, &["node", "info", "contrller"], 1, "did you mean `controller`?");

    said(&robot, &["lifecycle", "set", "controller", "shutdown"]).assert_says(&["is finalized"]);
    for verb in [&["node", "list"][..], &["status"], &["lifecycle", "get"]] {
        assert_eq!(row(&robot.start(verb).wait(), "controller")[1], "finalized", "{verb:?}");
    }
    said(&robot, &["graph"]).assert_says(&["controller (finalized)"]);
    said(&robot, &["why", "controller"]).assert_says(&["controller is finalized"]);
    said(&robot, &["lifecycle", "set", "controller", "activate"]).assert_says(&["is active"]);
    assert_eq!(said(&robot, &["lifecycle", "get", "controller"]).out, "active [3]\n");
    run.stop();
}

#[test]
fn the_graph_is_that_of_the_running_robot_in_every_format() {
    let robot = Robot::new();
    let run = realtime(&robot);
    let guest = robot.start(&["topic", "pub", "pose", "x=1", "--rate", "5"]);

    let has_guest = || said(&robot, &["graph"]).out.contains("pub (guest)");
    assert!(crate::robot::wait_until(Duration::from_secs(10), has_guest));
    let text = said(&robot, &["graph"]);
    text.assert_says(&["burger is ready", "controller (active)"]);
    assert_eq!(row(&text, "cmd_vel").last(), Some(&"simulator"));
    said(&robot, &["graph", "--dot"])
        .assert_says(&["\"simulator\" -> \"/scan\";", "\"pub\" -> \"/pose\""]);
    said(&robot, &["graph", "--mermaid"]).assert_says(&["n_simulator --> t_scan"]);
    let svg = said(&robot, &["graph", "--svg"]);
    assert!(svg.out.starts_with("<svg ") && svg.out.ends_with("</svg>\n"), "{}", svg.story());
    let json = said(&robot, &["graph", "--json"]);
    let json: Value = serde_json::from_str(&json.out).unwrap();
    assert!(json["topics"].as_array().is_some_and(|topics| 5 < topics.len()), "{json}");
    guest.signal(Signal::INT).wait().assert_code(0);
    run.stop();
}

#[test]
fn a_parameter_is_changed_while_the_robot_drives_and_the_change_is_an_event() {
    let robot = Robot::new();
    let run = realtime(&robot);

    let list = said(&robot, &["param", "list", "controller"]);
    assert_eq!(row(&list, SPEED)[1..5], ["0.15", "m/s", "0.01..0.22", "same"]);
    assert_eq!(row(&list, "pacing")[2..], ["fixed", "every_pair", "[1]:7"]);
    assert_eq!(row(&list, "[1]")[1], "config/controller/lab_robot.toml");
    assert_eq!(said(&robot, &["param", "get", "controller", SPEED]).out, "0.15\n");

    said(&robot, &["param", "set", "controller", SPEED, "0.05"]).assert_says(&["0.15 -> 0.05"]);
    assert_eq!(said(&robot, &["param", "get", "controller", SPEED]).out, "0.05\n");
    let echo = said(&robot, &["topic", "echo", "cmd_vel", "--field", "linear", "-n", "5"]);
    assert_eq!(echo.out.lines().last(), Some("0.05"), "it drives ahead\n{}", echo.story());
    let events = said(&robot, &["events"]);
    events.assert_says(&["controller wall_following.speed_m_s 0.15 -> 0.05"]);

    for (node, key, value, why) in [
        ("controller", SPEED, "9", "give 0.01 to 0.22"),
        ("controller", SPEED, "-1", "give 0.01 to 0.22"),
        ("controller", SPEED, "fast", "is no number"),
        (
            "controller",
            "input_age_max_s",
            "9",
            "lab_robot.toml:11, then `teseo restart controller`",
        ),
        ("pairing", "policy", "adaptive", "then `teseo down` and `teseo up`"),
        ("controller", "sped_m_s", "0.1", "did you mean `corridor_following.speed_m_s` or"),
        ("simulator", "deadman.timeout_ms", "9", "is what stops the robot"),
        ("simulator", "lidar.noise", "gazbo", "did you mean `gazebo`?"),
        ("simulator", "stop_at_collision", "1", "give true or false"),
    ] {
        refused(&robot, &["param", "set", node, key, value], 1, why);
    }
    said(&robot, &["events"]).assert_says(&["refused wall_following.speed_m_s = 9"]);

    // Another life of the node goes by the launch file again.
    said(&robot, &["restart", "controller"]);
    assert_eq!(said(&robot, &["param", "get", "controller", SPEED]).out, "0.15\n");
    run.stop();
}

// It failed where files were told by their names alone.
#[test]
fn each_parameter_s_file_can_be_opened_also_where_two_have_one_name() {
    let robot = Robot::new();
    robot.folder("own");
    robot.file("own/launch.toml", include_str!("../config/controller/lab_robot.toml"));
    let own = "\"own/launch.toml\"\n\n[process.parameters]\nperiod_s = 0.04\n";
    let launch_file =
        robot.launch_file_from(REALTIME, &[("\"controller/lab_robot.toml\"", own.trim_end())]);
    let run = robot.start_up(&[&launch_file]);
    robot.await_ready();

    let list = said(&robot, &["param", "list", "controller"]);
    for (key, value) in [("period_s", "0.04"), ("input_age_max_s", "0.5")] {
        let from = row(&list, key)[5];
        let (number, line) = from.split_once(':').unwrap();
        let file = std::fs::read_to_string(row(&list, number)[1]).unwrap();
        let line = file.lines().nth(line.parse::<usize>().unwrap() - 1).unwrap();
        assert!(line.starts_with(&format!("{key} = {value}")), "{line}\n{}", list.story());
    }
    run.stop();
}

#[test]
fn words_and_switches_change_too_and_those_of_every_node() {
    let robot = Robot::new();
    let run = realtime(&robot);
    let ranges = || said(&robot, &["topic", "echo", "/scan", "--field", "range", "-n", "2"]).out;
    let is_noisy = |ranges: &str| ranges.lines().next() != ranges.lines().nth(1);

    said(&robot, &["estop"]);
    assert!(crate::robot::wait_until(Duration::from_secs(10), || !is_noisy(&ranges())));
    said(&robot, &["param", "set", "/simulator", "lidar.noise", "gazebo"])
        .assert_says(&["ideal -> gazebo"]);
    assert!(is_noisy(&ranges()), "a robot at rest sees the same walls, but for the noise");
    for (node, key, value, former) in [
        ("simulator", "stop_at_collision", "false", "true"),
        ("odometry", "track_m", "0.17", "0.16"),
        ("pairing", "slop_ms", "40", "150"),
        ("controller", "algorithm", "corridor_following", "wall_following"),
    ] {
        said(&robot, &["param", "set", node, key, value])
            .assert_says(&[&format!("{former} -> {value}")]);
        assert_eq!(said(&robot, &["param", "get", node, key]).out, format!("{value}\n"));
    }
    said(&robot, &["param", "describe", "pairing", "slop_ms"]).assert_says(&[
        "value     40 ms",
        "may be    1..500",
        "default   50 ms",
    ]);
    let all = said(&robot, &["param", "list"]);
    all.assert_says(&["pairing:\n", "simulator:\n", "3 words"]);
    assert!(all.out.lines().all(|line| line.chars().count() <= 100), "{}", all.story());
    said(&robot, &["param", "describe", "simulator", "lidar.noise"])
        .assert_says(&["value     gazebo", "may be    ideal, gazebo, lds01"]);

    // What was dumped before a change brings back what was.
    let dump = said(&robot, &["param", "dump", "controller"]).out;
    assert!(dump.contains("algorithm = \"corridor_following\"\n"), "{dump}");
    said(&robot, &["param", "set", "controller", SPEED, "0.05"]);
    let file = robot.file("dump.toml", &dump);
    said(&robot, &["param", "load", "controller", &file]).assert_says(&["0.05 -> 0.15"]);
    said(&robot, &["param", "load", "controller", &file]).assert_says(&["goes by that already"]);
    let file = robot.file("dump.toml", "input_age_max_s = 1\nwall_following.speed_m_s = 0.1\n");
    robot
        .start(&["param", "load", "controller", &file])
        .wait()
        .assert_code(1)
        .assert_says(&["is read when the node starts", "0.15 -> 0.1"]);
    said(&robot, &["estop", "--clear"]);
    run.stop();
}

#[test]
fn in_lock_step_everything_is_shown_and_nothing_is_changed() {
    let robot = Robot::new();
    let unseen = robot.up(&LONG);
    let run = robot.start_up(&LONG).await_active();

    for verb in [
        &["topic", "list"][..],
        &["topic", "echo", "odom", "--once"],
        &["node", "info", "simulator"],
        &["lifecycle", "get"],
        &["graph"],
        &["param", "list", "controller"],
    ] {
        said(&robot, verb);
    }
    refused(&robot, &["topic", "delay", "odom"], 1, "simulated time");
    let speed = ["param", "set", "controller", "wall_following.speed_m_s", "0.1"];
    refused(&robot, &speed, 1, "in lock-step nothing is changed");
    let seen = run.wait();
    assert_eq!(seen.digest(), unseen.digest(), "SEED=1\n{}", seen.story());
}

#[test]
fn what_is_wrong_is_told_in_lines_that_a_terminal_has_room_for() {
    let robot = Robot::new();
    let run = realtime(&robot);
    for words in [
        "tpoic list",
        "topic lst",
        "topic echo",
        "topic echo nothing --once",
        "topic echo scan --field nothing",
        "topic echo controller/status --field nothing",
        "topic hz scan -w 1",
        "topic info controller/nothing",
        "topic find Nothing",
        "topic pub nothing x=1",
        "topic pub cmd_vel linear=1",
        "topic pub teleop_cmd_vel linear=1",
        "topic pub controller/status",
        "topic pub pose geometry_msgs/msg/Pose",
        "topic pub pose nothing=1",
        "node info nothing",
        "lifecycle get nothing",
        "lifecycle set controller nothing",
        "lifecycle set controller configure",
        "param list nothing",
        "param get controller nothing",
        "param get controller wall_following.nothing",
        "param get controller speed_m_s",
        "param set controller wall_following.speed_m_s 9",
        "param set controller wall_following.speed_m_s fast",
        "param set controller algorithm nothing",
        "param set controller input_age_max_s 1",
        "param set simulator deadman.emergency_angular_deceleration_rad_s2 1",
        "param load controller nothing.toml",
        "man nothing",
        "why nothing",
        "restart nothing",
        "logs nothing",
        "arm --robot nothing",
        "view --robot nothing",
        "report nothing",
        "check nothing.toml",
        "up nothing.toml",
        "up --set simulator.lidar.nose=gazebo",
        "up --set nothing=1",
        "emulate nothing",
        "bench nothing",
    ] {
        let ended = robot.start(&words.split(' ').collect::<Vec<_>>()).wait();
        assert_ne!(ended.code, 0, "{}", ended.story());
        assert!(!ended.err.is_empty(), "`{words}` says nothing\n{}", ended.story());
        for line in ended.err.lines().chain(ended.out.lines()) {
            // A word is not broken, and the way to a file may be a long one.
            let fits = line.chars().count() <= 100 || !line.trim().contains(' ');
            assert!(fits, "`{words}`: {line}");
        }
    }
    run.stop();
}

#[test]
fn a_wrong_verb_is_answered_with_what_was_probably_meant() {
    let robot = Robot::new();
    for (words, meant) in [
        (&["topics"][..], "subcommand exists: 'topic'"),
        (&["topic", "ehco"], "subcommand exists: 'echo'"),
        (&["param", "discribe"], "subcommand exists: 'describe'"),
        (&["rviz2"], "here that is `teseo view`"),
        (&["interface"], "here that is `teseo topic info TOPIC`"),
    ] {
        refused(&robot, words, 2, meant);
    }
    let odd = robot.start(&["pause"]).wait();
    assert!(!odd.story().contains("tip:"), "{}", odd.story());
}

#[test]
fn what_completes_words_and_the_manual_need_no_robot() {
    let robot = Robot::new();

    for (shell, mark) in
        [("bash", "complete -F"), ("zsh", "#compdef teseo"), ("fish", "complete -c")]
    {
        said(&robot, &["completions", shell]).assert_says(&[mark, "lifecycle"]);
    }
    said(&robot, &["man", "topic", "echo"]).assert_says(&[".TH teseo-topic-echo", "Examples"]);
    refused(&robot, &["man", "tpoic"], 1, "there is no verb `tpoic`; did you mean `topic`?");
}

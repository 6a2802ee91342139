//! Whatever dies comes back, as the launch file says, or the robot goes down and says why.

use std::fs;
use std::process::ExitCode;
use std::time::Duration;

use interfaces::topics::POSE;
use node::log::{Format, Options};
use node::{Arguments, Namespace};
use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{Ended, Robot, Run, test_of, wait_until};

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// Its nodes in the order in which they start.
const ORDER: [&str; 4] = ["pairing", "simulator", "odometry", "controller"];

const GAVE_UP: i32 = 3;
const NOT_STARTED: i32 = 4;
const HELD: i32 = 5;
const HAD_TO_KILL: i32 = 6;
const CONFIGURATION: i32 = 78;

/// Long enough on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(30);

#[test]
fn a_node_that_is_killed_comes_back_and_those_before_it_never_notice() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    let before: Vec<_> = ORDER[1..].iter().map(|name| run.node(name)).collect();
    run.node("odometry").signal(Signal::KILL);

    let run = run.await_count("READY", 2);
    let after: Vec<_> = ORDER[1..].iter().map(|name| run.node(name)).collect();
    assert_eq!(before[0], after[0], "the simulator starts before odometry\n{}", run.output());
    assert_ne!(before[1], after[1], "{}", run.output());
    assert_ne!(before[2], after[2], "the controller starts after odometry\n{}", run.output());

    let ended = run.go_on(Duration::from_millis(300)).stop();
    ended.assert_says(&["odometry     failed: was killed by signal 9 (SIGKILL)"]);
}

#[test]
fn one_for_one_restarts_nobody_else() {
    let robot = Robot::new();
    let one = "restart = \"on-failure\"\nstrategy = \"one-for-one\"";
    let launch_file =
        lab_robot(&robot, &[("restart = \"on-failure\"", one), ("requires", "after")]);
    let run = ready_with(&robot, &launch_file);
    let controller = run.node("controller");
    run.node("odometry").signal(Signal::KILL);

    let run = run.await_count("READY", 2);
    assert_eq!(run.node("controller"), controller, "{}", run.output());
    run.stop();
}

#[test]
fn all_restarts_everybody() {
    let robot = Robot::new();
    let all = "restart = \"on-failure\"\nstrategy = \"all\"";
    let launch_file = lab_robot(&robot, &[("restart = \"on-failure\"", all)]);
    let run = ready_with(&robot, &launch_file);
    let simulator = run.node("simulator");
    run.node("controller").signal(Signal::KILL);

    let run = run.await_count("READY", 2);
    assert_ne!(run.node("simulator"), simulator, "{}", run.output());
    run.stop();
}

#[test]
fn a_node_that_hangs_is_killed_by_its_watchdog_and_comes_back() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    run.node("controller").signal(Signal::STOP);

    let run = run.await_count("READY", 2);
    run.stop().assert_says(&["controller   failed: hung: its loop stood still"]);
}

#[test]
fn a_crash_loop_is_slowed_down_and_then_given_up_in_order() {
    let robot = Robot::new();
    let launch_file = lab_robot_with(
        &robot,
        "type = \"simple\"\nexec = [\"/bin/sh\", \"-c\", \"sleep 0.1; exit 3\"]\n\
         restart = \"on-failure\"\nrestart_delay_ms = 50\nstart_limit_burst = 4",
    );
    let ended = robot.up(&[&launch_file]);

    assert!([GAVE_UP, NOT_STARTED].contains(&ended.code), "{}", ended.story());
    let failures = ended.out.matches("stranger     failed: exited with code 3").count();
    assert_eq!(failures, 4, "as many as the limit allows\n{}", ended.story());
    let delays: Vec<_> = ended.out.lines().filter_map(restart_delay).collect();
    assert_eq!(delays.len(), 3, "{}", ended.story());
    assert!(delays.is_sorted() && delays[0] < delays[2], "{delays:?}\n{}", ended.story());
    let downs = ended.changed(" active -> inactive");
    assert!(downs.ends_with(&["controller", "odometry", "simulator", "pairing"]), "{downs:?}");
    ended.assert_says(&["stranger"]);
    robot.assert_nothing_left();
}

#[test]
fn exit_codes_78_and_125_say_not_to_try_again() {
    for code in [CONFIGURATION, 125] {
        let robot = Robot::new();
        let exec = format!("exec = [\"/bin/sh\", \"-c\", \"exit {code}\"]");
        let more = format!("type = \"notify\"\n{exec}\nrestart = \"always\"");
        let ended = robot.up(&[&lab_robot_with(&robot, &more)]);

        let expected = if code == CONFIGURATION { CONFIGURATION } else { NOT_STARTED };
        ended.assert_code(expected).assert_says(&[&format!("exited with code {code}")]);
        assert_eq!(ended.out.matches("failed: exited").count(), 1, "{}", ended.story());
        assert!(!ended.out.contains("starts again"), "{}", ended.story());
    }
}

#[test]
fn a_slow_start_is_waited_for_and_a_slower_one_is_not() {
    let slow =
        "type = \"notify\"\nexec = [\"/bin/sh\", \"-c\", \"sleep 300\"]\nstart_timeout_ms = 300";
    let robot = Robot::new();
    let ended = robot.up(&[&lab_robot_with(&robot, slow)]);

    ended.assert_code(NOT_STARTED);
    ended.assert_says(&["stranger did not come up: was not active within 300ms"]);
    assert_eq!(
        ended.changed(" active -> inactive"),
        ["controller", "odometry", "simulator", "pairing"]
    );
    robot.assert_nothing_left();
}

#[test]
fn one_that_refuses_to_stop_is_killed_and_the_exit_code_tells() {
    let robot = Robot::new();
    let stubborn = "type = \"simple\"\nstop_timeout_ms = 200\n\
        exec = [\"/bin/sh\", \"-c\", \"trap '' TERM INT HUP; while :; do sleep 1; done\"]";
    let run = ready_with(&robot, &lab_robot_with(&robot, stubborn));

    let ended = run.signal(Signal::INT).wait();
    ended.assert_code(HAD_TO_KILL).assert_says(&["killed by the supervisor"]);
    robot.assert_nothing_left();
}

#[test]
fn a_foreign_process_is_started_in_its_turn_watched_and_stopped() {
    let robot = Robot::new();
    let run = ready_with(
        &robot,
        &lab_robot_with(
            &robot,
            "type = \"simple\"\nenvironment = { GREETING = \"ahoy\" }\n\
             exec = [\"/bin/sh\", \"-c\", \"echo $GREETING $TESEO_NODE $TESEO_EPOCH; exec sleep 300\"]",
        ),
    );

    let ended = run.await_output("stranger: ahoy stranger 1").stop();
    let order = ended.changed(" inactive -> active");
    assert_eq!(order.last(), Some(&"stranger"), "{}", ended.story());
    let reverse = ended.changed(" active -> deactivating");
    assert!(reverse.is_empty(), "the states on the way are not told\n{}", ended.story());
    assert_eq!(
        ended.changed(" active -> inactive").first(),
        Some(&"stranger"),
        "{}",
        ended.story()
    );
}

#[test]
fn a_foreign_process_that_says_it_is_ready_is_active_then() {
    let robot = Robot::new();
    // One of ours, which the supervisor does not know as a node here.
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/lab_robot.toml");
    let exec = format!(
        "type = \"notify\"\nexec = [\"{}\", \"odometry\", \"--autostart\", \"--name=stranger\", \
         \"--config={config}\"]",
        env!("CARGO_BIN_EXE_teseo"),
    );
    let launch_file = lab_robot(
        &robot,
        &[
            (
                "name = \"odometry\"\nrequires = [\"simulator\"]",
                &format!("name = \"stranger\"\n{exec}"),
            ),
            ("requires = [\"odometry\"]", "after = [\"stranger\"]"),
            ("watchdog_ms = 500\n\n[process.parameters]\nsource = \"wheels\"\n", ""),
        ],
    );
    let run = ready_with(&robot, &launch_file);

    run.stop().assert_says(&["stranger     inactive -> active"]);
}

#[test]
fn nodes_start_after_those_they_name_whatever_the_order_of_the_file() {
    let robot = Robot::new();
    let launch_file = lab_robot(
        &robot,
        &[
            ("requires = [\"simulator\"]", "after = [\"controller\"]"),
            ("requires = [\"odometry\"]", "after = [\"simulator\"]"),
        ],
    );
    let ended = ready_with(&robot, &launch_file).stop();

    let order = ["pairing", "simulator", "controller", "odometry"];
    assert_eq!(ended.changed(" inactive -> active"), order, "{}", ended.story());
    let mut reverse = order;
    reverse.reverse();
    assert_eq!(ended.changed(" active -> inactive"), reverse, "{}", ended.story());
}

#[test]
fn an_active_node_whose_topics_carry_no_data_is_not_ready() {
    let robot = Robot::new();
    // Odometry waits for poses that nobody reports.
    let launch_file = lab_robot(
        &robot,
        &[
            ("source = \"wheels\"", "source = \"poses\""),
            (
                "restart = \"on-failure\"\nwatchdog_ms = 500\n\n[process.parameters]\nsource",
                "start_timeout_ms = 700\n\n[process.parameters]\nsource",
            ),
        ],
    );
    let ended = robot.up(&[&launch_file]);

    ended.assert_code(NOT_STARTED).assert_says(&["odometry", "carried no data"]);
    assert!(!ended.out.contains("READY"), "{}", ended.story());
}

#[test]
fn a_grandchild_of_a_node_that_died_does_not_live_on_beside_the_next() {
    let robot = Robot::new();
    let run = ready_with(
        &robot,
        &lab_robot_with(
            &robot,
            "type = \"simple\"\nrestart = \"on-failure\"\n\
             exec = [\"/bin/sh\", \"-c\", \"setsid sleep 301 & sleep 302\"]",
        ),
    );
    let sleepers = |seconds: &str| {
        let is_one = |process: &crate::robot::Process| process.command() == ["sleep", seconds];
        robot.processes().into_iter().filter(is_one).count()
    };
    assert!(wait_until(PATIENCE, || sleepers("301") == 1));
    run.child_running("sleep 301 & sleep 302").signal(Signal::KILL);

    let run = run.await_count("READY", 2);
    assert!(wait_until(PATIENCE, || sleepers("301") == 1 && sleepers("302") == 1));
    run.stop();
    robot.assert_nothing_left();
}

#[test]
fn a_hundred_at_once_want_one_robot_and_one_gets_it() {
    let robot = Robot::new();
    let launch_file = lab_robot(&robot, &[]);
    let runs: Vec<_> = (0..100).map(|_| robot.start(&["up", &launch_file])).collect();
    let mut winners = Vec::new();
    for run in runs {
        match run.wait_or(|run| run.output().contains("READY")) {
            Ok(ended) => {
                ended
                    .assert_code(5)
                    .assert_says(&["robot 'burger' is already running, held by process"]);
            }
            Err(run) => winners.push(run),
        }
    }
    assert_eq!(winners.len(), 1, "{winners:?}");
    for winner in winners {
        winner.stop();
    }
    robot.assert_nothing_left();
}

#[test]
fn the_verbs_see_and_steer_a_running_robot() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    let odometry = run.node("odometry");

    let status: Value = serde_json::from_str(&verb(&robot, &["status", "--json"], 0).out).unwrap();
    assert_eq!(status["state"], "ready");
    let names: Vec<_> =
        status["nodes"].as_array().unwrap().iter().map(|node| &node["name"]).collect();
    assert_eq!(names, ORDER);
    let memory = &status["shared_memory"];
    let (held, need) = (memory["bytes"].as_u64().unwrap(), memory["need"].as_u64().unwrap());
    assert!(held <= need && need < 3 * held, "holds {held} bytes, said to need {need}");
    verb(&robot, &["restart", "odometry"], 0);
    assert_ne!(run.node("odometry"), odometry, "{}", run.output());
    verb(&robot, &["stop", "controller"], 0);
    verb(&robot, &["status"], 1).assert_says(&["controller", "finalized"]);
    verb(&robot, &["start", "controller"], 0);
    run.node("controller").signal(Signal::KILL);
    let run = run.await_count("failed: was killed", 1).await_count("READY", 4);
    verb(&robot, &["why", "controller"], 0).assert_says(&["was killed by signal 9"]);
    verb(&robot, &["events"], 0).assert_says(&["READY", "was killed by signal 9"]);
    verb(&robot, &["stop", "nobody"], 1).assert_says(&["there is no node `nobody`"]);
    verb(&robot, &["down"], 0);
    run.wait().assert_code(0).assert_says(&["asked to stop"]);
    verb(&robot, &["status"], 3);
    verb(&robot, &["down"], 0);
    robot.assert_nothing_left();
}

// It failed where a node that lacks its input was waited for like one on its way.
#[test]
fn one_started_beside_a_node_that_is_down_is_there_and_said_to_send_nothing() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    verb(&robot, &["stop", "pairing"], 0);
    verb(&robot, &["stop", "controller"], 0);
    verb(&robot, &["start", "controller"], 0)
        .assert_says(&["controller is active, but sends nothing on cmd_vel"]);
    run.stop();
}

#[test]
fn one_started_says_who_stays_down_until_started_too() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    let still_down = "controller stays finalized: teseo start controller";
    verb(&robot, &["stop", "odometry"], 0).assert_says(&["takes down controller with it"]);
    verb(&robot, &["start", "odometry"], 0).assert_says(&["odometry is active\n", still_down]);
    verb(&robot, &["restart", "simulator"], 0).assert_says(&["active again\n", still_down]);
    verb(&robot, &["status"], 1);
    let last = verb(&robot, &["start", "controller"], 0);
    assert!(!last.out.contains("stays"), "{}", last.story());
    verb(&robot, &["status"], 0);
    run.stop();
}

#[test]
fn detached_a_robot_runs_on_until_it_is_taken_down() {
    let robot = Robot::new();
    let launch_file = lab_robot(&robot, &[]);
    verb(&robot, &["up", "--detach", &launch_file], 0).assert_says(&["READY"]);

    verb(&robot, &["status"], 0);
    verb(&robot, &["up", &launch_file], 5).assert_says(&["held by process"]);
    verb(&robot, &["down"], 0);
    robot.assert_nothing_left();
}

#[test]
fn a_runtime_directory_that_somebody_made_himself_outlives_its_robot() {
    let robot = Robot::new();
    fs::create_dir(robot.runtime()).unwrap();
    verb(&robot, &["up", "--detach", &lab_robot(&robot, &[])], 0);
    verb(&robot, &["down"], 0);

    assert_eq!(fs::read_dir(robot.runtime()).unwrap().count(), 0);
    fs::remove_dir(robot.runtime()).unwrap();
}

#[test]
fn detached_a_robot_that_does_not_come_up_says_so() {
    let robot = Robot::new();
    let launch_file = lab_robot_with(&robot, "type = \"notify\"\nexec = [\"/bin/false\"]");

    let ended = verb(&robot, &["up", "--detach", &launch_file], NOT_STARTED);
    ended.assert_says(&["stranger did not come up: exited with code 1"]);
    robot.assert_nothing_left();
}

#[test]
fn detached_a_robot_that_ends_by_itself_tells_how_until_it_runs_again() {
    let robot = Robot::new();
    let launch_file = lab_robot(&robot, &[]);
    verb(&robot, &["up", "--detach", &launch_file, "--for", "2"], 0).assert_says(&["READY"]);
    robot.await_no_process();

    let story = ["burger ended at ", "it said last:", "READY in"];
    let status = verb(&robot, &["status"], 3);
    status.assert_says(&story);
    let first = status.err.lines().next().unwrap_or_default();
    assert!(first.contains("2 s are over, cells 1"), "{}", status.story());
    let points = ["is running", "`teseo status` tells how it ended"];
    for other in [&["events"][..], &["logs"], &["restart", "controller"]] {
        verb(&robot, other, 3).assert_says(&points);
    }
    verb(&robot, &["why", "controller", "--robot", "burger"], 3).assert_says(&story);
    let other = verb(&robot, &["status", "--robot", "other"], 3);
    assert!(!other.err.contains("ended"), "{}", other.story());
    verb(&robot, &["up", &launch_file, "--for", "1"], 0);
    robot.assert_nothing_left();
}

#[test]
fn what_a_dead_run_has_left_is_cleared_and_what_lives_is_not() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    let guardian = format!("held by process {}", run.process().pid);
    let clear = ["clear", "--robot", "burger"];
    verb(&robot, &clear, HELD).assert_says(&[&guardian]);
    verb(&robot, &[clear.as_slice(), &["--or-unfinished"]].concat(), 0);
    verb(&robot, &["status"], 0);

    // All at once, so that nobody tidies up.
    for signal in [Signal::STOP, Signal::KILL] {
        robot.processes().into_iter().for_each(|process| process.signal(signal));
    }
    run.wait().assert_code(137);
    robot.await_no_process();
    assert_ne!(robot.segments(), [""; 0]);
    verb(&robot, &clear, 0);
    robot.assert_nothing_left();
    verb(&robot, &clear, 0);
}

#[test]
fn a_node_that_nobody_supervises_keeps_its_robot_to_itself() {
    let robot = Robot::new();
    let launch_file = lab_robot(&robot, &[]);
    let node = robot.start(&["odometry", "--autostart", "--config", &launch_file]);
    let is_there =
        || 0 < Namespace::under(&robot.runtime(), "burger").unwrap().shared_memory().files;
    assert!(wait_until(PATIENCE, is_there), "{}", node.output());
    let holder = format!("held by process {}", node.process().pid);

    verb(&robot, &["clear", "--robot", "burger"], HELD).assert_says(&[&holder]);
    verb(&robot, &["up", &launch_file], HELD).assert_says(&[&holder]);
    node.process().signal(Signal::KILL);
    node.wait().assert_code(137);
    verb(&robot, &["clear", "--robot", "burger"], 0);
    robot.assert_nothing_left();
}

#[test]
fn what_a_killed_node_left_unfinished_is_cleared_beside_the_living() {
    let robot = Robot::new();
    let launch_file = lab_robot(&robot, &[]);
    let node = robot.start(&["odometry", "--autostart", "--config", &launch_file]);
    let namespace = Namespace::under(&robot.runtime(), "burger").unwrap();
    assert!(wait_until(PATIENCE, || 0 < namespace.shared_memory().files), "{}", node.output());
    let unfinished = format!("/dev/shm/{}unfinished", namespace.prefix());
    fs::write(&unfinished, "").unwrap();

    verb(&robot, &["clear", "--robot", "burger", "--or-unfinished"], 0);
    assert!(!fs::exists(&unfinished).unwrap());
    assert_ne!(namespace.shared_memory().files, 0);
    node.signal(Signal::TERM).wait().assert_code(0);
    verb(&robot, &["clear", "--robot", "burger"], 0);
    robot.assert_nothing_left();
}

#[test]
fn a_node_that_publishes_on_events_only_is_ready_before_the_first() {
    let alarm = |node: &mut node::Node<'_>| {
        let _alarm = node.publish_on_event(&POSE)?;
        while node.tick()?.is_some() {}
        Ok(())
    };
    // This same binary, started by the supervisor below.
    if std::env::var_os("TESEO_NODE").is_some() {
        assert_eq!(node::start(&own_arguments(), "stranger", alarm), ExitCode::SUCCESS);
        return;
    }
    let robot = Robot::new();
    let binary = std::env::current_exe().unwrap();
    let command = format!("exec {} {} --exact", binary.display(), test_of(&alarm));
    let launch_file = robot.file("launch.toml", "");
    let keys = format!(
        "exec = [\"/bin/sh\", \"-c\", \"{command}\"]\n\
         environment = {{ LAUNCH_FILE = \"{launch_file}\" }}"
    );
    let run = ready_with(&robot, &lab_robot_with(&robot, &keys));

    // Longer than any other topic may be silent.
    let ended = run.go_on(Duration::from_millis(1_500)).stop();
    assert!(!ended.out.contains("sends nothing"), "{}", ended.story());
    assert_eq!(ended.topics()["pose"]["sent"], 0, "{}", ended.story());
}

#[test]
fn systemd_is_asked_for_time_on_the_way_up_and_down_but_not_in_between() {
    let robot = Robot::new();
    let path = robot.file("systemd", "");
    fs::remove_file(&path).unwrap();
    let systemd = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    systemd.set_nonblocking(true).unwrap();
    let environment = [("NOTIFY_SOCKET", path.as_str())];
    let run = robot.start_in(&environment, &["up", &lab_robot(&robot, &[])]);
    run.await_count("READY", 1).go_on(Duration::from_millis(1_500)).stop();

    let mut bytes = [0; 1_000];
    let said = std::iter::from_fn(|| {
        let length = systemd.recv(&mut bytes).ok()?;
        let text = String::from_utf8(bytes[..length].to_vec()).unwrap();
        Some(text.split('=').next().unwrap().to_owned())
    });
    let mut said: Vec<_> = said.filter(|word| word != "STATUS" && word != "WATCHDOG").collect();
    // The slower the machine, the more often it is asked.
    said.dedup();
    assert_eq!(said, ["EXTEND_TIMEOUT_USEC", "READY", "STOPPING", "EXTEND_TIMEOUT_USEC"]);
}

#[test]
fn strangers_on_the_notify_socket_change_nothing() {
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    let socket = std::os::unix::net::UnixDatagram::unbound().unwrap();
    socket.connect(robot.runtime().join("burger/notify")).unwrap();
    let binary: Vec<u8> = (0..=255).cycle().take(3000).collect();
    for datagram in [b"WATCHDOG=trigger".as_slice(), b"STOPPING=1", &binary, &vec![0; 60_000]] {
        for _ in 0..20 {
            while socket
                .send(datagram)
                .is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
            {}
        }
    }

    let run = run.go_on(Duration::from_millis(300));
    let status: Value = serde_json::from_str(&verb(&robot, &["status", "--json"], 0).out).unwrap();
    assert_eq!(status["ignored"]["notify"], 80, "{status}");
    assert!(!run.stop().out.contains("failed"));
}

#[test]
fn nonsense_on_the_control_socket_changes_nothing() {
    use std::io::{Read, Write};
    let robot = Robot::new();
    let run = ready(&robot, &[]);
    for nonsense in
        [&b"\n"[..], b"{}\n", b"{\"verb\":\"destroy\"}\n", &vec![0xff; 100_000], b"{\"verb\":"]
    {
        let mut client =
            std::os::unix::net::UnixStream::connect(robot.runtime().join("burger/control"))
                .unwrap();
        let _ = client.write_all(nonsense);
        let _ = client.shutdown(std::net::Shutdown::Write);
        client.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut answer = String::new();
        let _ = client.read_to_string(&mut answer);
        assert!(!answer.contains("\"ok\""), "{answer}");
    }

    verb(&robot, &["status"], 0);
    run.stop();
}

#[test]
fn what_a_node_prints_is_kept_and_told_also_after_it_died() {
    let robot = Robot::new();
    let more = "type = \"simple\"\nrestart = \"on-failure\"\n\
        exec = [\"/bin/sh\", \"-c\", \"echo life $TESEO_EPOCH; exec sleep 300\"]";
    let run = ready_with(&robot, &lab_robot_with(&robot, more)).await_output("stranger: life 1");
    run.child_running("sleep 300").signal(Signal::KILL);

    let run = run.await_output("stranger: life 2");
    verb(&robot, &["logs", "stranger"], 0).assert_says(&["life 1", "life 2"]);
    run.stop();
}

/// A robot in real time that restarts what dies, ready.
fn ready<'a>(robot: &'a Robot, arguments: &[&str]) -> Run<'a> {
    let launch_file = lab_robot(robot, &[]);
    robot.start_up(&[&[launch_file.as_str()], arguments].concat()).await_count("READY", 1)
}

fn ready_with<'a>(robot: &'a Robot, launch_file: &str) -> Run<'a> {
    robot.start_up(&[launch_file]).await_count("READY", 1)
}

/// `config/lab_robot.toml` with each `(old, new)` of `changes` made.
fn lab_robot(robot: &Robot, changes: &[(&str, &str)]) -> String {
    robot.launch_file_from(LAB_ROBOT, changes)
}

/// `config/lab_robot.toml` with one more process, the last.
fn lab_robot_with(robot: &Robot, keys: &str) -> String {
    let last = "parameters_file = \"controller/lab_robot.toml\"\n";
    let more = format!("{last}\n[[process]]\nname = \"stranger\"\n{keys}\n");
    lab_robot(robot, &[(last, &more)])
}

/// Runs a verb to its end, which has this exit code.
#[track_caller]
fn verb(robot: &Robot, arguments: &[&str], code: i32) -> Ended {
    let ended = robot.start(arguments).wait();
    ended.assert_code(code);
    ended
}

/// What a node is told, where the test binary is one.
pub(crate) fn own_arguments() -> Arguments {
    let log = Options { format: Format::Text, level: "warn".parse().unwrap() };
    Arguments {
        config: std::env::var_os("LAUNCH_FILE").unwrap().into(),
        name: std::env::var("TESEO_NODE").ok(),
        sets: Vec::new(),
        autostart: false,
        epoch: std::env::var("TESEO_EPOCH").unwrap().parse().ok(),
        log,
    }
}

/// [s] In a line that says that a node starts again.
fn restart_delay(line: &str) -> Option<f64> {
    let (_, rest) = line.split_once("starts again in ")?;
    rest.split_whitespace().next()?.parse().ok()
}

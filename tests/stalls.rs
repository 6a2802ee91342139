//! Who stands still holds nobody up: a supervisor, a reader of samples, a reader of standard output,
//! a disk.
//!
//! Each test says how late the loops of the nodes came, one of which writes a thousand lines a
//! second. `LASTS` is for how many seconds each fault lasts; scripts/stalls takes a minute.

use std::process::{Command, ExitCode, Stdio};
use std::time::Duration;

use interfaces::{Permission, StopCause};
use node::{Node, Session};
use rustix::process::Signal;

use crate::robot::{Ended, Robot, Run, alone, lasts, mount_namespace, test_of};
use crate::supervision::own_arguments;
use crate::witness::Witness;

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// [s] In a test. A loop that the fault held up would stand still for all of it.
const LASTS: u64 = 2;

/// One line of the node that writes a lot: a pipe holds 640 of them.
const LINE: &str = "a line of a hundred bytes, of which a node with much to say writes a thousand a second, or more";

// Broken on purpose: with a pipe for its standard output the talker stood still until its watchdog
// killed it; without `be_fair`, nodes were killed as hung.
#[test]
fn while_the_supervisor_stands_still_loops_go_on_and_the_robot_drives_again_after() {
    alone(|robot| {
        let run = start(robot, &[], &[]).await_count("READY", 1);
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        let supervisor = run.supervisor();
        supervisor.signal(Signal::STOP);
        fill_queue(robot);
        // The pairing stands with it, so that there is nothing to command.
        witness.await_state(Permission::Held, StopCause::Silence);
        let run = run.go_on(lasts(LASTS));
        supervisor.signal(Signal::CONT);

        witness.await_state(Permission::Armed, StopCause::None);
        drop((witness, session));
        let ended = run.go_on(Duration::from_millis(500)).stop();
        assert!(!ended.out.contains("failed"), "{}", ended.story());
        assert_loops_went_on("F7 supervisor stopped", &ended);
    });
}

/// The kernel keeps ten datagrams for one who does not read: strangers' ones here, so that no node's
/// ping is among them.
fn fill_queue(robot: &Robot) {
    let socket = std::os::unix::net::UnixDatagram::unbound().unwrap();
    socket.set_nonblocking(true).unwrap();
    socket.connect(robot.runtime().join("burger/notify")).unwrap();
    while socket.send(b"WATCHDOG=1").is_ok() {}
}

#[test]
fn a_reader_that_stands_still_costs_its_publishers_nothing() {
    let robot = Robot::new();
    let patient = [("restart = \"on-failure\"\n", ""), ("watchdog_ms = 500\n", "")];
    let run = start(&robot, &patient, &[]).await_count("READY", 1);
    let controller = run.node("controller");
    controller.signal(Signal::STOP);
    let run = run.go_on(lasts(LASTS));
    controller.signal(Signal::CONT);
    let ended = run.go_on(Duration::from_millis(500)).stop();

    ended.assert_counters_close();
    for topic in ["scan", "odom", "sensor_pair"] {
        let lost = ended.topics()[topic]["readers"]["controller"]["lost"].as_u64().unwrap();
        assert!(0 < lost, "{topic}: lost {lost}\n{}", ended.story());
    }
    assert_loops_of("F14 reader of scans stopped", &ended, &["simulator", "talker"]);
}

#[test]
fn a_log_disk_that_is_full_costs_lines_and_holds_no_loop_up() {
    with_log_disk("size=64k", "F16 log disk full", "No space left on device");
}

#[test]
fn a_log_directory_that_is_read_only_costs_lines_and_holds_no_loop_up() {
    with_log_disk("ro", "F16 log directory read-only", "Read-only file system");
}

fn with_log_disk(options: &str, what: &str, why: &str) {
    let Some(mut wrapper) = mount_namespace() else { return };
    let robot = Robot::new();
    let directory = robot.folder("logs");
    let script = format!("mount -t tmpfs -o {options} tmpfs {directory}; exec \"$@\"");
    wrapper.extend(["sh", "-euc", &script, "sh"]);
    let run = start_under(&robot, &wrapper, &[], &["--log-dir", &directory], |_| ());
    let run = run.await_count("READY", 1).go_on(lasts(LASTS));
    let disk = robot.status()["log"]["disk"].clone();
    let ended = run.stop();

    assert!(disk.as_str().is_some_and(|disk| disk.contains(why)), "{disk}\n{}", ended.story());
    assert_loops_went_on(what, &ended);
}

#[test]
fn a_standard_output_that_nobody_reads_holds_no_loop_up() {
    let robot = Robot::new();
    let (out_reader, out) = std::io::pipe().unwrap();
    let (err_reader, err) = std::io::pipe().unwrap();
    let run = start_under(&robot, &[], &[], &[], |command| {
        command.stdout(Stdio::from(out)).stderr(Stdio::from(err));
    });
    robot.await_ready();
    let ended = run.go_on(lasts(LASTS)).signal(Signal::INT).wait();
    drop((out_reader, err_reader));

    ended.assert_code(0);
    assert_loops_went_on("F16 nobody reads standard output", &ended);
}

#[test]
fn a_standard_output_that_is_closed_ends_nothing() {
    let robot = Robot::new();
    let (out_reader, out) = std::io::pipe().unwrap();
    drop(out_reader);
    let closed = ["sh", "-c", "exec \"$@\" 2>&-", "sh"];
    let run = start_under(&robot, &closed, &[], &[], |command| {
        command.stdout(Stdio::from(out));
    });
    robot.await_ready();
    let ended = run.go_on(lasts(LASTS)).signal(Signal::INT).wait();

    ended.assert_code(0);
    assert_loops_went_on("F16 standard output closed", &ended);
}

#[test]
fn without_a_fault_loops_are_as_late_as_this() {
    let robot = Robot::new();
    let run = start(&robot, &[], &[]).await_count("READY", 1);
    let ended = run.go_on(lasts(LASTS)).stop();

    assert_loops_went_on("no fault", &ended);
}

/// A node with much to say: of the others' robots, started by their supervisors.
#[test]
fn one_who_writes_a_thousand_lines_a_second() {
    if std::env::var_os("TESEO_NODE").is_none() {
        return;
    }
    let talk = |node: &mut Node<'_>| {
        node.set_period(Duration::from_millis(1));
        let lines = node.gauge("lines");
        while let Some(tick) = node.tick()? {
            if tick.due {
                eprintln!("{LINE}");
                lines.count();
            }
        }
        Ok(())
    };
    assert_eq!(node::start(&own_arguments(), "talker", talk), ExitCode::SUCCESS);
}

fn start<'a>(robot: &'a Robot, changes: &[(&str, &str)], arguments: &[&str]) -> Run<'a> {
    start_under(robot, &[], changes, arguments, |_| ())
}

/// The lab's robot, each `(old, new)` of `changes` made, with one more node that writes a lot.
fn start_under<'a>(
    robot: &'a Robot,
    wrapper: &[&str],
    changes: &[(&str, &str)],
    arguments: &[&str],
    change: impl FnOnce(&mut Command),
) -> Run<'a> {
    let binary = std::env::current_exe().unwrap();
    let test = test_of(&one_who_writes_a_thousand_lines_a_second);
    let command = format!("exec {} {test} --exact --nocapture", binary.display());
    let launch_file = robot.file("launch.toml", "");
    let last = "parameters_file = \"controller/lab_robot.toml\"\n";
    let talker = format!(
        "{last}\n[[process]]\nname = \"talker\"\nexec = [\"/bin/sh\", \"-c\", \"{command}\"]\n\
         environment = {{ LAUNCH_FILE = \"{launch_file}\" }}\nwatchdog_ms = 500\n"
    );
    // The watchdogs of all are changed alike.
    let changes = [&[(last, talker.as_str())], changes].concat();
    let launch_file = robot.launch_file_from(LAB_ROBOT, &changes);
    let sets = [launch_file.as_str(), "--set=simulator.stop_at_collision=false"];
    robot.start_up_under(wrapper, &[&sets, arguments].concat(), change)
}

fn assert_loops_went_on(what: &str, ended: &Ended) {
    assert_loops_of(what, ended, &["simulator", "controller", "talker"]);
}

/// No loop stood still for the half of the fault, and most lines were written.
fn assert_loops_of(what: &str, ended: &Ended, nodes: &[&str]) {
    for node in nodes {
        let [p50, p99, max] =
            ["p50", "p99", "max"].map(|name| ended.figure(node, &format!("late_{name}_us")) / 1e3);
        let overruns = ended.figure(node, "overruns");
        println!("| {what} | {node} | {overruns} | {p50:.2} | {p99:.2} | {max:.2} |");
        let longest = Duration::from_secs_f64(max / 1e3);
        assert!(
            longest < lasts(LASTS) / 2,
            "{node} stood still for {longest:?}\n{}",
            ended.story()
        );
    }
    let lines = ended.figure("talker", "lines");
    assert!(250.0 * lasts(LASTS).as_secs_f64() < lines, "{lines} lines\n{}", ended.story());
}

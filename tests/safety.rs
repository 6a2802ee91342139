//! A robot that stops: whatever ceases, hangs or lies, the wheels stand still, and move again only
//! when they may.

use std::time::Duration;

use interfaces::{Permission, StopCause};
use node::{Session, clock};
use rustix::process::Signal;
use serde_json::Value;

use crate::robot::{Robot, Run, alone};
use crate::terminal::Terminal;
use crate::witness::Witness;

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// The dead-man's default, and what a busy machine may add to it: in tests only what is order, not
/// what is time, is held tight.
const STOPPED_AFTER: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(2));

/// The robot that drives, never restarts anybody, and bears being stopped for long.
fn driving(robot: &Robot) -> Run<'_> {
    let file = robot.launch_file_from(
        LAB_ROBOT,
        &[("restart = \"on-failure\"\n", ""), ("watchdog_ms = 500\n", "")],
    );
    robot.start_up(&[&file]).await_count("READY", 1)
}

/// The robot that drives, and starts again what dies, but its controller not before the dead-man
/// has noticed.
fn enduring(robot: &Robot) -> Run<'_> {
    let teseo = env!("CARGO_BIN_EXE_teseo");
    let late = format!("sleep 0.4; exec {teseo} controller \\\"$@\\\"");
    let name = "name = \"controller\"\n";
    let slow = format!("{name}exec = [\"/bin/sh\", \"-c\", \"{late}\", \"sh\"]\n");
    let file = robot.launch_file_from(LAB_ROBOT, &[(name, &slow)]);
    robot.start_up(&[&file]).await_count("READY", 1)
}

fn motion(robot: &Robot) -> Value {
    let ended = robot.start(&["status", "--json"]).wait();
    serde_json::from_str::<Value>(&ended.out).unwrap_or_default()["motion"].clone()
}

#[test]
fn when_the_controller_dies_the_robot_stops_and_drives_on_without_hands() {
    alone(|robot| {
        let run = enduring(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        run.node("controller").signal(Signal::KILL);

        let braking = witness.await_state(Permission::Braking, StopCause::Silence);
        let silent = braking.header.stamp.since(braking.command_received);
        let (least, most) = STOPPED_AFTER;
        assert!(least <= silent && silent < most, "stopped after {silent:?}");
        witness.await_state(Permission::Held, StopCause::Silence);
        let armed = witness.await_state(Permission::Armed, StopCause::None);
        assert_eq!((armed.trips, armed.command_epoch), (1, 2), "the new life drives");
        run.await_output("armed: commands move the robot").stop();
    });
}

#[test]
fn when_the_controller_hangs_the_robot_stops_and_hears_the_old_life_no_more() {
    alone(|robot| {
        let run = driving(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        let controller = run.node("controller");
        controller.signal(Signal::STOP);
        witness.await_state(Permission::Held, StopCause::Silence);

        // It wakes up with full queues, and goes on where it was: with a speed.
        controller.signal(Signal::CONT);
        witness.await_state(Permission::Armed, StopCause::None);
        run.stop();
    });
}

#[test]
fn who_trips_too_often_waits_for_a_person() {
    alone(|robot| {
        let file = robot.launch_file_from(LAB_ROBOT, &[("watchdog_ms = 500\n", "")]);
        let run = robot.start_up(&[&file]).await_count("READY", 1);
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        let controller = run.node("controller");
        for trip in 1..=4 {
            witness.await_state(Permission::Armed, StopCause::None);
            controller.signal(Signal::STOP);
            let held = witness.await_state(Permission::Held, StopCause::Silence);
            assert_eq!(held.needs_person, u8::from(trip == 4), "at trip {trip}");
            controller.signal(Signal::CONT);
        }
        let run = run.go_on(Duration::from_secs(1));
        assert_eq!(motion(robot)["permission"], "held");

        // Whoever drives the wheels next knows of it.
        run.node("simulator").signal(Signal::KILL);
        let held = witness.await_state(Permission::Held, StopCause::NotArmed);
        assert_eq!((held.header.epoch, held.needs_person), (2, 1));
        let run = run.go_on(Duration::from_secs(1));
        assert_eq!(motion(robot)["permission"], "held");

        let armed = robot.start(&["arm"]).wait();
        armed.assert_code(0);
        witness.await_state(Permission::Armed, StopCause::None);
        run.stop();
    });
}

#[test]
fn the_emergency_stop_needs_no_supervisor_and_outlives_the_run() {
    alone(|robot| {
        let run = driving(robot);
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        let supervisor = run.supervisor();
        supervisor.signal(Signal::STOP);
        robot.start(&["estop", "--reason", "a cat"]).wait().assert_code(0);
        let held = witness.await_state(Permission::Held, StopCause::EmergencyStop);
        assert_eq!(held.emergency_stop, 1);
        supervisor.signal(Signal::CONT);
        drop((witness, session));
        run.stop();

        // The next run finds the robot as it was left.
        let run = driving(robot).go_on(Duration::from_millis(300));
        assert_eq!(motion(robot)["permission"], "held", "{}", run.output());
        let clear = robot.start(&["estop", "--clear"]).wait();
        clear.assert_code(0).assert_says(&["released", "a cat"]);
        run.await_output("armed: commands move the robot").stop();
    });
}

// In lock-step it is the only thing on screen that tells a robot which waits from one that hangs.
#[test]
fn a_robot_that_comes_up_under_an_emergency_stop_says_what_holds_it_and_drives_when_it_is_released()
{
    let robot = Robot::new();
    let latch = robot.start(&["estop", "--robot", "burger", "--reason", "a cat"]).wait();
    latch.assert_code(0);
    let terminal = Terminal::new(100, 30);
    let run = terminal.start(&robot, &["up", "--until", "round-trip"], &[]);

    terminal.await_screen("what holds the robot, and what releases it", |screen| {
        let said = screen.split_whitespace().collect::<Vec<_>>().join(" ");
        said.contains(
            "its emergency stop is latched, by a cat; `teseo estop --clear --robot burger`",
        )
    });
    terminal.await_screen("it in the live line too", |screen| {
        let is_live = |line: &&str| line.contains(" s simulated ");
        let live = screen.lines().find(is_live).unwrap_or_default().to_owned();
        live.contains("emergency stop: stands still until teseo estop --clear")
    });
    robot.start(&["estop", "--clear", "--robot", "burger"]).wait().assert_code(0);
    run.wait().assert_code(0);
    assert!(terminal.shown().contains("round trip"), "{}", terminal.shown());
}

#[test]
fn when_the_supervisor_dies_the_wheels_are_stopped_before_the_process_ends() {
    alone(|robot| {
        let run = driving(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        let killed = clock::now();
        run.supervisor().signal(Signal::KILL);

        let braking = witness.await_state(Permission::Braking, StopCause::SupervisorLost);
        let held = witness.await_state(Permission::Held, StopCause::SupervisorLost);
        assert!(killed <= braking.header.stamp && braking.header.stamp < held.header.stamp);
        drop((witness, session));
        assert_eq!(run.wait().code, 128 + 9);
    });
}

// Broken on purpose: where the simulator did not look for its supervisor, it never braked for that.
#[test]
fn when_guardian_and_supervisor_die_at_once_the_wheels_stop_and_the_next_robot_comes_up() {
    alone(|robot| {
        let run = driving(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        let both = [run.process(), run.supervisor()];
        for signal in [Signal::STOP, Signal::KILL] {
            for process in both {
                process.signal(signal);
            }
        }

        witness.await_state(Permission::Braking, StopCause::SupervisorLost);
        witness.await_state(Permission::Held, StopCause::SupervisorLost);
        drop((witness, session));
        assert_eq!(run.wait().code, 128 + 9);
        robot.await_no_process();
        driving(robot).stop();
    });
}

#[test]
fn who_kills_the_guardian_on_the_way_down_has_not_insisted_that_the_wheels_be_let_go() {
    alone(|robot| {
        let run = driving(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        let run = run.signal(Signal::INT);
        witness.await_state(Permission::Braking, StopCause::Paused);
        run.process().signal(Signal::KILL);

        witness.await_state(Permission::Held, StopCause::Paused);
        drop((witness, session));
        assert_eq!(run.wait().code, 128 + 9);
        robot.await_no_process();
    });
}

#[test]
fn a_robot_that_is_taken_down_stands_still_first() {
    alone(|robot| {
        let run = driving(robot).go_on(Duration::from_millis(500));
        let session = Session::join(&robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        witness.await_state(Permission::Armed, StopCause::None);
        run.stop();

        witness.await_state(Permission::Held, StopCause::Paused);
        let last = witness.wheels.last().unwrap().velocity;
        assert!(last.iter().all(|speed| speed.abs() < 4.0), "{last:?}: it drove into the end");
        drop((witness, session));
    });
}

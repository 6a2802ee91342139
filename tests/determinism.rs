//! Same seed, same bytes on every topic, whatever else the machine does.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use interfaces::topics::{MOTION_STATE, SCAN, VELOCITY_COMMAND};
use interfaces::{Stamp, StopCause};
use node::{Clock, Session, clock};
use rustix::process::Signal;

use crate::robot::{Robot, SIMULATION, alone, wait_until};

/// More than there are cores, so that the robot's processes are pushed aside at any moment.
const BURNERS: usize = 3;

/// Whatever happens to the test, the machine is given back after this long.
const BURNING_MAX: Duration = Duration::from_secs(60);

const OUTER: [&str; 4] = ["--until", "round-trip", "--seed", "1"];

#[test]
fn the_same_seed_gives_the_same_bytes_in_every_run() {
    let robot = Robot::new();
    let first = robot.up(&OUTER);
    first.assert_code(0);
    for run in 2..=5 {
        let again = robot.up(&OUTER);
        assert_eq!(again.digest(), first.digest(), "SEED=1, run {run}\n{}", again.story());
        assert_eq!(again.report["topics"], first.report["topics"], "SEED=1, run {run}");
    }
}

#[test]
fn a_busy_machine_changes_no_byte() {
    let robot = Robot::new();
    let quiet = robot.up(&["--for", "20"]);
    while_busy(|| {
        for run in 1..=3 {
            let busy = robot.up(&["--for", "20"]);
            busy.assert_code(0).assert_nothing_lost();
            assert_eq!(busy.digest(), quiet.digest(), "SEED=1, run {run}\n{}", busy.story());
        }
    });
}

#[test]
fn how_processes_wait_changes_no_byte() {
    let robot = Robot::new();
    let yielding = robot.up(&OUTER);
    let blocking = robot.up(&[&OUTER[..], &["--set", "wait=block"]].concat());

    blocking.assert_code(0).assert_nothing_lost();
    assert_eq!(blocking.digest(), yielding.digest(), "SEED=1\n{}", blocking.story());
}

#[test]
fn a_process_that_is_held_up_changes_no_byte() {
    let robot = Robot::new();
    let smooth = robot.up(&["--for", "900"]);
    for node in ["odometry", "controller", "simulator"] {
        let run = robot.start_up(&["--for", "900"]).await_active();
        let process = run.node(node);
        process.signal(Signal::STOP);
        let run = run.go_on(Duration::from_millis(300));
        process.signal(Signal::CONT);

        let halting = run.wait();
        halting.assert_code(0).assert_nothing_lost();
        assert_eq!(halting.digest(), smooth.digest(), "SEED=1, {node}\n{}", halting.story());
    }
}

#[test]
fn the_robot_s_name_changes_no_byte() {
    let robot = Robot::new();
    let burger = robot.up(&["--for", "5"]);
    let waffle = robot.up(&["--for", "5", "--robot", "waffle"]);

    assert_eq!(waffle.report["robot"], "waffle");
    assert_eq!(waffle.digest(), burger.digest(), "{}", waffle.story());
}

#[test]
fn another_seed_gives_other_noise_and_another_digest() {
    let robot = Robot::new();
    let digest = |seed: &str| {
        let noise = ["--set", "simulator.lidar.noise=gazebo", "--for", "5", "--seed", seed];
        let ended = robot.up(&noise);
        ended.assert_code(0);
        ended.digest().to_owned()
    };
    let digests: Vec<_> = ["1", "2", "3"].map(digest).into();

    assert_eq!(digest("1"), digests[0], "SEED=1 again");
    assert_ne!(digests[0], digests[1], "SEED=1 and 2");
    assert_ne!(digests[1], digests[2], "SEED=2 and 3");
    assert_ne!(digests[0], digests[2], "SEED=1 and 3");
}

#[test]
fn lock_step_runs_faster_than_real_time() {
    let robot = Robot::new();
    let ended = robot.up(&OUTER);

    let factor = ended.report["real_time_factor"].as_f64().unwrap();
    assert!(1.0 < factor, "{factor} x real time\n{}", ended.story());
}

/// Runs `body` while other threads want all of the machine.
fn while_busy(body: impl FnOnce()) {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Also where `body` panics: the scope waits for the burners.
        let _end = EndOnDrop(&is_over);
        for _ in 0..BURNERS {
            scope.spawn(|| burn(&is_over));
        }
        body();
    });
}

fn burn(is_over: &AtomicBool) {
    let begun = clock::now();
    while !is_over.load(Ordering::Relaxed) && clock::now().since(begun) < BURNING_MAX {
        std::hint::spin_loop();
    }
}

struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

// Broken on purpose: where the end of a step was told in the turn after its scan, this saw it come late.
#[test]
fn what_the_wheels_tell_comes_before_the_scan_that_is_answered_with_it() {
    alone(|robot| {
        let controller = "[[process]]\nname = \"controller\"\n\
                          parameters_file = \"controller/lab_simulation.toml\"\n";
        let launch_file = robot.launch_file_from(SIMULATION, &[(controller, "")]);
        let run = robot.start_up(&[&launch_file]);
        let run = run.await_count("simulator    inactive -> active", 1);
        let session = Session::join(&robot.namespace(), "controller", 1).unwrap();
        let session = session.with_clock(Clock::Lockstep);
        let mut scans = session.subscriber(&SCAN).unwrap();
        let mut states = session.subscriber(&MOTION_STATE).unwrap();
        let mut commands = session.publisher(&VELOCITY_COMMAND).unwrap();

        // Who joins late is told how things stand when the simulator next looks around.
        assert!(wait_until(Duration::from_secs(5), || states.receive().unwrap().is_some()));
        let mut stamp = Stamp::from_nanoseconds(50_000_000);
        let mut causes = Vec::new();
        // Armed, driven, and then commanded by nobody who can be obeyed.
        for (linear, steps) in [(0.0, 15), (0.1, 5), (f64::NAN, 12), (0.0, 15)] {
            for _ in 0..steps {
                commands
                    .send_with(|command| {
                        command.header.stamp = stamp;
                        command.linear = linear;
                    })
                    .unwrap();
                let mut scan = None;
                assert!(wait_until(Duration::from_secs(5), || {
                    scan = scans.receive().unwrap().map(|scan| scan.header.stamp);
                    scan.is_some()
                }));
                stamp = scan.unwrap();
                while let Some(state) = states.receive().unwrap() {
                    causes.push(state.cause);
                }
                // Longer than the simulator waits for anything.
                clock::nap(Duration::from_millis(60));
                let late = states.receive().unwrap().map(|state| *state);
                assert!(late.is_none(), "{late:?} was told after the scan of {stamp:?}");
            }
        }
        assert!(causes.contains(&(StopCause::Silence as u8)), "{causes:?}: never tripped");
        drop((scans, states, commands));
        run.stop();
    });
}

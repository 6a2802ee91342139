//! One suite, two robots: the simulated one, and the bridge facing an emulated TurtleBot3.

use std::time::Duration;

use interfaces::topics::{SCAN, VELOCITY_COMMAND};
use interfaces::{Header, JointState, LaserScan, Permission, Stamp, StopCause, VelocityCommand};
use node::{Publisher, Session, Subscriber, clock};
use rustix::process::Signal;

use crate::emulated::{Emulated, TURTLEBOT3};
use crate::robot::{Robot, Run, alone_in, wait_until};
use crate::witness::{WHEEL_RADIUS, Witness};

/// The same robot, simulated.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// Between two commands.
const PERIOD: Duration = Duration::from_millis(50);

/// The dead-man's default.
const DEAD_MAN: Duration = Duration::from_millis(500);

/// One thing that a robot does, or does not.
type Test = fn(&mut Stand<'_>);

/// What is asked of both robots.
const SUITE: [(&str, Test); 6] = [
    ("measures as its topics promise", measures_as_its_topics_promise),
    ("turns the way it is told", turns_the_way_it_is_told),
    ("stops when commands cease", stops_when_commands_cease),
    ("refuses bad commands", refuses_bad_commands),
    ("is armed by a stream that begins with zero", is_armed_by_a_stream),
    ("stands before it is let go", stands_before_it_is_let_go),
];

#[test]
fn the_simulator_is_a_robot() {
    alone_in("conformance::the_simulator_is_a_robot", |robot| {
        let last = LAB_ROBOT.rfind("[[process]]\nname = \"controller\"").unwrap();
        let launch_file = robot.launch_file_from(
            LAB_ROBOT,
            &[
                (&LAB_ROBOT[last..], ""),
                ("watchdog_ms = 500\n", ""),
                ("start = \"outer\"", "start = \"outer\"\nstop_at_collision = false"),
            ],
        );
        Stand::new(robot, &launch_file, "simulator").examine();
    });
}

#[test]
fn the_bridge_before_an_lds_02_is_a_robot() {
    alone_in("conformance::the_bridge_before_an_lds_02_is_a_robot", |robot| {
        bridge(robot, "lds-02");
    });
}

#[test]
fn the_bridge_before_an_lds_01_is_a_robot() {
    alone_in("conformance::the_bridge_before_an_lds_01_is_a_robot", |robot| {
        bridge(robot, "lds-01");
    });
}

fn bridge(robot: &Robot, lidar: &str) {
    let emulated = Emulated::start(robot, &["--lidar", lidar]);
    let last = TURTLEBOT3.rfind("[[process]]\nname = \"controller\"").unwrap();
    let changes = [(&TURTLEBOT3[last..], ""), ("watchdog_ms = 500\n", "")];
    let launch_file = emulated.launch_file(robot, &changes);
    Stand::new(robot, &launch_file, "turtlebot3").examine();
    emulated.stop();
}

/// A robot without a mind of its own, commanded and looked at from beside it.
struct Stand<'a> {
    run: Option<Run<'a>>,
    driver: &'a str,
    witness: Witness,
    scans: Subscriber<LaserScan>,
    commands: Publisher<VelocityCommand>,
    scan: Option<LaserScan>,
}

impl<'a> Stand<'a> {
    fn new(robot: &'a Robot, launch_file: &str, driver: &'a str) -> Self {
        // The longest there is: the stand is a busy machine's process and no robot's.
        let dead_man = format!("--set={driver}.deadman.timeout_ms={}", DEAD_MAN.as_millis());
        let run = robot.start_up(&[launch_file, &dead_man]).await_count("READY", 1);
        let session = Session::join(&robot.namespace(), "stand", 1).unwrap();
        Self {
            run: Some(run),
            driver,
            witness: Witness::new(&session),
            scans: session.subscriber(&SCAN).unwrap(),
            commands: session.publisher(&VELOCITY_COMMAND).unwrap(),
            scan: None,
        }
    }

    fn examine(mut self) {
        for (what, test) in SUITE {
            println!("| {} | {what} |", self.driver);
            test(&mut self);
        }
        assert!(self.run.is_none(), "the last one lets it go");
    }

    fn send(&mut self, stamp: Stamp, linear: f64, angular: f64) {
        let header = Header { stamp, ..Header::default() };
        self.commands.send(VelocityCommand { header, linear, angular }).unwrap();
    }

    /// Commands so for this long.
    fn command(&mut self, linear: f64, angular: f64, duration: Duration) {
        let until = clock::now().after(duration);
        while clock::now() < until {
            self.send(clock::now(), linear, angular);
            self.witness.watch_for(PERIOD);
            self.look();
        }
    }

    /// Commands zero until the robot is armed.
    fn arm(&mut self) {
        let armed = wait_until(Duration::from_secs(20), || {
            self.send(clock::now(), 0.0, 0.0);
            self.witness.watch_for(PERIOD);
            self.permission() == Some((Permission::Armed as u8, StopCause::None as u8))
        });
        assert!(armed, "{:?}", self.witness.told.last());
        self.witness.forget();
    }

    fn permission(&self) -> Option<(u8, u8)> {
        self.witness.told.last().map(|state| (state.permission, state.cause))
    }

    fn look(&mut self) {
        while let Some(scan) = self.scans.receive().unwrap() {
            self.scan = Some(*scan);
        }
    }

    fn wheels(&self) -> &JointState {
        self.witness.wheels.last().unwrap()
    }

    /// [m, m] How far each wheel has rolled since this sample.
    fn rolled(&self, before: &JointState) -> [f64; 2] {
        [0, 1].map(|wheel| WHEEL_RADIUS * (self.wheels().position[wheel] - before.position[wheel]))
    }

    fn await_stand(&mut self) -> Stamp {
        let stands = |witness: &Witness| {
            witness
                .wheels
                .last()
                .is_some_and(|wheels| wheels.velocity.iter().all(|v| v.abs() < 1e-3))
        };
        assert!(self.witness.watch_until(stands), "{:?}", self.wheels());
        self.wheels().header.stamp
    }
}

fn measures_as_its_topics_promise(stand: &mut Stand) {
    stand.arm();
    let begun = clock::now();
    let from = stand.witness.wheels.len();
    stand.command(0.0, 0.0, Duration::from_secs(2));
    let wheels = &stand.witness.wheels[from..];
    // 20 Hz at the least, and fewer where the machine is busy.
    assert!(20 <= wheels.len(), "{} measurements", wheels.len());
    for pair in wheels.windows(2) {
        let gone = pair[1].header.stamp.since(pair[0].header.stamp);
        assert!(Duration::ZERO < gone, "{gone:?}");
        assert!(pair[0].header.sequence < pair[1].header.sequence);
    }
    let scan = stand.scan.expect("no scan came");
    assert!(
        begun < scan.header.stamp && scan.header.stamp <= clock::now(),
        "a stamp of its own time"
    );
    let beams = scan.len();
    assert!((230..=360).contains(&beams), "{beams} beams");
    let turn = scan.angle_increment * beams as f32;
    assert!((turn - std::f32::consts::TAU).abs() < 1e-3 && scan.angle_min == 0.0, "{turn} rad");
    // The outer corridor's start: 2.2 m ahead of the axle, 0.2 m to the walls at its sides and behind;
    // the sensor is 32 mm behind the axle.
    for (quarter, expected) in [(0, 2.232), (1, 0.198), (2, 0.168), (3, 0.2)] {
        let range = f64::from(scan.ranges()[quarter * beams / 4]);
        assert!((range - expected).abs() < 0.02, "quarter {quarter}: {range} m, not {expected}");
    }
    let valid = scan.ranges().iter().filter(|range| range.is_finite()).count();
    assert!(beams * 3 / 4 < valid, "{valid} of {beams} ranges");
    assert!(
        scan.ranges()
            .iter()
            .all(|range| range.is_nan() || scan.range_min <= *range || *range == f32::NEG_INFINITY)
    );
}

fn turns_the_way_it_is_told(stand: &mut Stand) {
    stand.arm();
    let before = *stand.wheels();
    stand.command(0.0, 0.5, Duration::from_secs(1));
    let [left, right] = stand.rolled(&before);
    assert!(
        left < -0.01 && 0.01 < right,
        "counterclockwise: {left} {right}, {:?}",
        stand.witness.told.last()
    );
    stand.command(0.0, -0.5, Duration::from_secs(1));
    stand.command(0.0, 0.0, Duration::from_millis(300));
    let before = *stand.wheels();
    stand.command(0.1, 0.0, Duration::from_secs(1));
    let [left, right] = stand.rolled(&before);
    assert!((0.05..0.15).contains(&left) && (left - right).abs() < 2e-3, "{left} {right}");
    let speed = stand.wheels().velocity.map(|speed| speed * WHEEL_RADIUS);
    assert!(speed.iter().all(|speed| (speed - 0.1).abs() < 6e-3), "{speed:?} m/s at the rim");
    stand.command(-0.1, 0.0, Duration::from_secs(1));
}

fn stops_when_commands_cease(stand: &mut Stand) {
    stand.arm();
    stand.command(0.1, 0.0, Duration::from_millis(500));
    let braking = stand.witness.await_state(Permission::Braking, StopCause::Silence);
    let silent = braking.header.stamp.since(braking.command_received);
    assert!(DEAD_MAN <= silent, "{silent:?}");
    stand.witness.await_state(Permission::Held, StopCause::Silence);
    let ceased = braking.command_received;
    let stood = stand.await_stand();
    println!(
        "| {} | the wheels were seen standing {} ms after the last command |",
        stand.driver,
        stood.since(ceased).as_millis()
    );
}

fn refuses_bad_commands(stand: &mut Stand) {
    stand.arm();
    let before = stand.witness.told.last().copied().unwrap();
    let old = clock::now().before(Duration::from_secs(5));
    let ahead = clock::now().after(Duration::from_secs(5));
    for (linear, angular) in [(f64::NAN, 0.0), (0.1, f64::INFINITY), (0.23, 0.0), (0.0, -2.9)] {
        stand.send(clock::now(), linear, angular);
    }
    stand.send(old, 0.1, 0.0);
    stand.send(ahead, 0.1, 0.0);
    // None of them is a sign of life.
    let held = stand.witness.await_state(Permission::Held, StopCause::Silence);
    let refused: u64 = held.rejected.iter().sum::<u64>() - before.rejected.iter().sum::<u64>();
    assert_eq!(refused, 6, "{held:?}");
    assert!(stand.wheels().velocity.iter().all(|speed| speed.abs() < 1e-3));
}

fn is_armed_by_a_stream(stand: &mut Stand) {
    stand.command(0.1, 0.0, Duration::from_secs(1));
    let held = (Permission::Held as u8, StopCause::Silence as u8);
    assert_eq!(stand.permission(), Some(held), "a stream that begins with a speed moves nobody");
    stand.witness.watch_for(2 * DEAD_MAN);
    stand.arm();
}

fn stands_before_it_is_let_go(stand: &mut Stand) {
    stand.command(0.1, 0.0, Duration::from_millis(500));
    let run = stand.run.take().unwrap().signal(Signal::INT);
    stand.command(0.1, 0.0, Duration::from_millis(500));
    stand.witness.await_state(Permission::Held, StopCause::Paused);
    let last = stand.wheels().velocity;
    // Slower than it was driven, by the last measurement that was heard of: 0.1 m/s are 3.03 rad/s.
    assert!(last.iter().all(|speed| speed.abs() < 2.9), "{last:?}: it drove into the end");
    let ended = run.wait();
    ended.assert_code(0);
    assert!(ended.figure(stand.driver, "scan_to_command_p50_us").is_finite());
}

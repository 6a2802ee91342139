//! What the dead-man is held to.

#![expect(clippy::float_cmp, reason = "what is passed on is passed on as it is")]

use interfaces::Header;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;

const PERIOD_MS: u64 = 50;

fn at(ms: u64) -> Stamp {
    Stamp::from_nanoseconds(ms * 1_000_000)
}

fn command(ms: u64, sequence: u64, linear: f64) -> VelocityCommand {
    let header = Header { stamp: at(ms), sequence, epoch: 1, reserved: 0 };
    VelocityCommand { header, linear, angular: 0.0 }
}

/// A robot and the commands that it is sent.
struct Drive {
    dead_man: DeadMan,
    ms: u64,
    sequence: u64,
}

impl Drive {
    fn new() -> Self {
        Self { dead_man: DeadMan::new(&Config::default()), ms: 1_000, sequence: 0 }
    }

    /// One valid command each period, for so long.
    fn send(&mut self, linear: f64, ms: u64) {
        for _ in 0..ms / PERIOD_MS {
            self.ms += PERIOD_MS;
            self.sequence += 1;
            let command = command(self.ms, self.sequence, linear);
            assert_eq!(self.dead_man.hear(at(self.ms), &command), Ok(()));
        }
    }

    /// Nothing, for so long.
    fn wait(&mut self, ms: u64) {
        for _ in 0..ms {
            self.ms += 1;
            self.dead_man.motion(at(self.ms));
        }
    }

    /// Drives, is left alone until it stands, and hears a healthy stream again.
    fn trip_and_recover(&mut self) {
        self.send(0.1, 500);
        self.wait(1_000);
        self.send(0.0, 600);
        self.send(0.1, 100);
    }

    fn speed(&mut self) -> f64 {
        self.dead_man.motion(at(self.ms)).linear
    }

    fn state(&self) -> MotionState {
        let mut state = MotionState::default();
        self.dead_man.describe(at(self.ms), &mut state);
        state
    }

    fn is_held_for(&self, cause: StopCause) -> bool {
        let state = self.state();
        state.permission == Permission::Held as u8 && state.cause == cause as u8
    }
}

// Broken on purpose: without the drive's part in it, the robot was armed while nobody reached it.
#[test]
fn wheels_that_cannot_be_reached_stop_the_robot_and_wait_for_a_stream_of_commands() {
    let mut drive = Drive::new();
    drive.send(0.1, 500);
    assert!(drive.dead_man.is_fed(at(drive.ms)));
    drive.dead_man.set_drive(at(drive.ms), false);
    assert!(!drive.dead_man.is_fed(at(drive.ms)));
    drive.send(0.0, 2_000);
    assert!(drive.is_held_for(StopCause::DriveLost));

    drive.dead_man.set_drive(at(drive.ms), true);
    drive.send(0.0, 450);
    assert!(drive.is_held_for(StopCause::DriveLost));
    drive.send(0.0, 150);
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
    assert_eq!(drive.state().trips, 0, "it was not silence");

    // Nor is one who drives on without a break moved the moment the wheels are back.
    drive.dead_man.set_drive(at(drive.ms), false);
    drive.wait(150);
    drive.dead_man.set_drive(at(drive.ms), true);
    drive.send(0.1, 2_000);
    assert_eq!(drive.speed(), 0.0);
}

#[test]
fn a_robot_whose_wheels_come_and_go_waits_for_a_person() {
    let mut drive = Drive::new();
    for loss in 1..=4 {
        drive.send(0.1, 200);
        drive.dead_man.set_drive(at(drive.ms), false);
        drive.dead_man.set_drive(at(drive.ms), true);
        assert_eq!(drive.state().needs_person, u8::from(loss == 4), "{loss}");
        drive.send(0.0, 800);
    }
    assert!(drive.is_held_for(StopCause::DriveLost));
    drive.dead_man.arm(at(drive.ms));
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
}

#[test]
fn a_valid_command_is_followed() {
    let mut drive = Drive::new();
    drive.send(0.1, 1_000);

    assert_eq!(drive.speed(), 0.1);
    assert_eq!(drive.state().permission, Permission::Armed as u8);
}

#[test]
fn where_commands_cease_the_robot_brakes_after_the_time_out_and_then_stands() {
    let mut drive = Drive::new();
    drive.send(0.2, 1_000);
    let mut speeds = Vec::new();
    for _ in 0..450 {
        drive.wait(1);
        speeds.push(drive.speed());
    }

    assert!(speeds[..200].iter().all(|&speed| speed == 0.2), "it stops before the time-out");
    assert!(speeds[205] < 0.2, "it does not stop: {}", speeds[205]);
    // At 1 m/s^2.
    assert!((speeds[300] - 0.1).abs() < 0.002, "{}", speeds[300]);
    assert!(speeds.windows(2).all(|pair| pair[0] - pair[1] < 0.001_001), "it brakes too hard");
    assert_eq!(speeds[405..], [0.0; 45]);
    assert!(drive.is_held_for(StopCause::Silence));
    assert_eq!(drive.state().trips, 1);
}

#[test]
fn braking_keeps_the_curvature_of_the_path() {
    let mut dead_man = DeadMan::new(&Config::default());
    let turning = VelocityCommand { angular: 2.0, ..command(0, 1, 0.1) };
    dead_man.hear(at(0), &turning).unwrap();
    dead_man.motion(at(201));
    for ms in 202..=360 {
        let motion = dead_man.motion(at(ms));
        assert!((motion.angular - 20.0 * motion.linear).abs() < 1e-12, "at {ms} ms: {motion:?}");
    }
    assert!(dead_man.motion(at(200 + 170)).is_zero(), "12 rad/s^2 take 167 ms");
}

#[test]
fn what_is_not_valid_is_refused_with_its_reason_and_is_no_sign_of_life() {
    let valid = command(1_000, 5, 0.1);
    let with_header = |header: Header| VelocityCommand { header, ..valid };
    let newer = Header { sequence: 6, ..valid.header };
    let table = [
        (Rejection::OldEpoch, with_header(Header { epoch: 0, ..newer })),
        (Rejection::NotNewer, valid),
        (Rejection::NotNewer, with_header(Header { sequence: 4, ..valid.header })),
        (Rejection::NotFinite, VelocityCommand { header: newer, linear: f64::NAN, angular: 0.0 }),
        (
            Rejection::NotFinite,
            VelocityCommand { header: newer, linear: 0.0, angular: f64::NEG_INFINITY },
        ),
        (Rejection::BeyondLimits, VelocityCommand { header: newer, linear: 0.221, angular: 0.0 }),
        (Rejection::BeyondLimits, VelocityCommand { header: newer, linear: 0.0, angular: -2.85 }),
        (Rejection::BeyondLimits, VelocityCommand { header: newer, linear: 1e300, angular: 0.0 }),
        (Rejection::StampTooOld, with_header(Header { stamp: at(400), ..newer })),
        (Rejection::StampAhead, with_header(Header { stamp: at(3_601_000), ..newer })),
        (Rejection::StampTooOld, with_header(Header { stamp: Stamp::ZERO, ..newer })),
    ];
    for (reason, bad) in table {
        let mut dead_man = DeadMan::new(&Config::default());
        dead_man.hear(at(1_000), &valid).unwrap();
        for ms in (1_000..1_200).step_by(10) {
            assert_eq!(dead_man.hear(at(ms), &bad), Err(reason), "{bad:?}");
            assert_eq!(dead_man.motion(at(ms)).linear, 0.1, "{bad:?}");
        }
        assert_eq!(dead_man.rejected(reason), 20);
        dead_man.motion(at(1_201));
        assert!(dead_man.motion(at(1_302)).is_zero(), "{reason:?} keeps the robot driving");
    }
}

#[test]
fn a_new_life_of_the_publisher_counts_from_the_beginning_and_the_old_one_is_heard_no_more() {
    let mut dead_man = DeadMan::new(&Config::default());
    dead_man.hear(at(0), &command(0, 900, 0.1)).unwrap();
    let header = Header { stamp: at(10), sequence: 0, epoch: 2, reserved: 0 };
    dead_man.hear(at(10), &VelocityCommand { header, linear: 0.05, angular: 0.0 }).unwrap();

    assert_eq!(dead_man.hear(at(20), &command(20, 901, 0.2)), Err(Rejection::OldEpoch));
    assert_eq!(dead_man.motion(at(20)).linear, 0.05);
}

#[test]
fn a_trip_latches_until_a_stream_that_begins_with_zero_has_come_for_long_enough() {
    let mut drive = Drive::new();
    drive.send(0.1, 500);
    drive.wait(1_000);
    drive.send(0.1, 2_000);
    assert!(drive.is_held_for(StopCause::Silence), "it moves on with a jerk");

    drive.send(0.0, 450);
    assert!(drive.is_held_for(StopCause::Silence), "it moves on too soon");
    drive.send(0.0, 100);
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
    assert_eq!(drive.state().cause, StopCause::None as u8);
}

#[test]
fn a_stream_with_a_gap_begins_anew() {
    let mut drive = Drive::new();
    drive.send(0.1, 500);
    drive.wait(1_000);
    drive.send(0.0, 400);
    drive.wait(250);
    drive.send(0.0, 400);
    assert!(drive.is_held_for(StopCause::Silence));

    drive.send(0.0, 150);
    assert_eq!(drive.state().permission, Permission::Armed as u8);
}

#[test]
fn it_is_armed_by_itself_three_times_in_a_minute_and_then_by_a_person() {
    let mut drive = Drive::new();
    for _ in 0..3 {
        drive.trip_and_recover();
        assert_eq!(drive.speed(), 0.1);
    }
    drive.trip_and_recover();
    assert!(drive.is_held_for(StopCause::Silence));
    assert_eq!(drive.state().needs_person, 1);
    // Not even an hour later.
    drive.send(0.0, 3_600_000);
    assert!(drive.is_held_for(StopCause::Silence));

    drive.dead_man.arm(at(drive.ms));
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
    drive.trip_and_recover();
    assert_eq!(drive.speed(), 0.1, "a person's word wipes the slate clean");
}

#[test]
fn who_trips_seldom_needs_nobody() {
    let mut drive = Drive::new();
    for _ in 0..10 {
        drive.trip_and_recover();
        drive.send(0.1, 25_000);
        assert_eq!(drive.speed(), 0.1);
    }
}

#[test]
fn an_emergency_stop_holds_the_robot_whatever_comes_until_it_is_released() {
    let mut drive = Drive::new();
    drive.send(0.22, 500);
    drive.dead_man.set_emergency_stop(at(drive.ms), true);
    drive.wait(46);
    assert_eq!(drive.speed(), 0.0, "it does not stop within 46 ms");
    drive.send(0.0, 1_000);
    drive.dead_man.arm(at(drive.ms));
    drive.send(0.0, 1_000);
    assert!(drive.is_held_for(StopCause::EmergencyStop));

    drive.dead_man.set_emergency_stop(at(drive.ms), false);
    drive.send(0.0, 400);
    assert!(drive.is_held_for(StopCause::EmergencyStop), "what came before the release counts");
    drive.send(0.0, 150);
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
}

#[test]
fn an_emergency_stop_does_not_hide_a_trip_that_was_due_before() {
    let mut drive = Drive::new();
    for _ in 0..3 {
        drive.trip_and_recover();
    }
    drive.send(0.1, 500);
    // Nobody has looked since the last command, as where the wheels' process stood still.
    drive.ms += 300;
    drive.dead_man.set_emergency_stop(at(drive.ms), true);
    drive.dead_man.set_emergency_stop(at(drive.ms), false);
    drive.send(0.0, 1_000);
    assert!(drive.is_held_for(StopCause::EmergencyStop), "the fourth trip needs a person");
    let state = drive.state();
    assert_eq!((state.needs_person, state.trips), (1, 4));
}

#[test]
fn without_a_supervisor_the_robot_stops_at_once_and_for_good() {
    let mut drive = Drive::new();
    drive.send(0.22, 500);
    drive.dead_man.lose_supervisor(at(drive.ms));
    drive.wait(46);
    assert_eq!(drive.speed(), 0.0);
    drive.dead_man.set_emergency_stop(at(drive.ms), true);
    drive.dead_man.set_emergency_stop(at(drive.ms), false);
    drive.dead_man.arm(at(drive.ms));
    drive.send(0.0, 2_000);
    drive.send(0.1, 2_000);
    assert!(drive.is_held_for(StopCause::SupervisorLost));
}

#[test]
fn a_robot_that_does_not_start_armed_waits_for_a_person() {
    let config = Config { start_armed: false, ..Config::default() };
    let mut drive = Drive { dead_man: DeadMan::new(&config), ..Drive::new() };
    drive.send(0.0, 1_000);
    assert!(drive.is_held_for(StopCause::NotArmed));
    drive.dead_man.arm(at(drive.ms));
    drive.send(0.1, 50);
    assert_eq!(drive.speed(), 0.1);
}

#[test]
fn every_change_is_told_once() {
    let mut drive = Drive::new();
    let mut told = vec![drive.dead_man.changes()];
    let mut look = |drive: &Drive| {
        told.push(drive.dead_man.changes());
        told[told.len() - 1] - told[told.len() - 2]
    };
    drive.send(0.1, 500);
    assert_eq!(look(&drive), 0, "commands alone change nothing");
    drive.wait(201);
    assert_eq!(look(&drive), 1, "it brakes");
    drive.wait(500);
    assert_eq!(look(&drive), 1, "it stands");
    drive.send(0.0, 600);
    assert_eq!(look(&drive), 1, "it is armed");
}

/// [-] Events of the fuzz: a million in `FUZZ=1000000 cargo test --release -p node deadman`.
const FUZZ: u64 = 100_000;

/// Whatever comes whenever: never faster than the limits, never moving longer than the time-out and
/// the way to rest after the last valid command. (Shown to fail where a refused command is taken for
/// a sign of life, and where limits or finiteness are not looked at.)
#[test]
fn no_command_breaks_the_rules() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let config = Config::default();
    let mut dead_man = DeadMan::new(&config);
    let (mut ms, mut heard, mut valid, mut refused) = (2_000, 0, 0, 0);
    let events = std::env::var("FUZZ").map_or(FUZZ, |text| text.parse().unwrap());
    for event in 0..events {
        if random.next_u32().is_multiple_of(64) {
            dead_man = DeadMan::new(&config);
        }
        let wait = if random.next_u32().is_multiple_of(16) { random.next_u64() % 900 } else { 7 };
        for _ in 0..=wait / 7 {
            ms += 7;
            let motion = dead_man.motion(at(ms));
            assert!(motion.linear.abs() <= config.linear_max(), "event {event}: {motion:?}");
            assert!(motion.angular.abs() <= config.angular_max(), "event {event}: {motion:?}");
            let silent = ms - heard;
            assert!(silent < 200 + 7 + 240 || motion.is_zero(), "event {event}: {silent} ms");
        }
        match random.next_u32() % 100 {
            0 => dead_man.set_emergency_stop(at(ms), true),
            1..4 => dead_man.set_emergency_stop(at(ms), false),
            4 => dead_man.arm(at(ms)),
            _ => {
                let command = any_command(&mut random, ms);
                if dead_man.hear(at(ms), &command).is_ok() {
                    heard = ms;
                    valid += 1;
                } else {
                    refused += 1;
                }
            }
        }
    }
    println!("{events} events: {valid} valid commands followed, {refused} refused");
    assert!(events / 4 < valid, "hardly anything was valid: {valid}");
}

/// Mostly right in each of its parts, so that every check is the only one to refuse some.
fn any_command(random: &mut ChaCha8Rng, ms: u64) -> VelocityCommand {
    let mut rarely = || random.next_u32().is_multiple_of(8);
    let [is_zero, wild_linear, wild_angular, wild_stamp, wild_header] =
        std::array::from_fn(|_| rarely());
    let mut speed = |is_wild: bool, max: f64| {
        if is_wild {
            f64::from_bits(random.next_u64())
        } else {
            max * (f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0)
        }
    };
    let (linear, angular) = (speed(wild_linear, 0.22), speed(wild_angular, 2.84));
    // Or a robot that has tripped once would never move again.
    let (linear, angular) = if is_zero { (0.0, 0.0) } else { (linear, angular) };
    let stamp = if wild_stamp { Stamp::from_nanoseconds(random.next_u64()) } else { at(ms) };
    let sequence = if wild_header { random.next_u64() % ms } else { ms };
    let header = Header { stamp, sequence, epoch: 1, reserved: 0 };
    VelocityCommand { header, linear, angular }
}

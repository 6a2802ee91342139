//! Whatever bytes arrive, odometry is that of a robot that can be.

use interfaces::{Header, JointState, Odometry, Pose, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::{Config, PoseOdometry, Rejected, WheelOdometry};

/// [-] Measurements of each kind; `FUZZ_SAMPLES=10000000` makes it as many.
const SAMPLES: u64 = 1_000_000;

/// [-] Measurements of one stream: then another robot begins.
const STREAM: u64 = 500;

/// [ns] An hour.
const HOUR: u64 = 3_600_000_000_000;

/// [ns] Between two measurements.
const PERIOD: u64 = 50_000_000;

/// [m/s] Of a Burger whose wheels turn as fast as the default lets them, and a little for rounding.
const SPEED_MAX: f64 = 0.991;

/// [rad/s] Likewise.
const ANGULAR_MAX: f64 = 12.4;

const STRANGE: [f64; 12] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    1e300,
    -1e12,
    1e-310,
    -1e-310,
    0.0,
    -0.0,
    1e4,
];

fn samples() -> u64 {
    std::env::var("FUZZ_SAMPLES").map_or(SAMPLES, |text| text.parse().unwrap())
}

#[track_caller]
fn assert_of_a_robot(odometry: &Odometry, seed: u64) {
    let Odometry { x, y, yaw, linear, angular, .. } = *odometry;
    assert!(x.abs() <= 1e6 && y.abs() <= 1e6, "SEED={seed}: x {x} m, y {y} m");
    assert!(yaw.abs() <= 6.3, "SEED={seed}: {yaw} rad");
    assert!(linear.abs() <= SPEED_MAX, "SEED={seed}: {linear} m/s");
    assert!(angular.abs() <= ANGULAR_MAX, "SEED={seed}: {angular} rad/s");
}

/// Else nothing is tested.
#[track_caller]
fn assert_both(what: &str, taken: u64, rejected: &[u64]) {
    println!("{what}: {taken} taken, {} refused", rejected.iter().sum::<u64>());
    assert!(samples() / 10 < taken, "{taken} taken");
    for (reason, &count) in Rejected::ALL.iter().zip(rejected) {
        assert!(samples() / 1_000 < count, "{reason:?}: {count}");
    }
}

#[test]
fn whatever_bytes_the_wheels_send_odometry_is_finite_and_within_the_limits() {
    let (mut taken, mut rejected) = (0, [0; Rejected::ALL.len()]);
    for seed in 0..samples().div_ceil(STREAM) {
        let mut source = Source::new(seed);
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for _ in 0..STREAM {
            let before = odometry;
            match core.update(&source.wheels(), &mut odometry) {
                Ok(()) => {
                    taken += 1;
                    assert_of_a_robot(&odometry, seed);
                    let way = libm::hypot(odometry.x - before.x, odometry.y - before.y);
                    assert!(way <= SPEED_MAX, "SEED={seed}: {way} m at once");
                }
                Err(reason) => {
                    rejected[reason as usize] += 1;
                    assert_eq!(odometry, before, "SEED={seed}");
                }
            }
        }
    }
    assert_both("wheels", taken, &rejected);
}

#[test]
fn whatever_bytes_a_pose_is_odometry_is_finite_and_within_the_limits() {
    let (mut taken, mut rejected) = (0, [0; Rejected::ALL.len()]);
    for seed in 0..samples().div_ceil(STREAM) {
        let mut source = Source::new(seed);
        let mut core = PoseOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for _ in 0..STREAM {
            let before = odometry;
            match core.update(&source.pose(), &mut odometry) {
                Ok(_) => {
                    taken += 1;
                    assert_of_a_robot(&odometry, seed);
                }
                Err(reason) => {
                    rejected[reason as usize] += 1;
                    assert_eq!(odometry, before, "SEED={seed}");
                }
            }
        }
    }
    assert_both("poses", taken, &rejected);
}

#[test]
fn wheels_are_believed_at_the_second_sane_sample_after_whatever_it_was() {
    for seed in 0..samples().div_ceil(STREAM) {
        let mut source = Source::new(seed);
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for _ in 0..=seed % 50 {
            core.update(&source.wheels(), &mut odometry).ok();
        }
        let taken = [(); 3].map(|()| core.update(&source.sane_wheels(), &mut odometry));
        assert_eq!(taken[1..], [Ok(()), Ok(())], "SEED={seed}: {taken:?}");
    }
}

/// A robot that drives in circles, whose reports are sound, strange here and there, or arbitrary
/// bytes.
struct Source {
    random: ChaCha8Rng,
    /// [ns] By a clock that runs.
    now: u64,
    /// [ns] Of the report before.
    reported: u64,
    /// [rad] Of the wheels.
    angles: [f64; 2],
}

impl Source {
    fn new(seed: u64) -> Self {
        let now = 10 * HOUR;
        Self { random: ChaCha8Rng::seed_from_u64(seed), now, reported: now, angles: [0.0; 2] }
    }

    fn one_in(&mut self, number: u32) -> bool {
        self.random.next_u32().is_multiple_of(number)
    }

    fn strange(&mut self) -> f64 {
        let drawn = self.random.next_u32();
        if drawn.is_multiple_of(2) {
            f64::from_bits(self.random.next_u64())
        } else {
            STRANGE[drawn as usize / 2 % STRANGE.len()]
        }
    }

    /// Mostly the newest moment in the first life, or one that no clock shows.
    fn header(&mut self) -> Header {
        self.now += PERIOD;
        let now = self.now;
        let stamp = match self.random.next_u32() % 60 {
            0 => now + HOUR,
            1 => now - HOUR,
            2 => self.reported - 1,
            3 => 0,
            4 => u64::MAX,
            5 => self.random.next_u64(),
            6 => self.reported,
            7 => self.reported.saturating_add(1),
            _ => now,
        };
        self.reported = stamp.max(1);
        let epoch = 1 + u32::from(self.one_in(50));
        Header { stamp: Stamp::from_nanoseconds(stamp), epoch, ..Header::default() }
    }

    fn sane_wheels(&mut self) -> JointState {
        self.now += PERIOD;
        self.angles = [self.angles[0] + 0.2, self.angles[1] + 0.25];
        let stamp = Stamp::from_nanoseconds(self.now);
        JointState {
            header: Header { stamp, epoch: 1, ..Header::default() },
            position: self.angles,
            increment: [0.2, 0.25],
            velocity: [4.0, 5.0],
        }
    }

    fn wheels(&mut self) -> JointState {
        let mut wheels = self.sane_wheels();
        wheels.header = self.header();
        let wheel = self.random.next_u32() as usize % 2;
        match self.random.next_u32() % 20 {
            0 => self.random.fill_bytes(bytemuck::bytes_of_mut(&mut wheels)),
            1 => wheels.position[wheel] = self.strange(),
            2 => wheels.increment[wheel] = self.strange(),
            3 => wheels.velocity[wheel] = self.strange(),
            4 => self.angles[wheel] += 500.0,
            _ => {}
        }
        wheels
    }

    fn pose(&mut self) -> Pose {
        let header = self.header();
        let yaw = 1e-10 * (self.now % 30_000_000_000) as f64;
        let (x, y) = (0.1 * libm::sin(yaw), 0.1 - 0.1 * libm::cos(yaw));
        let mut pose = Pose { header, x, y, yaw, ..Pose::default() };
        match self.random.next_u32() % 20 {
            0 => self.random.fill_bytes(bytemuck::bytes_of_mut(&mut pose)),
            1 => pose.x = self.strange(),
            2 => pose.y = self.strange(),
            3 => pose.yaw = self.strange(),
            _ => {}
        }
        pose
    }
}

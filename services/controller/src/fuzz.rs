//! Whatever bytes arrive, a command is one that the robot may follow.

use bytemuck::Zeroable;
use interfaces::{LaserScan, Odometry, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::scene::{blank, turned};
use crate::{Algorithm, Config, Controller, Unfit, WallConfig};

/// [-] Pairs for each follower; `FUZZ_SAMPLES=10000000` makes it as many.
const SAMPLES: u64 = 350_000;

/// [-] Pairs of one stream: then another robot begins.
const STREAM: u64 = 500;

/// [ns] An hour.
const HOUR: u64 = 3_600_000_000_000;

const STRANGE: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    1e30,
    1e-40,
    -1e-40,
    0.0,
    -0.0,
    -1.0,
    1e-30,
];

/// What follows, and the greatest turning speed that it may ask for.
fn followers() -> [(&'static str, Config, f64); 3] {
    let limited = WallConfig {
        angular_max_rad_s: Some(0.34),
        turn_speed_rad_s: 0.37,
        fixed_front_s: 0.35,
        ..WallConfig::default()
    };
    let corridor = Config { algorithm: Algorithm::CorridorFollowing, ..Config::default() };
    [
        // Nothing limits it: an error of 1 km that comes up within a millisecond.
        ("wall", Config::default(), 1e7),
        ("limited wall", Config { wall_following: limited, ..Config::default() }, 0.37),
        ("corridor", corridor, 1.5),
    ]
}

#[test]
fn whatever_bytes_arrive_a_command_is_finite_and_within_the_limits() {
    let samples = std::env::var("FUZZ_SAMPLES").map_or(SAMPLES, |text| text.parse().unwrap());
    for (name, config, angular_max) in followers() {
        let (mut driven, mut unfit) = (0, [0_u64; Unfit::ALL.len()]);
        for seed in 0..samples.div_ceil(STREAM) {
            let mut source = Source::new(seed);
            let mut controller = Controller::new(&Config { seed, ..config.clone() }).unwrap();
            for _ in 0..STREAM {
                source.next();
                match controller.update(&source.scan, &source.odometry) {
                    Ok(command) => {
                        driven += 1;
                        let (linear, angular) = (command.linear, command.angular);
                        let is_lawful =
                            (0.0..=0.2).contains(&linear) && angular.abs() <= angular_max;
                        assert!(is_lawful, "SEED={seed}, {name}: {linear} m/s, {angular} rad/s");
                        let wheel = linear + 0.08 * angular.abs();
                        let is_feasible =
                            config.algorithm == Algorithm::WallFollowing || wheel <= 0.22;
                        assert!(is_feasible, "SEED={seed}, {name}: {wheel} m/s");
                        let newer = source.scan.header.stamp.max(source.odometry.header.stamp);
                        assert_eq!(command.header.stamp, newer, "SEED={seed}, {name}");
                    }
                    Err(reason) => unfit[reason as usize] += 1,
                }
            }
        }
        let refused: u64 = unfit.iter().sum();
        println!("{name}: {driven} scans and odometry samples driven by, {refused} refused");
        // Else nothing is tested.
        assert!(samples / 10 < driven, "{name}: {driven} of {samples} driven by");
        for reason in [Unfit::FewBeams, Unfit::Geometry, Unfit::Blind, Unfit::Odometry] {
            assert!(samples / 100 < unfit[reason as usize], "{name}: {reason:?} of {unfit:?}");
        }
    }
}

/// Scans and odometry that are sound, strange here and there, or arbitrary bytes.
struct Source {
    random: ChaCha8Rng,
    /// [ns] By a clock that runs.
    now: u64,
    /// [ns] Of the scan before.
    scanned: u64,
    scan: LaserScan,
    odometry: Odometry,
}

impl Source {
    fn new(seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed);
        Self {
            random,
            now: 10 * HOUR,
            scanned: 0,
            scan: blank(60, 0),
            odometry: Odometry::zeroed(),
        }
    }

    fn next(&mut self) {
        self.now += u64::from(self.random.next_u32() % 100_000_000);
        self.scanned = self.scan.header.stamp.nanoseconds;
        self.fill_scan();
        self.fill_odometry();
        self.scan.header.stamp = self.stamp();
        self.odometry.header.stamp = self.stamp();
    }

    fn one_in(&mut self, number: u32) -> bool {
        self.random.next_u32().is_multiple_of(number)
    }

    fn strange(&mut self) -> f32 {
        let drawn = self.random.next_u32();
        if drawn.is_multiple_of(2) {
            f32::from_bits(self.random.next_u32())
        } else {
            STRANGE[drawn as usize / 2 % STRANGE.len()]
        }
    }

    /// Mostly the newest moment, or one that no clock shows.
    fn stamp(&mut self) -> Stamp {
        let now = self.now;
        Stamp::from_nanoseconds(match self.random.next_u32() % 80 {
            0 => now + HOUR,
            1 => now - HOUR,
            2 => now - 1,
            3 => 0,
            4 => u64::MAX,
            5 => self.random.next_u64(),
            6 => self.scanned,
            7 => self.scanned.saturating_add(1),
            _ => now,
        })
    }

    fn fill_scan(&mut self) {
        let beams = 40 + self.random.next_u32() % 20;
        self.scan = blank(beams as usize, 0);
        if self.one_in(8) {
            self.random.fill_bytes(&mut bytemuck::bytes_of_mut(&mut self.scan)[..56 + 4 * 60]);
            if self.one_in(2) {
                self.scan.length = self.random.next_u32() % 64;
            }
            return;
        }
        self.scan.header.epoch = u32::from(self.one_in(50));
        if self.one_in(8) {
            self.random.fill_bytes(bytemuck::cast_slice_mut(self.scan.ranges_mut()));
        } else {
            let (none, one_in) = (self.one_in(8), 1 + self.random.next_u32() % 20);
            for index in 0..beams as usize {
                let near = 0.1 + (self.random.next_u32() % 512) as f32 / 512.0;
                let range = if self.one_in(one_in) { self.strange() } else { near };
                self.scan.range[index] = if none { -range.abs() } else { range };
            }
        }
        match self.random.next_u32() % 40 {
            0 => self.scan.angle_min = self.strange(),
            1 => self.scan.angle_increment = self.strange(),
            2 => self.scan.range_min = self.strange(),
            3 => self.scan.range_max = self.strange(),
            4 => self.scan.length = self.random.next_u32() % 70,
            _ => {}
        }
    }

    fn fill_odometry(&mut self) {
        if self.one_in(16) {
            self.random.fill_bytes(bytemuck::bytes_of_mut(&mut self.odometry));
            return;
        }
        let mut uniform = || f64::from(self.random.next_u32()) / f64::from(u32::MAX) - 0.5;
        self.odometry = turned(6.0 * uniform(), 0);
        (self.odometry.x, self.odometry.y) = (uniform(), uniform());
        (self.odometry.linear, self.odometry.angular) = (uniform(), 4.0 * uniform());
        self.odometry.header.epoch = u32::from(self.one_in(50));
        match self.random.next_u32() % 50 {
            0 => self.odometry.x = f64::from(self.strange()),
            1 => self.odometry.y = f64::from_bits(self.random.next_u64()),
            2 => self.odometry.yaw = f64::from_bits(self.random.next_u64()),
            3 => self.odometry.linear = f64::from(self.strange()),
            4 => self.odometry.angular = f64::from(self.strange()),
            _ => {}
        }
    }
}

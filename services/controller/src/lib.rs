//! Decides how the robot shall move, from what the LiDAR sees and the wheels report.
//!
//! Two algorithms, chosen by one key: the lab's wall follower, and a corridor follower that fits
//! lines through many beams and so keeps its course under a real sensor's noise. Neither knows a
//! map. Nothing here reads a clock: time is what the stamps say.

#![forbid(unsafe_code)]

mod config;
mod corridor_following;
mod run;
#[cfg(test)]
mod scene;
mod wall_following;
mod walls;

use interfaces::{LaserScan, Odometry, Pose, VelocityCommand};

pub use config::{Algorithm, Config, ConfigError, CorridorConfig, Distances, Pacing, WallConfig};

pub use run::{check, run};

use corridor_following::CorridorFollowing;
use wall_following::WallFollowing;

/// [-] A scan of fewer beams is no picture of the surroundings: the lab's windows would overlap.
pub const BEAMS_MIN: usize = 40;

/// What the robot is doing, in words for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Along a wall or a corridor.
    Following,
    /// In place, clockwise.
    TurningRight,
    /// In place, counterclockwise.
    TurningLeft,
    /// A short way straight ahead after a turn.
    LeavingTurn,
    /// Not at all, since the newest scan shows nothing.
    Blind,
}

/// A follower and its memory.
#[derive(Debug, Clone)]
pub struct Controller {
    follower: Follower,
    blind: bool,
}

/// Which of the two, with its memory.
#[derive(Debug, Clone)]
enum Follower {
    Wall(Box<WallFollowing>),
    Corridor(Box<CorridorFollowing>),
}

/// How the robot shall move.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Motion {
    /// [m/s] Speed along x of `base_link`.
    linear: f64,
    /// [rad/s] Turning speed about z.
    angular: f64,
}

impl Motion {
    const STOP: Self = Self { linear: 0.0, angular: 0.0 };
}

impl Controller {
    /// A follower that has seen nothing yet.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        config.validate()?;
        let seed = config.seed;
        let follower = match config.algorithm {
            Algorithm::WallFollowing => {
                Follower::Wall(Box::new(WallFollowing::new(&config.wall_following, seed)))
            }
            Algorithm::CorridorFollowing => {
                let following = CorridorFollowing::new(&config.corridor_following, seed);
                Follower::Corridor(Box::new(following))
            }
        };
        Ok(Self { follower, blind: true })
    }

    /// The command for the newest pair of samples, stamped with the newer of the two.
    ///
    /// Whatever the samples hold, the command is finite. A beam is a wall where
    /// `range_min <= range && range <= range_max`, and otherwise says nothing, but for `-inf`, which
    /// the corridor follower takes for a wall at `range_min`. A scan of fewer than [`BEAMS_MIN`]
    /// beams, or one whose every beam is NaN, `-inf` or out of range, shows nothing at all: the
    /// robot stands until it sees again. (All `+inf` is free space, and it drives.)
    ///
    /// Samples no newer than those before them repeat the command.
    pub fn update(&mut self, scan: &LaserScan, odometry: &Odometry) -> VelocityCommand {
        self.blind = is_blind(scan);
        let motion = if self.blind {
            Motion::STOP
        } else {
            match &mut self.follower {
                Follower::Wall(wall) => wall.update(scan),
                Follower::Corridor(corridor) => corridor.update(scan, odometry),
            }
        };
        assert!(motion.linear.is_finite() && motion.angular.is_finite());

        let mut command = VelocityCommand::default();
        command.header.stamp = scan.header.stamp.max(odometry.header.stamp);
        command.linear = motion.linear;
        command.angular = motion.angular;
        command
    }

    /// What the robot is doing.
    pub fn activity(&self) -> Activity {
        if self.blind {
            return Activity::Blind;
        }
        match &self.follower {
            Follower::Wall(wall) => wall.activity(),
            Follower::Corridor(corridor) => corridor.activity(),
        }
    }
}

/// Whether the controller is silent because another node drives: the robot knows its place.
pub fn is_handed_over(pose: Option<&Pose>) -> bool {
    pose.is_some_and(|pose| pose.localized != 0)
}

fn is_blind(scan: &LaserScan) -> bool {
    let shows = |&range: &f32| is_wall(scan, range) || range == f32::INFINITY;
    scan.len() < BEAMS_MIN
        || !scan.angle_min.is_finite()
        || !scan.angle_increment.is_finite()
        || !scan.ranges().iter().any(shows)
}

/// Whether a range is that of a wall, by the rule of the message.
fn is_wall(scan: &LaserScan, range: f32) -> bool {
    range.is_finite() && scan.range_min <= range && range <= scan.range_max
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;
    use crate::scene::{blank, stamp, turned};

    const ALGORITHMS: [Algorithm; 2] = [Algorithm::WallFollowing, Algorithm::CorridorFollowing];

    fn controller(algorithm: Algorithm, seed: u64) -> Controller {
        Controller::new(&Config { algorithm, seed, ..Config::default() }).unwrap()
    }

    /// Motion for one scan, by a controller that has seen nothing else.
    fn first(algorithm: Algorithm, scan: &LaserScan) -> (f64, f64) {
        let command = controller(algorithm, 1).update(scan, &turned(0.0, 50));
        (command.linear, command.angular)
    }

    #[test]
    fn a_scan_that_shows_nothing_stops_the_robot() {
        let filled = |beams: usize, range: f32| {
            let mut scan = blank(beams, 50);
            scan.ranges_mut().fill(range);
            scan
        };
        let table = vec![
            ("no beams", blank(1, 50)),
            ("too few beams", filled(BEAMS_MIN - 1, 1.0)),
            ("all invalid", filled(240, f32::NAN)),
            ("all too close", filled(240, f32::NEG_INFINITY)),
            ("all the zeros of a driver that knows no infinity", filled(240, 0.0)),
            ("all beyond range_max", filled(240, 8.5)),
            ("no direction", LaserScan { angle_min: f32::NAN, ..filled(240, 1.0) }),
            ("no step", LaserScan { angle_increment: f32::INFINITY, ..filled(240, 1.0) }),
            ("no least range", LaserScan { range_min: f32::NAN, ..filled(240, 1.0) }),
        ];
        for (name, scan) in table {
            for algorithm in ALGORITHMS {
                let mut controller = controller(algorithm, 1);
                let command = controller.update(&scan, &turned(0.0, 50));
                assert_eq!((command.linear, command.angular), (0.0, 0.0), "{name}, {algorithm:?}");
                assert_eq!(controller.activity(), Activity::Blind, "{name}, {algorithm:?}");
            }
        }
    }

    #[test]
    fn free_space_all_around_is_no_reason_to_stand() {
        assert_eq!(first(Algorithm::WallFollowing, &blank(240, 50)).0, 0.15);

        let mut controller = controller(Algorithm::CorridorFollowing, 1);
        let speeds: Vec<f64> = (1..=40)
            .map(|n| controller.update(&blank(240, 50 * n), &turned(0.0, 50 * n)).linear)
            .collect();
        assert!(speeds.is_sorted(), "{speeds:?}");
        assert_eq!(speeds[39], 0.2);
    }

    #[test]
    fn whatever_the_samples_hold_the_command_is_finite_and_the_wheels_can_follow() {
        for seed in 0..20 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            for algorithm in ALGORITHMS {
                let mut controller = controller(algorithm, seed);
                let mut milliseconds = 0;
                for _ in 0..200 {
                    milliseconds += u64::from(random.next_u32() % 4) * 25;
                    let (scan, odometry) = nonsense(&mut random, milliseconds);
                    let command = controller.update(&scan, &odometry);

                    let (linear, angular) = (command.linear, command.angular);
                    assert!(linear.is_finite() && angular.is_finite(), "SEED={seed}");
                    if algorithm == Algorithm::CorridorFollowing {
                        let wheel = linear.abs() + 0.08 * angular.abs();
                        assert!(wheel <= 0.22, "SEED={seed}: {wheel} m/s");
                    }
                }
            }
        }
    }

    /// A pair of samples of which some fields make no sense.
    fn nonsense(random: &mut ChaCha8Rng, milliseconds: u64) -> (LaserScan, Odometry) {
        let strange = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -1.0, f32::MAX, 1e-30];
        let mut pick = |sane: f32, one_in: u32| {
            let drawn = random.next_u32();
            let strange = strange[drawn as usize % strange.len()];
            if (drawn / 7).is_multiple_of(one_in) { strange } else { sane }
        };

        let mut scan = blank(240, milliseconds);
        for index in 0..scan.len() {
            scan.range[index] = pick(0.2 + 0.01 * (index % 40) as f32, 3);
        }
        scan.range_min = pick(0.12, 8);
        scan.range_max = pick(8.0, 8);
        scan.angle_min = pick(0.0, 8);
        scan.angle_increment = pick(scan.angle_increment, 8);

        let mut odometry = turned(f64::from(pick(0.1, 4)), milliseconds);
        odometry.x = f64::from(pick(0.1, 4));
        odometry.y = f64::from(pick(0.1, 4));
        odometry.angular = f64::from(pick(0.1, 4));
        (scan, odometry)
    }

    #[test]
    fn samples_no_newer_than_before_repeat_the_command() {
        let mut near = blank(240, 100);
        near.ranges_mut().fill(0.15);
        for algorithm in ALGORITHMS {
            let mut controller = controller(algorithm, 1);
            let mut far = blank(240, 100);
            far.ranges_mut().fill(0.6);
            let first = controller.update(&far, &turned(0.0, 100));

            for milliseconds in [100, 50] {
                near.header.stamp = stamp(milliseconds);
                let again = controller.update(&near, &turned(0.0, milliseconds));
                assert_eq!((again.linear, again.angular), (first.linear, first.angular));
            }
            near.header.stamp = stamp(150);
            let moved = controller.update(&near, &turned(0.0, 150));
            assert_ne!((moved.linear, moved.angular), (first.linear, first.angular));
        }
    }

    #[test]
    fn a_command_carries_the_stamp_of_the_newer_sample() {
        let mut controller = controller(Algorithm::WallFollowing, 1);
        for (scan, odometry, newer) in [(50, 70, 70), (100, 70, 100)] {
            let command = controller.update(&blank(240, scan), &turned(0.0, odometry));
            assert_eq!(command.header.stamp, stamp(newer));
        }
    }

    #[test]
    fn another_node_drives_while_a_pose_is_localized() {
        assert!(!is_handed_over(None));
        assert!(!is_handed_over(Some(&Pose::default())));
        assert!(is_handed_over(Some(&Pose { localized: 1, ..Pose::default() })));
    }
}

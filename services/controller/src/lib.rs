//! Decides how the robot shall move, from what the LiDAR sees and the wheels report.
//!
//! Two algorithms, chosen by one key: the lab's wall follower, and a corridor follower that fits
//! lines through many beams and so keeps its course under a real sensor's noise. Neither knows a
//! map. Nothing here reads a clock: time is what the stamps say.

#![forbid(unsafe_code)]

mod config;
mod corridor_following;
#[cfg(test)]
mod fuzz;
mod noted;
mod run;
#[cfg(test)]
mod scene;
mod timeline;
mod unfit;
mod wall_following;
mod walls;

use interfaces::{LaserScan, Odometry, Pose, Stamp, VelocityCommand};

pub use config::{
    Algorithm, Commands, Config, ConfigError, CorridorConfig, Distances, Pacing, TUNABLES,
    WallConfig,
};

pub use run::{check, run};
pub use unfit::{Unfit, check_age};

use corridor_following::CorridorFollowing;
use timeline::Timeline;
use unfit::check_samples;
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
    /// Not at all, since the newest samples were unfit.
    Blind,
}

/// A follower and its memory.
#[derive(Debug, Clone)]
pub struct Controller {
    follower: Follower,
    seed: u64,
    scan_time: Timeline,
    odometry_time: Timeline,
    blind: bool,
}

/// Which of the two, with its memory.
#[derive(Debug, Clone)]
enum Follower {
    Wall(Box<WallFollowing>),
    Corridor(Box<CorridorFollowing>),
}

impl Follower {
    fn new(config: &Config, seed: u64) -> Self {
        match config.algorithm {
            Algorithm::WallFollowing => {
                Self::Wall(Box::new(WallFollowing::new(&config.wall_following, seed)))
            }
            Algorithm::CorridorFollowing => {
                let following = CorridorFollowing::new(&config.corridor_following, seed);
                Self::Corridor(Box::new(following))
            }
        }
    }
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
        let follower = Follower::new(config, seed);
        let (scan_time, odometry_time) = (Timeline::default(), Timeline::default());
        Ok(Self { follower, seed, scan_time, odometry_time, blind: true })
    }

    /// The command for the newest pair of samples, stamped with the newer of the two; or why they
    /// say nothing about where to drive. Unfit samples change no memory: what follows them is driven
    /// by as if they had been lost.
    ///
    /// Whatever the samples hold, a command is finite. What a beam says:
    ///
    /// | range | meaning |
    /// |---|---|
    /// | from `range_min` to `range_max` | a wall |
    /// | `+inf` | free space |
    /// | `-inf` | the corridor follower sees a wall at `range_min`, the lab's nothing |
    /// | NaN | nothing |
    /// | negative, zero, denormal, or else below `range_min` | nothing |
    /// | huge (1e30), or else above `range_max` | nothing |
    ///
    /// Single beams of any kind are borne. Where none shows a wall or free space, the pair is
    /// [`Unfit::Blind`]; a scan of nothing but `+inf` is free space, and the robot drives. Limits,
    /// directions or a length that no LiDAR has are [`Unfit::Geometry`], numbers that no robot has
    /// [`Unfit::Odometry`]. Negative or denormal speeds and places are ordinary numbers.
    ///
    /// Samples no newer than those before them repeat the command, until two in a row are far
    /// behind: then their clock was set back, and the follower starts anew.
    pub fn update(
        &mut self,
        scan: &LaserScan,
        odometry: &Odometry,
    ) -> Result<VelocityCommand, Unfit> {
        self.blind = true;
        check_samples(scan, odometry)?;
        self.blind = false;

        let scan_turns_back = self.scan_time.turns_back(&scan.header);
        let odometry_turns_back = self.odometry_time.turns_back(&odometry.header);
        let motion = match &mut self.follower {
            Follower::Wall(wall) => {
                if scan_turns_back {
                    wall.forget();
                }
                wall.update(scan)
            }
            Follower::Corridor(corridor) => {
                if scan_turns_back || odometry_turns_back {
                    corridor.forget();
                }
                corridor.update(scan, odometry)
            }
        };
        assert!(motion.linear.is_finite() && motion.angular.is_finite());

        let mut command = VelocityCommand::default();
        command.header.stamp = scan.header.stamp.max(odometry.header.stamp);
        command.linear = motion.linear;
        command.angular = motion.angular;
        Ok(command)
    }

    /// The command for a robot that may move, or may not. One that is held is armed again by a while
    /// of commands that begin with zero, so it is told to stand, by samples that it could be driven
    /// by; and the follower goes on where it was.
    pub fn answer(
        &mut self,
        is_armed: bool,
        scan: &LaserScan,
        odometry: &Odometry,
    ) -> Result<VelocityCommand, Unfit> {
        if is_armed {
            return self.update(scan, odometry);
        }
        check_samples(scan, odometry)?;
        Ok(standstill(scan.header.stamp.max(odometry.header.stamp)))
    }

    /// From now on drives by the speeds, gains and distances of `config`, and remembers what it has
    /// seen, unless another one follows: that one has seen nothing yet. What else `config` says, the
    /// seed among it, changes nothing.
    pub fn retune(&mut self, config: &Config) -> Result<(), ConfigError> {
        config.validate()?;
        match (&mut self.follower, config.algorithm) {
            (Follower::Wall(wall), Algorithm::WallFollowing) => wall.retune(&config.wall_following),
            (Follower::Corridor(corridor), Algorithm::CorridorFollowing) => {
                corridor.retune(&config.corridor_following);
            }
            (follower, _) => *follower = Follower::new(config, self.seed),
        }
        Ok(())
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

/// What moves no robot: for one that is held, or that is to stand still.
fn standstill(stamp: Stamp) -> VelocityCommand {
    let mut command = VelocityCommand::default();
    command.header.stamp = stamp;
    command
}

/// Whether the controller is silent because another node drives: the robot knows its place.
pub fn is_handed_over(pose: Option<&Pose>) -> bool {
    pose.is_some_and(|pose| pose.localized != 0)
}

/// Whether a range is that of a wall, by the rule of the message.
fn is_wall(scan: &LaserScan, range: f32) -> bool {
    range.is_finite() && scan.range_min <= range && range <= scan.range_max
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use super::*;
    use crate::scene::{blank, stamp, turned};

    const ALGORITHMS: [Algorithm; 2] = [Algorithm::WallFollowing, Algorithm::CorridorFollowing];

    fn controller(algorithm: Algorithm, seed: u64) -> Controller {
        Controller::new(&Config { algorithm, seed, ..Config::default() }).unwrap()
    }

    /// Motion for one scan, by a controller that has seen nothing else.
    fn first(algorithm: Algorithm, scan: &LaserScan) -> (f64, f64) {
        let command = controller(algorithm, 1).update(scan, &turned(0.0, 50)).unwrap();
        (command.linear, command.angular)
    }

    #[test]
    fn unfit_samples_are_no_command_and_change_no_memory() {
        let mut near = blank(240, 150);
        near.ranges_mut().fill(0.3);
        let mut blind = blank(240, 100);
        blind.ranges_mut().fill(f32::NAN);
        let lost = Odometry { x: f64::INFINITY, ..turned(0.0, 100) };

        for algorithm in ALGORITHMS {
            let mut disturbed = controller(algorithm, 1);
            let mut undisturbed = disturbed.clone();
            assert_eq!(disturbed.activity(), Activity::Blind);
            for controller in [&mut disturbed, &mut undisturbed] {
                controller.update(&blank(240, 50), &turned(0.0, 50)).unwrap();
            }
            assert_eq!(disturbed.update(&blind, &turned(0.1, 100)), Err(Unfit::Blind));
            assert_eq!(disturbed.update(&near, &lost), Err(Unfit::Odometry));
            assert_eq!(disturbed.activity(), Activity::Blind);

            let commands = [&mut disturbed, &mut undisturbed]
                .map(|controller| controller.update(&near, &turned(0.2, 150)).unwrap());
            assert_eq!(commands[0], commands[1], "{algorithm:?}");
            assert_ne!(disturbed.activity(), Activity::Blind);
        }
    }

    #[test]
    fn after_a_jump_of_the_stamps_the_second_sane_pair_is_driven_by() {
        const HOUR: u64 = 3_600_000;
        let mut far = blank(240, 0);
        far.ranges_mut().fill(0.6);
        for algorithm in ALGORITHMS {
            for jump in [10 + HOUR, 9 * HOUR, 10 * HOUR + 300] {
                let mut controller = controller(algorithm, 1);
                for (scan, odometry) in [(10 * HOUR, 10 * HOUR), (jump, jump), (jump + 50, jump)] {
                    far.header.stamp = stamp(scan);
                    controller.update(&far, &turned(0.0, odometry)).unwrap();
                }

                let mut near = far;
                near.ranges_mut().fill(0.15);
                let mut motion = (0.0, 0.0);
                for at in [10 * HOUR + 50, 10 * HOUR + 100] {
                    near.header.stamp = stamp(at);
                    let command = controller.update(&near, &turned(0.0, at)).unwrap();
                    motion = (command.linear, command.angular);
                }
                let mut fresh = self::controller(algorithm, 1);
                let expected = fresh.update(&near, &turned(0.0, 10 * HOUR + 100)).unwrap();
                assert_eq!(motion.0, expected.linear, "{algorithm:?}, {jump}");
                assert_eq!(motion.0, 0.0, "a wall ahead, {algorithm:?}, {jump}");
            }
        }
    }

    #[test]
    fn another_follower_takes_over_as_if_it_had_always_been_there_and_none_forgets_without_need() {
        let mut near = blank(240, 50);
        near.ranges_mut().fill(0.3);
        let wall = Config { seed: 7, ..Config::default() };
        let corridor = Config { algorithm: Algorithm::CorridorFollowing, ..wall.clone() };
        let mut controller = Controller::new(&wall).unwrap();
        controller.update(&near, &turned(0.0, 50)).unwrap();
        controller.retune(&wall).unwrap();
        let before = controller.activity();
        controller.retune(&wall).unwrap();
        assert_eq!(controller.activity(), before);

        // A dead end, left by the side that the seed chooses: the launch file's, which is no parameter.
        near.ranges_mut().fill(0.15);
        for seed in 1..9 {
            let corridor = Config { seed, ..corridor.clone() };
            let mut controller = Controller::new(&corridor).unwrap();
            controller.update(&near, &turned(0.0, 50)).unwrap();
            controller.retune(&Config { seed: 0, ..wall.clone() }).unwrap();
            let mut fresh = Controller::new(&Config { seed, ..wall.clone() }).unwrap();
            let mut drive = |controller: &mut Controller| {
                let times = [100, 150, 200];
                times.map(|at| {
                    near.header.stamp = stamp(at);
                    controller.update(&near, &turned(0.0, at)).unwrap()
                })
            };
            let commands = [drive(&mut controller), drive(&mut fresh)];
            assert_eq!(commands[0], commands[1], "SEED={seed}");
        }
    }

    #[test]
    fn free_space_all_around_is_no_reason_to_stand() {
        assert_eq!(first(Algorithm::WallFollowing, &blank(240, 50)).0, 0.15);

        let mut controller = controller(Algorithm::CorridorFollowing, 1);
        let speeds: Vec<f64> = (1..=40)
            .map(|n| controller.update(&blank(240, 50 * n), &turned(0.0, 50 * n)).unwrap().linear)
            .collect();
        assert!(speeds.is_sorted(), "{speeds:?}");
        assert_eq!(speeds[39], 0.2);
    }

    #[test]
    fn samples_no_newer_than_before_repeat_the_command() {
        let mut near = blank(240, 100);
        near.ranges_mut().fill(0.15);
        for algorithm in ALGORITHMS {
            let mut controller = controller(algorithm, 1);
            let mut far = blank(240, 100);
            far.ranges_mut().fill(0.6);
            let first = controller.update(&far, &turned(0.0, 100)).unwrap();

            for milliseconds in [100, 50] {
                near.header.stamp = stamp(milliseconds);
                let again = controller.update(&near, &turned(0.0, milliseconds)).unwrap();
                assert_eq!((again.linear, again.angular), (first.linear, first.angular));
            }
            near.header.stamp = stamp(150);
            let moved = controller.update(&near, &turned(0.0, 150)).unwrap();
            assert_ne!((moved.linear, moved.angular), (first.linear, first.angular));
        }
    }

    #[test]
    fn a_command_carries_the_stamp_of_the_newer_sample() {
        let mut controller = controller(Algorithm::WallFollowing, 1);
        for (scan, odometry, newer) in [(50, 70, 70), (100, 70, 100)] {
            let command = controller.update(&blank(240, scan), &turned(0.0, odometry)).unwrap();
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

//! A robot in a world of walls: it drives, it touches, it measures, and all of it from one seed.
//!
//! This is the simulator without its process: no clock, no input or output, nothing allocated after
//! [`Simulator::new`]. Same configuration, same world and same commands give the same bits.

#![forbid(unsafe_code)]

mod arc;
mod collision;
mod config;
mod crowd;
mod discs;
mod drive;
mod estimate;
mod geometry;
mod grid;
mod lidar;
mod noise;
mod progress;
mod raster;
mod run;
mod scanner;
mod world;

use interfaces::{JointState, LaserScan, Pose, Stamp};
use nalgebra::Isometry2;

pub use config::{Config, ConfigError, LidarConfig, TUNABLES};
pub use crowd::{Crowd, Overlap};
pub use drive::WheelLimit;
pub use estimate::PoseError;
pub use noise::Noise;
pub use progress::Progress;
pub use run::{check, run};
pub use scanner::{Scanner, maze};
pub use world::{Block, Segment, Start, World, WorldError};

use arc::Arc;
use collision::Contact;
use discs::Disc;
use drive::Drive;
use geometry::Walls;
use lidar::Lidar;

/// One robot in one world, moved step by step.
pub struct Simulator {
    dt: f64,
    goal: Option<[f64; 2]>,
    position_tolerance: f64,
    heading_tolerance: f64,

    walls: Walls,
    /// Other robots, where there are some.
    others: Vec<Disc>,
    drive: Drive,
    lidar: Lidar,
    contact: Contact,
    progress: Progress,

    world_from_base: Isometry2<f64>,
    steps: u64,
    distance: f64,
    localized: bool,
}

impl Simulator {
    /// The robot at rest on the start that the configuration names.
    pub fn new(config: &Config, world: &World) -> Result<Self, Error> {
        config.validate()?;
        world.validate()?;
        let walls = Walls::new(world.walls());
        let start = world.start(&config.start)?;
        world.check_free(&config.start, &walls, config.robot_radius_m)?;

        let world_from_base = start.world_from_base();
        Ok(Self {
            dt: config.dt_s / f64::from(config.substeps),
            goal: config.goal_m,
            position_tolerance: config.position_tolerance_m,
            heading_tolerance: config.heading_tolerance_rad,
            drive: Drive::new(config),
            lidar: Lidar::new(config),
            contact: Contact::new(config.robot_radius_m, &walls, &world_from_base),
            progress: Progress::new(start),
            walls,
            others: Vec::new(),
            world_from_base,
            steps: 0,
            distance: 0.0,
            localized: false,
        })
    }

    /// Drives for one step.
    ///
    /// `linear` [m/s] and `angular` [rad/s] are what the wheels shall do; the wheel limit decides
    /// what they do. Where a wall or another robot is in the way it stops at contact, heading included, and
    /// the wheels slip: their encoders go on counting.
    pub fn step(&mut self, linear: f64, angular: f64) {
        self.drive.command(linear, angular);
        let (distance, turn) = self.drive.advance();
        let arc = Arc { world_from_base: self.world_from_base, distance, turn };

        let fraction = self.contact.limit(&arc, &self.walls, &self.others);
        self.world_from_base = arc.at(fraction);
        self.contact.arrive(&self.walls, &self.others, &self.world_from_base);

        self.distance += distance.abs() * fraction;
        self.steps += 1;
        self.progress.visit(self.world_from_base.translation.vector.into());
    }

    /// Reads the encoders, whose increments are those since they were read before.
    pub fn fill_joint_state(&mut self, joint_state: &mut JointState) {
        joint_state.header.stamp = self.time();
        self.drive.fill(joint_state);
    }

    /// From now on the LiDAR errs like this.
    pub fn set_noise(&mut self, noise: Noise) {
        self.lidar.set_noise(noise);
    }

    /// From now on other robots are there.
    pub(crate) fn meet(&mut self, others: impl Iterator<Item = Disc>) {
        self.others.clear();
        self.others.extend(others);
    }

    /// The robot, as others meet it.
    pub(crate) fn disc(&self) -> Disc {
        let centre = self.world_from_base.translation.vector.into();
        Disc { centre, radius: self.contact.radius() }
    }

    /// Turns the LiDAR once. Every call draws fresh noise.
    pub fn sense(&mut self, scan: &mut LaserScan) {
        scan.header.stamp = self.time();
        self.lidar.sense(&self.walls, &self.others, &self.world_from_base, scan);
    }

    /// [m] One beam from where the LiDAR is, `angle` [rad] counterclockwise from straight ahead, with
    /// the noise of a beam: infinity where there is nothing in range, NaN where it fails. For a
    /// LiDAR that measures beam by beam while the robot moves.
    pub fn range(&mut self, angle: f64) -> f64 {
        self.lidar.range(&self.walls, &self.others, &self.world_from_base, angle)
    }

    /// Holds somebody's estimate, in the world's frame, against the truth, and remembers whether it
    /// was localized: only then the goal counts.
    pub fn check_estimate(&mut self, estimate: &Pose) -> PoseError {
        self.localized = estimate.localized == 1;
        PoseError::of(
            estimate,
            &self.world_from_base,
            self.position_tolerance,
            self.heading_tolerance,
        )
    }

    /// Whether the robot is at the goal and its last estimate was localized.
    pub fn is_goal_reached(&self) -> bool {
        let position = self.world_from_base.translation.vector;
        self.localized
            && self.goal.is_some_and(|[x, y]| {
                libm::hypot(x - position.x, y - position.y) <= self.position_tolerance
            })
    }

    /// [ns] Simulated time, which starts at zero.
    pub fn time(&self) -> Stamp {
        // From the count, not by summing up, so that a period of no whole nanoseconds cannot drift.
        let nanoseconds = (self.steps as f64 * self.dt * 1e9).round();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
        Stamp::from_nanoseconds(nanoseconds as u64)
    }

    /// [-] Steps driven so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Where the robot truly is.
    pub fn world_from_base(&self) -> Isometry2<f64> {
        self.world_from_base
    }

    /// [m] Driven so far, backwards counted like forwards.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// [m] From the robot's edge to the nearest wall.
    pub fn clearance(&self) -> f64 {
        self.contact.clearance()
    }

    /// [m] The least clearance since the start.
    pub fn clearance_min(&self) -> f64 {
        self.contact.clearance_min()
    }

    /// [-] How often the robot ran into a wall or another robot; pushing on does not count again.
    pub fn collisions(&self) -> u64 {
        self.contact.collisions()
    }

    /// [-] Commands that the wheels did not follow as given: held, scaled or not finite.
    pub fn commands_limited(&self) -> u64 {
        self.drive.limited()
    }

    /// Which cells of the corridor the robot has been in.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }
}

/// Why there is no simulation.
#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// The configuration is wrong.
    Config(ConfigError),
    /// The world is wrong, or does not fit the configuration.
    World(WorldError),
}

impl std::fmt::Display for Error {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Config(error) => error.fmt(formatter),
            Self::World(error) => error.fmt(formatter),
        }
    }
}

impl std::error::Error for Error {}

impl From<ConfigError> for Error {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

impl From<WorldError> for Error {
    fn from(error: WorldError) -> Self {
        Self::World(error)
    }
}

//! `teseo emulate`: the emulator's robot in the simulator's world. Neither knows the other.

use clap::{Args, Subcommand, ValueEnum};
use node::config::{FileName, Layers};
use node::{Error, Result};
use simulator::{Config, LidarConfig, Simulator, WheelLimit, World};

/// Which robot.
#[derive(Subcommand)]
pub(crate) enum Robot {
    /// A TurtleBot3 Burger: its board and its LiDAR on two pseudo-terminals
    ///
    /// Says on standard output when its wheels turn and stand, by the clock of all stamps, and takes
    /// orders on standard input: `unplug board`, `garbage lidar`, `battery 10.9`; `help` tells all.
    #[command(
        after_help = "Example:\n  teseo emulate turtlebot3 --lidar lds-01 --until round-trip"
    )]
    Turtlebot3(Options),
}

/// Where the robot is, and how it is played.
#[derive(Args)]
pub(crate) struct Options {
    #[command(flatten)]
    robot: emulator::Options,

    /// The world's file
    #[arg(long, value_name = "FILE", default_value = "config/worlds/lab02.toml")]
    world: String,

    /// Which of the world's starts
    #[arg(long, value_name = "NAME", default_value = "outer")]
    start: String,

    /// How far the LiDAR's measurements are from the truth
    #[arg(long, value_enum, default_value_t = Noise::Ideal)]
    noise: Noise,

    /// What noise is derived from
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,

    /// End where the corridor was driven out and back, or, with an error, where a wall was touched
    #[arg(long, value_enum)]
    until: Option<Until>,
}

/// The simulator's models.
#[derive(Clone, Copy, ValueEnum)]
enum Noise {
    Ideal,
    Gazebo,
    Lds01,
}

/// What the emulator waits for.
#[derive(Clone, Copy, ValueEnum)]
enum Until {
    RoundTrip,
}

impl Robot {
    pub(crate) fn run(&self) -> Result {
        let Self::Turtlebot3(options) = self;
        emulator::run(&options.robot, &mut Surroundings::new(options)?)
    }
}

/// The simulator's world around the emulator's robot.
struct Surroundings {
    simulator: Simulator,
    until: Option<Until>,
}

impl Surroundings {
    fn new(options: &Options) -> Result<Self> {
        let file = FileName::from(options.world.as_str());
        let world: World = Layers::new().named(&file).parse()?;
        let lidar = LidarConfig {
            noise: match options.noise {
                Noise::Ideal => simulator::Noise::Ideal,
                Noise::Gazebo => simulator::Noise::Gazebo,
                Noise::Lds01 => simulator::Noise::Lds01,
            },
            ..LidarConfig::default()
        };
        let config = Config {
            world: file,
            start: options.start.clone(),
            seed: options.seed,
            dt_s: emulator::STEP.as_secs_f64(),
            // What the motors can do is the emulator's affair.
            wheel_limit: WheelLimit::Scale,
            wheel_speed_max_rad_s: 100.0,
            lidar,
            ..Config::default()
        };
        let simulator = Simulator::new(&config, &world);
        let simulator = simulator.map_err(|why| Error::Fault(why.to_string()))?;
        Ok(Self { simulator, until: options.until })
    }
}

impl emulator::World for Surroundings {
    fn step(&mut self, linear: f64, angular: f64) {
        self.simulator.step(linear, angular);
    }

    fn range(&mut self, angle: f64) -> f64 {
        self.simulator.range(angle)
    }

    fn heading(&self) -> f64 {
        self.simulator.world_from_base().rotation.angle()
    }

    fn awaited(&self) -> Option<&'static str> {
        self.until.map(|Until::RoundTrip| "round trip")
    }

    fn ending(&self) -> Option<std::result::Result<String, String>> {
        let awaited = self.awaited()?;
        if 0 < self.simulator.collisions() {
            let place = self.simulator.world_from_base().translation;
            return Some(Err(format!("touched a wall at x {:.3} m, y {:.3} m", place.x, place.y)));
        }
        let is_there = self.simulator.progress().is_round_trip();
        is_there.then(|| Ok(awaited.to_owned()))
    }

    fn summary(&self) -> String {
        let simulator = &self.simulator;
        format!(
            "distance {:.3} m, clearance min {:.3} m, collisions {}, cells {}",
            simulator.distance(),
            simulator.clearance_min(),
            simulator.collisions(),
            simulator.progress().path()
        )
    }
}

//! What can be set; the defaults are the lab's simulation.

use std::fmt;

use node::Tunable;
use node::config::{Parameters, Report};
use serde::{Deserialize, Serialize};

/// Everything a controller can be told.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Which follower drives.
    pub algorithm: Algorithm,
    /// [-] Of the choice where left and right look alike: the launch file's.
    #[serde(skip)]
    pub seed: u64,
    /// What makes the process compute a command; the algorithms themselves do not care.
    pub pacing: Pacing,
    /// [s] Between two commands, where a timer paces them.
    pub period_s: f64,
    /// [s] In real time, the robot is not driven by a pair of which one sample is older.
    pub input_age_max_s: f64,
    /// Where they go.
    pub commands: Commands,
    /// Of the lab's follower.
    pub wall_following: WallConfig,
    /// Of the follower for noisy sensors.
    pub corridor_following: CorridorConfig,
}

/// Which follower drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Algorithm {
    /// The lab's: nearest beams, proportional-derivative, turns until the front is free.
    #[default]
    WallFollowing,
    /// Lines through many beams, centred between the walls, turns by odometry.
    CorridorFollowing,
}

/// What makes the process compute a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Pacing {
    /// Each pair of samples, once: the lab's simulation.
    #[default]
    EveryPair,
    /// A timer, with the newest pair there is: the lab's robot.
    Timer,
}

/// Which topic the commands go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Commands {
    /// `cmd_vel`: straight to the wheels.
    #[default]
    CmdVel,
    /// `autonomy_cmd_vel`: to a multiplexer, which chooses between the controller and others.
    AutonomyCmdVel,
}

/// How the lab's follower reads a distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Distances {
    /// The least of ten beams: the lab's simulation.
    #[default]
    Windows,
    /// One beam: the lab's robot.
    Beams,
}

/// The lab's wall follower.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct WallConfig {
    /// How a distance is read from the scan.
    pub distances: Distances,
    /// [m] What a direction without a usable beam is taken to be.
    pub distance_missing_m: f64,
    /// [m] To keep from the followed wall.
    pub target_distance_m: f64,
    /// [m] From this much room between left and right on, the nearer wall is followed.
    pub corridor_width_m: f64,
    /// [rad/(s m)] Turning speed per error.
    pub gain_proportional_rad_s_m: f64,
    /// [rad/m] Turning speed per rate of the error.
    pub gain_derivative_rad_m: f64,
    /// [m/s] Along a wall.
    pub speed_m_s: f64,
    /// [rad/s] Of following, not of turning in place; no limit where it is absent.
    pub angular_max_rad_s: Option<f64>,
    /// [m] A wall ahead at this distance is the end of the straight.
    pub front_threshold_m: f64,
    /// [m] Left and right differ by no more: a dead end or a crossing, and a choice at random.
    pub ambiguity_m: f64,
    /// [rad/s] In place.
    pub turn_speed_rad_s: f64,
    /// [-] A turn ends where the front is free for the threshold's diagonal, times this.
    pub turn_exit_margin: f64,
    /// [m] A turn does not end on more free space than this; no limit where it is absent.
    pub turn_exit_max_m: Option<f64>,
    /// [s] Straight ahead after a turn, before the walls count again; 0 for none.
    pub fixed_front_s: f64,
    /// [m/s] Straight ahead after a turn.
    pub fixed_front_speed_m_s: f64,
}

/// The follower for noisy sensors.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct CorridorConfig {
    /// [m] The LiDAR's place along x of `base_link`.
    pub sensor_x_m: f64,
    /// [m] The robot's, about the middle of its axle.
    pub robot_radius_m: f64,
    /// [m] Between the wheels.
    pub track_m: f64,
    /// [m/s] What one wheel can do.
    pub wheel_speed_max_m_s: f64,
    /// [m] Standard deviation of one range, roughly; it weighs the walls against the odometry.
    pub range_noise_m: f64,
    /// [m] Believed until both walls have been seen.
    pub corridor_width_m: f64,
    /// [m/s] Along a corridor.
    pub speed_m_s: f64,
    /// [m/s²] Of starting and of braking.
    pub acceleration_m_s2: f64,
    /// [rad/s] In place and along a corridor.
    pub angular_max_rad_s: f64,
    /// [rad/m] Heading against the corridor per distance from its middle.
    pub gain_offset_rad_m: f64,
    /// [1/s] Turning speed per heading error.
    pub gain_heading_1_s: f64,
}

/// What may be changed while the robot drives: who follows, speeds, gains, and the distance to the wall.
/// What says when a robot stops, where its commands go, or what it is made of, may not.
pub static TUNABLES: [Tunable; 13] = [
    Tunable::word("algorithm", &["wall_following", "corridor_following"]),
    Tunable::word("wall_following.distances", &["windows", "beams"]),
    Tunable::number("wall_following.target_distance_m", 0.15..=0.5),
    Tunable::number("wall_following.gain_proportional_rad_s_m", 0.0..=20.0),
    Tunable::number("wall_following.gain_derivative_rad_m", 0.0..=20.0),
    Tunable::number("wall_following.speed_m_s", 0.01..=0.22),
    Tunable::number("wall_following.turn_speed_rad_s", 0.1..=2.0),
    Tunable::number("wall_following.fixed_front_speed_m_s", 0.01..=0.22),
    Tunable::number("corridor_following.speed_m_s", 0.01..=0.22),
    Tunable::number("corridor_following.acceleration_m_s2", 0.05..=2.0),
    Tunable::number("corridor_following.angular_max_rad_s", 0.1..=2.84),
    Tunable::number("corridor_following.gain_offset_rad_m", 0.1..=20.0),
    Tunable::number("corridor_following.gain_heading_1_s", 0.1..=20.0),
];

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        if let Err(error) = self.validate() {
            report.refuse(error.key(), error.to_string(), "leave it out for the lab's value");
        }
    }
}

impl Config {
    /// Refuses what no robot could be driven with.
    pub fn validate(&self) -> Result<(), ConfigError> {
        positive("period_s", self.period_s)?;
        positive("input_age_max_s", self.input_age_max_s)?;
        self.wall_following.validate()?;
        self.corridor_following.validate()
    }
}

impl WallConfig {
    fn validate(&self) -> Result<(), ConfigError> {
        positive("wall_following.distance_missing_m", self.distance_missing_m)?;
        positive("wall_following.target_distance_m", self.target_distance_m)?;
        positive("wall_following.corridor_width_m", self.corridor_width_m)?;
        not_negative("wall_following.gain_proportional_rad_s_m", self.gain_proportional_rad_s_m)?;
        not_negative("wall_following.gain_derivative_rad_m", self.gain_derivative_rad_m)?;
        positive("wall_following.speed_m_s", self.speed_m_s)?;
        if let Some(limit) = self.angular_max_rad_s {
            positive("wall_following.angular_max_rad_s", limit)?;
        }
        positive("wall_following.front_threshold_m", self.front_threshold_m)?;
        not_negative("wall_following.ambiguity_m", self.ambiguity_m)?;
        positive("wall_following.turn_speed_rad_s", self.turn_speed_rad_s)?;
        positive("wall_following.turn_exit_margin", self.turn_exit_margin)?;
        if let Some(limit) = self.turn_exit_max_m {
            positive("wall_following.turn_exit_max_m", limit)?;
        }
        not_negative("wall_following.fixed_front_s", self.fixed_front_s)?;
        positive("wall_following.fixed_front_speed_m_s", self.fixed_front_speed_m_s)?;

        // Else a turn would never end.
        if self.turn_exit_max_m.is_some_and(|limit| limit <= self.turn_exit_m()) {
            return Err(ConfigError::TooSmall("wall_following.turn_exit_max_m"));
        }
        Ok(())
    }

    /// [m] The free space ahead that ends a turn.
    pub(crate) fn turn_exit_m(&self) -> f64 {
        self.front_threshold_m * std::f64::consts::SQRT_2 * self.turn_exit_margin
    }
}

impl CorridorConfig {
    fn validate(&self) -> Result<(), ConfigError> {
        if !self.sensor_x_m.is_finite() {
            return Err(ConfigError::NotFinite("corridor_following.sensor_x_m"));
        }
        positive("corridor_following.robot_radius_m", self.robot_radius_m)?;
        positive("corridor_following.track_m", self.track_m)?;
        positive("corridor_following.wheel_speed_max_m_s", self.wheel_speed_max_m_s)?;
        positive("corridor_following.range_noise_m", self.range_noise_m)?;
        positive("corridor_following.corridor_width_m", self.corridor_width_m)?;
        positive("corridor_following.speed_m_s", self.speed_m_s)?;
        positive("corridor_following.acceleration_m_s2", self.acceleration_m_s2)?;
        positive("corridor_following.angular_max_rad_s", self.angular_max_rad_s)?;
        positive("corridor_following.gain_offset_rad_m", self.gain_offset_rad_m)?;
        positive("corridor_following.gain_heading_1_s", self.gain_heading_1_s)?;

        // Else it fits nowhere, and would turn on the spot for ever.
        if self.corridor_width_m <= 2.0 * self.robot_radius_m {
            return Err(ConfigError::TooSmall("corridor_following.corridor_width_m"));
        }
        Ok(())
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::default(),
            seed: 1,
            pacing: Pacing::default(),
            period_s: 0.05,
            // A turn of the slowest LiDAR, 0.2 s; the lab's slop on the robot, 0.15 s; and the
            // pairs' deadline, 0.15 s, for which the timer may use a pair.
            input_age_max_s: 0.5,
            commands: Commands::default(),
            wall_following: WallConfig::default(),
            corridor_following: CorridorConfig::default(),
        }
    }
}

impl Default for WallConfig {
    fn default() -> Self {
        Self {
            distances: Distances::Windows,
            distance_missing_m: 8.0,
            target_distance_m: 0.2,
            corridor_width_m: 0.4,
            gain_proportional_rad_s_m: 4.0,
            gain_derivative_rad_m: 5.0,
            speed_m_s: 0.15,
            angular_max_rad_s: None,
            front_threshold_m: 0.23,
            ambiguity_m: 0.05,
            turn_speed_rad_s: 0.5,
            turn_exit_margin: 1.3,
            turn_exit_max_m: None,
            fixed_front_s: 0.0,
            fixed_front_speed_m_s: 0.1,
        }
    }
}

impl Default for CorridorConfig {
    fn default() -> Self {
        Self {
            sensor_x_m: -0.032,
            robot_radius_m: 0.105,
            track_m: 0.16,
            wheel_speed_max_m_s: 0.22,
            range_noise_m: 0.01,
            corridor_width_m: 0.4,
            speed_m_s: 0.2,
            acceleration_m_s2: 0.4,
            angular_max_rad_s: 1.5,
            gain_offset_rad_m: 4.0,
            gain_heading_1_s: 4.0,
        }
    }
}

/// Which key cannot be driven with, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConfigError {
    /// It must be a finite number.
    NotFinite(&'static str),
    /// It must be a finite number above zero.
    NotPositive(&'static str),
    /// It must be a finite number, zero or above.
    Negative(&'static str),
    /// It is beyond anything a robot does.
    TooGreat(&'static str),
    /// It leaves no room: the robot could never go on.
    TooSmall(&'static str),
}

impl ConfigError {
    /// [-] The key of the value that is wrong.
    pub const fn key(self) -> &'static str {
        match self {
            Self::NotFinite(key)
            | Self::NotPositive(key)
            | Self::Negative(key)
            | Self::TooGreat(key)
            | Self::TooSmall(key) => key,
        }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite(key) => write!(formatter, "{key} must be a finite number"),
            Self::NotPositive(key) => {
                write!(formatter, "{key} must be a finite number above zero")
            }
            Self::Negative(key) => {
                write!(formatter, "{key} must be a finite number, zero or above")
            }
            Self::TooGreat(key) => write!(formatter, "{key} must be below {VALUE_MAX}"),
            Self::TooSmall(key) => {
                write!(formatter, "{key} is so small that the robot could never go on")
            }
        }
    }
}

impl std::error::Error for ConfigError {}

/// [-] What no value of a robot exceeds, in any unit: products of two stay finite.
const VALUE_MAX: f64 = 1e6;

fn positive(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() && 0.0 < value {
        not_too_great(key, value)
    } else {
        Err(ConfigError::NotPositive(key))
    }
}

fn not_negative(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() && 0.0 <= value {
        not_too_great(key, value)
    } else {
        Err(ConfigError::Negative(key))
    }
}

fn not_too_great(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value <= VALUE_MAX { Ok(()) } else { Err(ConfigError::TooGreat(key)) }
}

#[cfg(test)]
mod tests {
    use node::Choice;

    use super::*;

    const LAB_SIMULATION: &str = include_str!("../../../config/controller/lab_simulation.toml");
    const LAB_ROBOT: &str = include_str!("../../../config/controller/lab_robot.toml");
    const CORRIDOR: &str = include_str!("../../../config/controller/corridor_following.toml");

    fn parse(text: &str) -> Config {
        let config: Config = toml::from_str(text).unwrap();
        assert_eq!(config.validate(), Ok(()));
        config
    }

    #[test]
    fn the_default_is_the_lab_s_simulation() {
        assert_eq!(parse(LAB_SIMULATION), Config::default());
        assert_eq!(parse(""), Config::default());
    }

    #[test]
    fn what_may_be_changed_on_the_way_is_there_and_may_be_all_that_its_range_says() {
        for Tunable { key, to } in &TUNABLES {
            let values = match to {
                Choice::Number(range) => vec![range.start().to_string(), range.end().to_string()],
                Choice::Word(words) => words.iter().map(|word| format!("{word:?}")).collect(),
                Choice::Switch => vec!["true".to_owned(), "false".to_owned()],
            };
            for value in values {
                parse(&format!("{key} = {value}"));
            }
        }
    }

    #[test]
    fn the_robot_s_file_is_the_robot_s_column() {
        let robot = WallConfig {
            distances: Distances::Beams,
            gain_proportional_rad_s_m: 7.6,
            gain_derivative_rad_m: 6.0,
            angular_max_rad_s: Some(0.34),
            front_threshold_m: 0.28,
            turn_speed_rad_s: 0.37,
            turn_exit_max_m: Some(0.75),
            fixed_front_s: 0.35,
            ..WallConfig::default()
        };
        let expected = Config { pacing: Pacing::Timer, wall_following: robot, ..Config::default() };
        assert_eq!(parse(LAB_ROBOT), expected);
    }

    #[test]
    fn the_corridor_s_file_is_its_default() {
        let expected = Config { algorithm: Algorithm::CorridorFollowing, ..Config::default() };
        assert_eq!(parse(CORRIDOR), expected);
    }

    #[test]
    fn unknown_keys_and_words_are_refused() {
        let table = [
            "speed = 1",
            "algorithm = \"potential_field\"",
            "pacing = \"fast\"",
            "commands = \"teleop_cmd_vel\"",
            "wall_following.speed = 0.1",
            "corridor_following.speed_max = 0.1",
        ];
        for text in table {
            assert!(toml::from_str::<Config>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn values_that_nothing_can_be_driven_with_are_refused_by_key() {
        let table = [
            ("period_s = 0", "period_s must be a finite number above zero"),
            ("input_age_max_s = inf", "input_age_max_s must be a finite number above zero"),
            ("wall_following.speed_m_s = nan", "must be a finite number above zero"),
            ("wall_following.ambiguity_m = -0.1", "must be a finite number, zero or above"),
            ("wall_following.angular_max_rad_s = inf", "must be a finite number above zero"),
            ("wall_following.fixed_front_s = 1e7", "wall_following.fixed_front_s must be below"),
            ("wall_following.turn_exit_max_m = 0.4", "the robot could never go on"),
            ("corridor_following.sensor_x_m = nan", "sensor_x_m must be a finite number"),
            ("corridor_following.range_noise_m = 0", "range_noise_m must be a finite number"),
            ("corridor_following.corridor_width_m = 0.21", "the robot could never go on"),
        ];
        for (text, part) in table {
            let config: Config = toml::from_str(text).unwrap();
            let message = config.validate().unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
            let key = text.split(' ').next().unwrap_or_default();
            assert!(message.starts_with(key), "{text}: {message}");
        }
    }
}

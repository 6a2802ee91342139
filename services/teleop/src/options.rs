//! The command line of `teseo teleop`.

use std::time::Duration;

use clap::Args;
use node::deadman::Motion;

use node::hand::PATIENCE;

/// What `teseo teleop` can be told.
#[derive(Debug, Clone, Args)]
pub struct Options {
    /// The robot [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,

    /// Keep the speeds while no key is pressed, as `turtlebot3_teleop` does
    #[arg(long)]
    hold: bool,

    /// The fastest along x; a `TurtleBot3` Burger's, unless given
    #[arg(long, value_name = "M/S", default_value_t = 0.22, value_parser = speed)]
    linear_max: f64,

    /// The fastest about z; a `TurtleBot3` Burger's, unless given
    #[arg(long, value_name = "RAD/S", default_value_t = 2.84, value_parser = speed)]
    angular_max: f64,
}

impl Options {
    /// The robot that is meant, where several run.
    pub fn robot(&self) -> Option<&str> {
        self.robot.as_deref()
    }

    pub(crate) const fn fastest(&self) -> Motion {
        Motion { linear: self.linear_max, angular: self.angular_max }
    }

    pub(crate) fn patience(&self) -> Option<Duration> {
        (!self.hold).then_some(PATIENCE)
    }
}

fn speed(text: &str) -> Result<f64, String> {
    let speed: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if (0.0..=1e3).contains(&speed) { Ok(speed) } else { Err("give 0 to 1000".to_owned()) }
}

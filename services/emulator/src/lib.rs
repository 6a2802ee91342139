//! `teseo emulate turtlebot3`: a TurtleBot3 Burger on pseudo-terminals, for a bridge to talk to.
//!
//! It plays the OpenCR's firmware and an LDS-01 or LDS-02, in whatever [`World`] it is given. Nothing
//! here is shared with the bridge: what both get wrong alike nobody would see.

#![forbid(unsafe_code)]

mod bus;
mod console;
mod firmware;
mod lds01;
mod lds02;
mod line;
mod motors;
mod options;
mod run;
#[cfg(test)]
mod vectors;

use std::time::Duration;

pub use options::{Lidar, Options};
pub use run::run;

/// Between two steps of a [`World`].
pub const STEP: Duration = Duration::from_millis(5);

/// What is around the robot.
pub trait World {
    /// Drives for one [`STEP`]: `linear` [m/s] along x, `angular` [rad/s] about z.
    fn step(&mut self, linear: f64, angular: f64);

    /// [m] From the LiDAR to a wall, `angle` [rad] counterclockwise from straight ahead: infinity
    /// where there is none, NaN where the beam fails.
    fn range(&mut self, angle: f64) -> f64;

    /// [rad] Where the robot heads.
    fn heading(&self) -> f64;

    /// What ends the run well, if anything does.
    fn awaited(&self) -> Option<&'static str>;

    /// Whether the run is over, well or ill, and why.
    fn ending(&self) -> Option<Result<String, String>>;

    /// What has happened so far, in one line.
    fn summary(&self) -> String;
}

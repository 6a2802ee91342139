//! Where the robot is and how fast it moves, from its wheels or from poses that it reports.

#![forbid(unsafe_code)]

mod config;
mod continuity;
#[cfg(test)]
mod fuzz;
mod heading;
mod poses;
mod run;
mod wheels;

pub use config::{Config, Heading, Source, TUNABLES, Turning};
pub use continuity::Rejected;
pub use heading::{Headings, yaw};
pub use poses::PoseOdometry;
pub use run::{check, run};
pub use wheels::WheelOdometry;

/// [rad] `angle`, in `-PI..=PI`.
fn wrapped(angle: f64) -> f64 {
    libm::atan2(libm::sin(angle), libm::cos(angle))
}

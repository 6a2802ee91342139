//! Driving by hand: keys in, speeds out.
//!
//! What keys ask for is [`node::hand`]'s: speeds stay only while keys come. `--hold` is for who wants
//! them to stay, as `turtlebot3_teleop` has it.

#![forbid(unsafe_code)]

mod keys;
mod line;
mod options;
mod run;
mod terminal;

pub use keys::Keys;
pub use options::Options;
pub use run::run;

//! The bridge to a TurtleBot3 Burger: its OpenCR board and its LiDAR, over their serial ports.
//!
//! What is public is pure: time and bytes come in as arguments, bytes and measurements come out.
//! `serial.rs` is the only module that opens a port.

#![forbid(unsafe_code)]

pub mod board;
pub mod board_clock;
mod config;
pub mod encoders;
mod framer;
#[cfg(test)]
mod fuzz;
pub mod lidar;
pub mod link;
pub mod packet;
mod run;
mod serial;
pub mod table;
#[cfg(test)]
mod vectors;

pub use config::{Config, LidarChoice, PositiveTurn, TUNABLES};
pub use run::{check, run};

//! The bridge to a TurtleBot3 Burger: its OpenCR board and its LiDAR, over their serial ports.
//!
//! What is here is pure: time and bytes come in as arguments, bytes and measurements come out.

#![forbid(unsafe_code)]

pub mod board;
pub mod board_clock;
pub mod encoders;
mod framer;
#[cfg(test)]
mod fuzz;
pub mod lidar;
pub mod link;
pub mod packet;
pub mod table;
#[cfg(test)]
mod vectors;

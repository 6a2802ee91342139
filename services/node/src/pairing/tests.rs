//! Agreement with ROS 2, and what must hold for any stream.

mod allocation;
mod invariants;
mod jumps;
mod limits;
mod offline;
mod parity;
mod streams;

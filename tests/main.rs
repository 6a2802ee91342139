//! Whole-system tests: real processes, each robot in shared memory of its own, and the house rules.
//!
//! One binary with a module per theme, so that it links once.

#![forbid(unsafe_code)]

#[cfg(test)]
mod bad_input;
#[cfg(test)]
mod bench;
#[cfg(test)]
mod bridge;
#[cfg(test)]
mod chaos;
#[cfg(test)]
mod conformance;
#[cfg(test)]
mod console;
#[cfg(test)]
mod crash_matrix;
#[cfg(test)]
mod determinism;
#[cfg(test)]
mod doctor;
#[cfg(test)]
mod emulated;
#[cfg(test)]
mod example;
#[cfg(test)]
mod exhaustion;
#[cfg(test)]
mod faults;
#[cfg(test)]
mod hogs;
#[cfg(test)]
mod house_rules;
#[cfg(test)]
mod instructions;
#[cfg(test)]
mod kill_points;
#[cfg(test)]
mod lifecycle;
#[cfg(test)]
mod pairing;
#[cfg(test)]
mod random;
#[cfg(test)]
mod realtime;
#[cfg(test)]
mod report;
#[cfg(test)]
mod robot;
#[cfg(test)]
mod round_trip;
#[cfg(test)]
mod safety;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod stalls;
#[cfg(test)]
mod supervision;
#[cfg(test)]
mod teleop;
#[cfg(test)]
mod terminal;
#[cfg(test)]
mod tickets;
#[cfg(test)]
mod topics;
#[cfg(test)]
mod units;
#[cfg(test)]
mod view;
#[cfg(test)]
mod waiting;
#[cfg(test)]
mod witness;

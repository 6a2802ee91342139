//! Brings a robot up and down: launch, lifecycle order, approximate-time pairing, report.
//!
//! `teseo up` is two processes. The *guardian* holds the robot's lock and starts the
//! *supervisor*, which starts everything else; whatever happens to the supervisor,
//! the guardian leaves no process and no file behind.

#![forbid(unsafe_code)]

mod guardian;
mod member;
mod options;
mod pair;
mod pairing;
mod report;
mod screen;
mod supervise;

use std::process::ExitCode;

pub use options::Options;
pub use pair::{PairOptions, pair};

/// `teseo up`: the guardian, or the supervisor that it has started.
pub fn main(options: &Options) -> ExitCode {
    node::log::start(options.log);
    let is_supervisor = std::env::var_os(guardian::ROLE).is_some();
    let outcome = if is_supervisor { supervise::supervise(options) } else { guardian::up(options) };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(error) => node::exit_code("teseo", Err(error)),
    }
}

//! Brings a robot up and down: launch, lifecycle order, approximate-time pairing, report.
//!
//! `teseo up` is two processes. The *guardian* holds the robot's lock and starts the
//! *supervisor*, which starts everything else; whatever happens to the supervisor,
//! the guardian leaves no process and no file behind.

#![forbid(unsafe_code)]

mod check;
mod guardian;
mod member;
mod options;
mod pair;
mod pairing;
mod report;
mod screen;
mod supervise;

use std::process::ExitCode;

pub use check::{CheckOptions, check};
pub use options::Options;
pub use pair::{PairOptions, pair};

/// What knows whether the parameters of a service are right; `None` where there is no such service.
pub type Check = fn(&node::Settings) -> Option<node::Result>;

/// `teseo up`: the guardian, or the supervisor that it has started. `check` knows the parameters of
/// every service, which this crate does not.
pub fn up(options: &Options, check: Check) -> ExitCode {
    node::log::start(options.log);
    let is_supervisor = std::env::var_os(guardian::ROLE).is_some();
    let outcome =
        if is_supervisor { supervise::supervise(options) } else { guardian::up(options, check) };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(error) => node::exit_code("teseo", Err(error)),
    }
}

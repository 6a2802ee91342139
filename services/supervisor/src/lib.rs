//! Brings a robot up and down: launch, lifecycle order, approximate-time pairing, report.
//!
//! `teseo up` is two processes. The *guardian* holds the robot's lock and starts the
//! *supervisor*, which starts everything else; whatever happens to the supervisor,
//! the guardian leaves no process and no file behind.

#![forbid(unsafe_code)]

mod check;
mod clear;
mod control;
mod desk;
mod detach;
mod doctor;
mod flow;
mod guardian;
mod history;
mod last_words;
mod launcher;
mod lock;
mod log_book;
mod machine;
mod member;
mod motion;
mod notify;
mod options;
mod outlet;
mod pair;
mod pairing;
mod plan;
mod preflight;
mod report;
mod screen;
mod shim;
mod shown;
mod status;
mod supervise;
mod sweep;
mod timeline;
mod tuning;
mod units;
mod verb;
mod verbs;
mod verdict;

use std::process::ExitCode;

pub use options::Options;
pub use pairing::{TUNABLES as PAIRING_TUNABLES, run as pairing};
pub use shown::Shown;
pub use verb::Verb;
pub use verbs::{Goal, find, steer};

/// What knows our services, which this crate does not.
#[derive(Debug, Clone, Copy)]
pub struct Check {
    /// Their names.
    pub services: &'static [&'static str],
    /// Whether the parameters of one are right; `None` where there is no such service.
    pub parameters: fn(&node::Settings) -> Option<node::Result>,
}

/// What makes a page of the records of a run, in the directory with them.
pub type Render = fn(&std::path::Path) -> node::Result;

/// `teseo up`: the guardian, or the supervisor that it has started.
fn up(options: &Options, check: Check, render: Render) -> ExitCode {
    node::log::start(options.log);
    let is_supervisor = std::env::var_os(guardian::ROLE).is_some();
    let outcome = if is_supervisor {
        supervise::supervise(options, render)
    } else if options.detach && !detach::is_alone() {
        detach::up(options)
    } else {
        guardian::up(options, check)
    };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(error) => node::exit_code("teseo", Err(error)),
    }
}

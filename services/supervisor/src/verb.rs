//! What can be asked of a robot on the command line.

use std::process::ExitCode;

use clap::Subcommand;

use crate::check::{self, CheckOptions};
use crate::clear::{self, ClearOptions};
use crate::doctor::{self, DoctorOptions};
use crate::options::Options;
use crate::pair::{self, PairOptions};
use crate::shim::{self, ExecOptions};
use crate::units::{self, UnitsOptions};
use crate::verbs;
use crate::{Check, Render};

/// A verb about robots.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Bring a robot up, run it, and take it down again
    #[command(
        alias = "launch",
        after_help = "Examples:\n  teseo up config/simulation.toml --until round-trip\n  \
                            teseo up config/lab_robot.toml --detach"
    )]
    Up(Options),
    /// Say everything that is wrong with a launch file, without running it
    Check(CheckOptions),
    /// Replay recorded streams through the pairing: why do my topics not pair?
    Pair(PairOptions),
    /// Make systemd units of a launch file
    Units(UnitsOptions),
    /// Say what of this machine would trouble a robot, and what mends it
    Doctor(DoctorOptions),
    /// Remove what the dead runs of a robot have left
    #[command(after_help = "Example:\n  teseo clear --robot burger")]
    Clear(ClearOptions),
    /// Become a node's program: for the supervisor alone
    #[command(name = shim::VERB, hide = true)]
    Exec(ExecOptions),
    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened verbs document themselves")]
    Running(verbs::Verb),
}

impl Verb {
    /// Does it; `check` knows the parameters of every service, and `render` makes the page of a run,
    /// which this crate does not.
    pub fn run(self, check: Check, render: Render) -> ExitCode {
        match self {
            Self::Up(options) => crate::up(&options, check, render),
            Self::Check(options) => check::check(&options, check),
            Self::Pair(options) => node::exit_code("teseo pair", pair::pair(&options)),
            Self::Units(options) => units::units(&options, check),
            Self::Doctor(options) => doctor::doctor(&options, check),
            Self::Clear(options) => clear::clear(&options),
            Self::Exec(options) => shim::exec(&options),
            Self::Running(verb) => verb.run(),
        }
    }
}

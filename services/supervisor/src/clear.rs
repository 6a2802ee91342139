//! `teseo clear`: removes what the dead runs of a robot have left.

use std::process::ExitCode;

use clap::Args;
use node::{Error, Namespace, Result, Unfinished, clock};

use crate::lock::Lock;
use crate::supervise::{POLL_POSTPONED, UNFINISHED_AGE, UNFINISHED_WAIT};
use crate::{last_words, sweep};

/// Which robot, and what to do where it lives.
#[derive(Debug, Clone, Args)]
pub struct ClearOptions {
    /// The robot
    #[arg(long, value_name = "NAME")]
    pub robot: String,

    /// Where the robot runs do not refuse, but remove only what a killed process left unfinished:
    /// for one who is about to start a node of it
    #[arg(long)]
    pub or_unfinished: bool,
}

/// Exit code 5 where the robot runs.
pub(crate) fn clear(options: &ClearOptions) -> ExitCode {
    node::exit_code("teseo", carry_out(options))
}

fn carry_out(options: &ClearOptions) -> Result {
    let namespace = Namespace::new(&options.robot)?;
    match Lock::take(&namespace) {
        Ok(_lock) => remove(&namespace),
        Err(Error::Held { .. }) if options.or_unfinished => {
            sweep_unfinished(&namespace);
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// All of it, and first whoever outlives the run. The robot's lock is ours.
fn remove(namespace: &Namespace) -> Result {
    sweep::strangers(namespace);
    last_words::forget(namespace);
    match namespace.remove().first() {
        None => Ok(()),
        Some(path) => Err(Error::Fault(format!("{} could not be removed", path.display()))),
    }
}

/// As the supervisor does it before a node's next life.
fn sweep_unfinished(namespace: &Namespace) {
    let begun = clock::now();
    let mut known = Unfinished::default();
    while 0 < namespace.sweep_unfinished(&mut known, UNFINISHED_AGE).unfinished
        && clock::now().since(begun) < UNFINISHED_WAIT
    {
        clock::nap(POLL_POSTPONED);
    }
}

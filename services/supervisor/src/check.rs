//! `teseo check`: everything that is wrong with a launch file and what it names, at once.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use node::config::{self, Errors, Place};
use node::{Error, Result, Settings};

use crate::Check;

/// What to check.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  teseo check config/simulation.toml")]
pub struct CheckOptions {
    /// The launch file
    #[arg(value_name = "CONFIG", default_value = "config/simulation.toml")]
    pub config: PathBuf,

    /// As `teseo up` would be given it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

/// Checks without running anything; exit code 78 where something is wrong.
pub fn check(options: &CheckOptions, check: Check) -> ExitCode {
    let settings = Settings::of_supervisor(&options.config, &options.sets);
    let outcome = settings.and_then(|settings| {
        check_all(&options.config, &settings, check)?;
        let count = settings.launch().process.len();
        let verdict = format!("{}: {count} processes, no mistake\n", options.config.display());
        // Whoever closed our standard output has the exit code.
        drop(std::io::stdout().write_all(verdict.as_bytes()));
        Ok(())
    });
    node::exit_code("teseo check", outcome)
}

/// Checks the parameters of every process of the launch file, which lies at `file`.
pub(crate) fn check_all(file: &Path, settings: &Settings, check: Check) -> Result {
    let mut errors = Errors::default();
    for process in settings.launch().process.iter().filter(|process| process.exec.is_empty()) {
        match check(&settings.within(&process.name)) {
            Some(Err(Error::Config(more))) => errors.extend(more),
            Some(other) => other?,
            None => {
                let message = format!("there is no service `{}`", process.name);
                let help = "name one of ours, or say with `exec` what to run";
                let place = Place::File(file.to_owned());
                errors.extend([config::Error::new(place, "process.name", message, help)]);
            }
        }
    }
    if errors.is_empty() { Ok(()) } else { Err(Error::Config(errors)) }
}

//! `teseo check`: everything that is wrong with a launch file and what it names, at once.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use node::config::{Report, suggestion};
use node::launch::Launch;
use node::{Error, Result, Settings};

use crate::{Check, shim};

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
pub(crate) fn check(options: &CheckOptions, check: Check) -> ExitCode {
    let outcome = check_all(&options.config, &options.sets, check).map(|settings| {
        let count = settings.launch().process.len();
        let verdict = format!("{}: {count} processes, no mistake\n", options.config.display());
        // Whoever closed our standard output has the exit code.
        drop(std::io::stdout().write_all(verdict.as_bytes()));
    });
    node::exit_code("teseo check", outcome)
}

/// Reads the launch file `file` and checks everything it names: the programs, and the parameters of
/// every process.
pub(crate) fn check_all(file: &Path, sets: &[String], check: Check) -> Result<Settings> {
    // One mistake hides no other: what could be read is checked all the same.
    let (settings, mut errors) = Settings::of_supervisor_and_errors(file, sets);
    let Some(settings) = settings else { return Err(Error::Config(errors)) };
    let mut strangers = Vec::new();
    for process in settings.launch().process.iter().filter(|process| process.exec.is_empty()) {
        match (check.parameters)(&settings.within(&process.name)) {
            Some(Err(Error::Config(more))) => errors.extend(more),
            Some(other) => other?,
            None => strangers.push(process.name.clone()),
        }
    }
    let sets: Vec<_> = sets.iter().filter_map(|set| set.parse().ok()).collect();
    let read = Launch::read_and(file, &sets, |launch, report| {
        check_programs(launch, &strangers, check.services, report);
    });
    errors.extend(read.err().into_iter().flatten());
    if errors.is_empty() { Ok(settings) } else { Err(Error::Config(errors)) }
}

/// Refuses what this machine cannot run.
fn check_programs(
    launch: &Launch,
    strangers: &[String],
    services: &[&str],
    report: &mut Report<'_>,
) {
    for (index, process) in launch.process.iter().enumerate() {
        let key = format!("process[{index}]");
        if strangers.contains(&process.name) && !report.is_mended(format!("{key}.exec")) {
            let message = format!("there is no service `{}`", process.name);
            let help =
                format!("{}; or say with `exec` what to run", suggestion(&process.name, services));
            report.refuse(format!("{key}.name"), message, help);
        }
        if let Some(program) = process.exec.first()
            && let Err(why) = shim::find_program(program)
        {
            let help = "build it (a node of this workspace: cargo build --release --workspace), \
                        write its whole path, or put it beside teseo or into PATH";
            report.refuse(format!("{key}.exec[0]"), why, help);
        }
        if process.cpu_scheduling_priority.is_some() && shim::find_program("chrt").is_err() {
            let help = "install util-linux, or leave it out";
            report.refuse(format!("{key}.cpu_scheduling_priority"), "needs `chrt`", help);
        }
    }
}

//! `teseo doctor`: what of this machine would trouble a robot, and the command that mends it.
//!
//! What the machine is like is read first ([`Machine`], [`Robots`]) and judged after, by functions
//! without any access to it.

mod finding;
mod limits;
mod logind;
mod machine;
mod needs;
mod robots;
mod system;

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use node::{Error, Settings};

use crate::Check;
use crate::check::check_all;
use finding::{Finding, Level};
use machine::Machine;
use needs::Needs;
use robots::Robots;

/// What to look at.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  teseo doctor config/lab_robot.toml")]
pub struct DoctorOptions {
    /// The launch file
    #[arg(value_name = "CONFIG", default_value = "config/simulation.toml")]
    pub config: PathBuf,

    /// As `teseo up` would be given it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,

    /// One array of objects, for programs: level, what, found, mend
    #[arg(long)]
    pub json: bool,
}

/// Looks, and says what it finds; exit code 1 where something is a failure, which the robot would
/// not survive, and 0 where all is well or may pass: notes and warnings are no failures.
pub(crate) fn doctor(options: &DoctorOptions, check: Check) -> ExitCode {
    let findings = examine(options, check);
    let text = if options.json { finding::json(&findings) } else { as_text(&findings) };
    // Whoever closed our standard output has the exit code.
    drop(std::io::stdout().write_all(text.as_bytes()));
    let is_failure = findings.iter().any(|finding| finding.level == Level::Failure);
    if is_failure { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Each topic once, in the order in which a person wants to mend them.
fn examine(options: &DoctorOptions, check: Check) -> Vec<Finding> {
    let launch_file = examine_launch_file(options, check);
    let settings = Settings::of_supervisor(&options.config, &options.sets).ok();
    let ports = settings.as_ref().and_then(|settings| settings.view(needs::BRIDGE));
    let needs = settings.as_ref().map(|settings| Needs::of(settings.launch(), ports));
    let needs = needs.as_ref();
    let machine = Machine::read();
    let robots = Robots::read(&machine.runtime.path);
    vec![
        launch_file,
        limits::shared_memory(&machine, needs),
        limits::memory_lock(&machine, needs),
        limits::priority(&machine, needs),
        limits::open_files(&machine),
        limits::serial_ports(&machine, needs),
        robots::runtime_directory(&machine, needs),
        robots::former_runs(&robots),
        robots::running(&robots),
        system::processors(&machine, needs),
        system::waiting(&machine, needs),
        system::governor(&machine),
        system::clock_source(&machine),
        system::systemd(&machine),
        system::logout(&machine),
    ]
}

/// Tells on standard error all that `teseo check` would.
fn examine_launch_file(options: &DoctorOptions, check: Check) -> Finding {
    let what = "launch file";
    let file = options.config.display();
    let error = match check_all(&options.config, &options.sets, check) {
        Ok(settings) => {
            let count = settings.launch().process.len();
            return Finding::ok(what, format!("{file}: {count} processes, no mistake"));
        }
        Err(error) => error,
    };
    // Whoever closed our standard error does not want to know.
    drop(writeln!(std::io::stderr(), "teseo doctor: {error}\n"));
    let count = match &error {
        Error::Config(errors) if errors.len() != 1 => format!("{} errors", errors.len()),
        _ => "1 error".to_owned(),
    };
    let found = format!("{file}: {count}, told on standard error");
    Finding::new(Level::Failure, what, found).mend(format!("teseo check {file}"))
}

fn as_text(findings: &[Finding]) -> String {
    let no_color = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    finding::text(findings, std::io::stdout().is_terminal() && !no_color)
}

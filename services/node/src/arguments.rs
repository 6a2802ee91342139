//! What a process is started with: a launch file, its place in it, and the command line.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory, FromArgMatches, Parser};
use rustix::process::{Pid, Signal};

use crate::config::{Errors, Parameters, Setting};
use crate::launch::Launch;
use crate::{Clock, Error, Namespace, Node, Result, Wait, log, managed, signal};

/// The environment variable that names the process without which this one must not live.
pub const PARENT: &str = "TESEO_PARENT";

/// The command line of every node.
#[derive(Debug, Clone, Args)]
pub struct Arguments {
    /// The launch file
    #[arg(long, value_name = "FILE", default_value = "config/simulation.toml")]
    pub config: PathBuf,

    /// The process of the launch file that this one is [default: the service's name]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,

    /// Set any key of the launch file (`seed=7`) or of a process (`simulator.start=inner`)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,

    /// Configure and activate without being asked to
    #[arg(long)]
    pub autostart: bool,

    /// Which life of this process it is
    #[arg(long, value_name = "NUMBER", default_value_t = 1, hide = true)]
    pub epoch: u32,

    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options document themselves")]
    pub log: log::Options,
}

/// What a node knows before it has opened anything.
#[derive(Debug, Clone)]
pub struct Settings {
    name: String,
    epoch: u32,
    autostart: bool,
    heeds_signals: bool,
    launch: Launch,
    sets: Vec<Setting>,
}

impl Settings {
    /// From a node's command line; `service` is its name where that says nothing else.
    pub fn of_node(arguments: &Arguments, service: &str) -> Result<Self> {
        let sets = parse(&arguments.sets)?;
        let launch = Launch::read(&arguments.config, &sets)?;
        Ok(Self {
            name: arguments.name.clone().unwrap_or_else(|| service.to_owned()),
            epoch: arguments.epoch,
            autostart: arguments.autostart,
            heeds_signals: true,
            launch,
            sets,
        })
    }

    /// For a supervisor of the robot in `file`.
    pub fn of_supervisor(file: &Path, sets: &[String]) -> Result<Self> {
        let sets = parse(sets)?;
        let launch = Launch::read(file, &sets)?;
        Ok(Self {
            name: "supervisor".to_owned(),
            epoch: 1,
            autostart: false,
            heeds_signals: true,
            launch,
            sets,
        })
    }

    /// The same for a node that runs in its supervisor's process, which alone heeds signals.
    #[must_use]
    pub fn within(&self, name: &str) -> Self {
        Self { name: name.to_owned(), heeds_signals: false, ..self.clone() }
    }

    /// [-] The node's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// [-] Which life of the node it is, from 1.
    pub const fn epoch(&self) -> u32 {
        self.epoch
    }

    /// The launch file.
    pub const fn launch(&self) -> &Launch {
        &self.launch
    }

    /// Whose time the robot lives in.
    pub const fn clock(&self) -> Clock {
        self.launch.clock
    }

    /// How the node waits.
    pub fn wait(&self) -> Wait {
        self.launch.wait(self.launch.process(&self.name))
    }

    /// Where the robot's shared memory lies.
    pub fn namespace(&self) -> Result<Namespace> {
        Namespace::new(&self.launch.robot)
    }

    /// Some of the parameters of the process called `name`, for one who is not that process; `None`
    /// where they cannot be read, which that process will say itself.
    pub fn view<T: Parameters>(&self, name: &str) -> Option<T> {
        self.launch.parameters(name, &self.sets).ok()
    }

    pub(crate) const fn autostart(&self) -> bool {
        self.autostart
    }

    pub(crate) const fn heeds_signals(&self) -> bool {
        self.heeds_signals
    }

    /// The node's own parameters.
    pub fn parameters<T: Parameters>(&self) -> Result<T> {
        Ok(self.launch.parameters(&self.name, &self.sets)?)
    }
}

/// The command line's settings, or everything that is wrong with them.
fn parse(sets: &[String]) -> Result<Vec<Setting>> {
    let mut errors = Errors::default();
    let mut parsed = Vec::new();
    for set in sets {
        match set.parse::<Setting>() {
            Ok(setting) => parsed.push(setting),
            Err(error) => errors.extend([error]),
        }
    }
    if errors.is_empty() { Ok(parsed) } else { Err(Error::Config(errors)) }
}

/// A node's whole `main`: reads the command line, runs `body` as a managed node, and says with the
/// exit code how it went.
pub fn main(service: &'static str, body: impl FnMut(&mut Node<'_>) -> Result) -> ExitCode {
    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        arguments: Arguments,
    }
    let matches = Command::command().name(service).get_matches();
    match Command::from_arg_matches(&matches) {
        Ok(command) => start(&command.arguments, service, body),
        Err(error) => error.exit(),
    }
}

/// Runs `body` as the managed node that `arguments` describe, and says with the exit code how it
/// went.
pub fn start(
    arguments: &Arguments,
    service: &str,
    body: impl FnMut(&mut Node<'_>) -> Result,
) -> ExitCode {
    exit_code(service, run(arguments, service, body))
}

fn run(arguments: &Arguments, service: &str, body: impl FnMut(&mut Node<'_>) -> Result) -> Result {
    log::start(arguments.log);
    signal::listen();
    die_with_parent(Signal::KILL);
    let settings = Settings::of_node(arguments, service)?;
    managed::run_with(&settings, body)
}

/// Says on standard error what went wrong, once, and translates it.
pub fn exit_code(name: &str, outcome: Result) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    // Whoever closed our standard error does not want to know.
    drop(writeln!(std::io::stderr(), "{name}: {error}"));
    ExitCode::from(error.exit_code())
}

/// From now on this process gets `signal` when the one that started it dies. A process whose
/// parent is dead already ends here.
pub fn die_with_parent(signal: Signal) {
    let parent = std::env::var(PARENT).ok().and_then(|parent| parent.parse().ok());
    let Some(parent) = parent.and_then(Pid::from_raw) else { return };
    let set = rustix::process::set_parent_process_death_signal(Some(signal));
    if let Err(cause) = set {
        tracing::warn!(%cause, "this process may outlive its supervisor");
    }
    if rustix::process::getppid() != Some(parent) {
        std::process::exit(1);
    }
}

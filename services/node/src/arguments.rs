//! What a process is started with: a launch file, its place in it, and the command line.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory, FromArgMatches, Parser};
use interfaces::Stamp;
use rustix::process::{Pid, Signal};

use crate::config::{Errors, Listable, Listed, Parameters, Report, Setting};
use crate::faults::FaultsByTopic;
use crate::launch::Launch;
use crate::trace::TRACE;
use crate::{
    Clock, Error, Namespace, Node, Notifier, Result, Wait, clock, log, managed, say, signal,
};

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
    #[arg(long, value_name = "NUMBER", hide = true)]
    pub epoch: Option<u32>,

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
    /// Where it tells how it is, if not where the environment says.
    notify: Option<PathBuf>,
    /// The timeline that it makes a part of.
    trace: Option<PathBuf>,
    launch: Launch,
    sets: Vec<Setting>,
}

/// A file or directory that the environment names.
pub(crate) fn given(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
}

impl Settings {
    /// From a node's command line; `service` is its name where that says nothing else.
    pub fn of_node(arguments: &Arguments, service: &str) -> Result<Self> {
        let (sets, errors) = parse(&arguments.sets);
        if !errors.is_empty() {
            return Err(Error::Config(errors));
        }
        let launch = Launch::read(&arguments.config, &sets)?;
        Ok(Self {
            name: arguments.name.clone().unwrap_or_else(|| service.to_owned()),
            epoch: arguments.epoch.unwrap_or_else(|| {
                if arguments.autostart { uncounted_epoch(clock::now()) } else { 1 }
            }),
            autostart: arguments.autostart,
            heeds_signals: true,
            notify: None,
            trace: given(TRACE),
            launch,
            sets,
        })
    }

    /// For a supervisor of the robot in `file`.
    pub fn of_supervisor(file: &Path, sets: &[String]) -> Result<Self> {
        let (settings, errors) = Self::of_supervisor_and_errors(file, sets);
        match settings {
            Some(settings) if errors.is_empty() => Ok(settings),
            _ => Err(Error::Config(errors)),
        }
    }

    /// The same with all that is wrong, for one who looks for mistakes further on; `None` where what
    /// was read says too little for that.
    pub fn of_supervisor_and_errors(file: &Path, sets: &[String]) -> (Option<Self>, Errors) {
        let (sets, mut errors) = parse(sets);
        let mut read = None;
        let outcome = Launch::read_and(file, &sets, |launch, report| {
            let mut launch = launch.clone();
            if report.is_mended("clock") {
                // No process refuses it: nothing is told that only follows from the wrong one.
                launch.clock = Clock::Realtime;
            }
            read = Some(launch);
        });
        errors.extend(outcome.err().into_iter().flatten());
        let settings = read.map(|launch| Self {
            name: "supervisor".to_owned(),
            epoch: 1,
            autostart: false,
            heeds_signals: true,
            notify: None,
            trace: given(TRACE),
            launch,
            sets,
        });
        (settings, errors)
    }

    /// The same for a node that runs in its supervisor's process, which alone heeds signals.
    #[must_use]
    pub fn within(&self, name: &str) -> Self {
        Self { name: name.to_owned(), heeds_signals: false, ..self.clone() }
    }

    /// The same for a node in life number `epoch`, that tells how it is at the socket `notify` and
    /// makes a part of the timeline `trace`, if anybody wants one.
    #[must_use]
    pub fn in_life(self, epoch: u32, notify: &Path, trace: Option<&Path>) -> Self {
        Self { epoch, notify: Some(notify.to_owned()), trace: trace.map(Path::to_owned), ..self }
    }

    pub(crate) fn trace(&self) -> Option<&Path> {
        self.trace.as_deref()
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

    /// What goes wrong on purpose with the node's topics, and what else `check` finds wrong with
    /// that.
    pub(crate) fn faults(
        &self,
        check: impl FnOnce(&FaultsByTopic, &mut Report<'_>),
    ) -> Result<FaultsByTopic> {
        Ok(self.launch.faults(&self.name, &self.sets, check)?)
    }

    pub(crate) const fn autostart(&self) -> bool {
        self.autostart
    }

    pub(crate) fn notifier(&self) -> Notifier {
        self.notify.as_deref().map_or_else(Notifier::from_environment, Notifier::to)
    }

    pub(crate) const fn heeds_signals(&self) -> bool {
        self.heeds_signals
    }

    /// The node's own parameters.
    pub fn parameters<T: Parameters>(&self) -> Result<T> {
        Ok(self.launch.parameters(&self.name, &self.sets)?)
    }

    /// The same, key by key, with the place where each was written.
    pub fn listed<T: Listable>(&self) -> Result<Vec<Listed>> {
        Ok(self.launch.listed::<T>(&self.name, &self.sets)?)
    }
}

/// Which life it is of a process whose lives nobody counts, and which may have had others before: the
/// time since the machine started, in tenths of a second. Larger in each life, for thirteen years,
/// where no two begin within one tenth.
pub(crate) fn uncounted_epoch(now: Stamp) -> u32 {
    let tenths = now.since(Stamp::ZERO).as_millis() / 100;
    u32::try_from(tenths).unwrap_or(u32::MAX).max(1)
}

/// The command line's settings, and everything that is wrong with them.
fn parse(sets: &[String]) -> (Vec<Setting>, Errors) {
    let mut errors = Errors::default();
    let mut parsed = Vec::new();
    for set in sets {
        match set.parse::<Setting>() {
            Ok(setting) => parsed.push(setting),
            Err(error) => errors.extend([error]),
        }
    }
    (parsed, errors)
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
    say::mention(&format!("{name}: {error}"));
    ExitCode::from(error.exit_code())
}

/// Whose death this process is told of, where it is not to die with it: the supervisor of a process
/// that drives the wheels.
pub const SUPERVISOR: &str = "TESEO_SUPERVISOR";

/// The supervisor that this process outlives, if there is one.
pub(crate) fn supervisor() -> Option<Pid> {
    Pid::from_raw(std::env::var(SUPERVISOR).ok()?.parse().ok()?)
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn each_life_of_a_node_that_starts_by_itself_has_a_larger_epoch() {
        let later = |milliseconds| Stamp::ZERO.after(Duration::from_millis(milliseconds));

        assert_eq!(uncounted_epoch(Stamp::ZERO), 1);
        assert!(uncounted_epoch(later(5_000)) < uncounted_epoch(later(5_100)));
    }
}

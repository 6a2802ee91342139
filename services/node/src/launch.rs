//! The launch file: one TOML file is the robot.

mod order;
mod process;

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};

pub use process::{Kind, Process, Restart, Strategy};

use crate::config::{
    self, Errors, Layers, Listable, Listed, Parameters, Place, Report, Setting, Table,
};
use crate::faults::FaultsByTopic;
use crate::namespace::check_name;
use crate::pairing::{self, offline::Algorithm};
use crate::{Clock, Wait};

/// What the launch file says, apart from the processes' own parameters.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Launch {
    /// [-] The robot's name; it keeps two robots on one machine apart.
    pub robot: String,
    /// Whose time the robot lives in.
    #[serde(default)]
    pub clock: Clock,
    /// [-] All that is random in a run comes from this.
    #[serde(default)]
    pub seed: u64,
    /// When the run has reached its end.
    #[serde(default)]
    pub until: Option<Until>,
    /// [s] The run ends after this long, of the robot's own time.
    #[serde(default)]
    pub for_s: Option<f64>,
    /// How processes wait, where they do not say it themselves.
    #[serde(default)]
    pub wait: Option<Wait>,
    /// How scan and odometry are paired.
    #[serde(default)]
    pairing: Table,
    /// The processes; where `after` and `requires` say nothing, they start in this order.
    pub process: Vec<Process>,
}

/// What a run can wait for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Until {
    /// The whole corridor out, and back to the start.
    RoundTrip,
    /// The goal, by a robot that knows where it is.
    Goal,
}

/// How scan and odometry are paired: the parameters of the pairing, which is no process of the launch
/// file.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct PairingParameters {
    /// Which of ROS 2's two algorithms.
    pub policy: Algorithm,
    /// [-] How much an older pair is preferred to a tighter one, by `adaptive` alone.
    pub age_penalty: f64,
    /// [-] Samples of one topic that wait for a partner.
    pub queue_size: usize,
    /// [ms] Two samples belong together if their stamps differ by less.
    pub slop_ms: f64,
    /// [ms] A sample received longer ago is never paired.
    pub max_age_ms: f64,
    /// [ms] A pair is given out after this long, the best so far, where a better one may come.
    pub max_delay_ms: f64,
    /// [-] The processors its loop may run on; all where empty.
    pub cpu_affinity: Vec<usize>,
}

impl Default for PairingParameters {
    fn default() -> Self {
        Self {
            policy: Algorithm::Nearest,
            age_penalty: 0.1,
            queue_size: 10,
            slop_ms: 50.0,
            max_age_ms: 500.0,
            max_delay_ms: 100.0,
            cpu_affinity: Vec::new(),
        }
    }
}

/// [-] As many processes as one wake-up channel serves with room to spare.
const PROCESSES_MAX: usize = 24;

/// What `--set NAME.faults.TOPIC.KEY=VALUE` has after the name of the process.
const FAULTS: &str = "faults";

/// The keys of a launch file that the command line can set.
const KEYS: [&str; 7] = ["robot", "clock", "seed", "until", "for_s", "wait", PAIRING];

impl Launch {
    /// Reads the launch file at `path`, as changed by the command line's `sets`, or says everything
    /// that is wrong with both.
    pub fn read(path: &Path, sets: &[Setting]) -> Result<Self, Errors> {
        Self::read_and(path, sets, |_, _| {})
    }

    /// The same, and what else `check` finds wrong: what only this machine can tell.
    pub fn read_and(
        path: &Path,
        sets: &[Setting],
        check: impl FnOnce(&Self, &mut Report<'_>),
    ) -> Result<Self, Errors> {
        let own = sets.iter().filter(|set| KEYS.contains(&set.scope()));
        let mut errors = Errors::default();
        let read = Layers::new().file(path).settings(own).parse_and(|launch: &Self, report| {
            errors = launch.check_faults(sets, !report.is_mended("clock"));
            let pairing = Layers::new().table(&launch.pairing).parse::<PairingParameters>();
            errors.extend(pairing.err().into_iter().flatten());
            check(launch, report);
        });
        let launch = match read {
            Ok(launch) => launch,
            Err(others) => {
                if let Some(mistaken) = mistaken(path) {
                    errors = Errors::default();
                    errors.extend([mistaken]);
                } else {
                    errors.extend(others);
                }
                return Err(errors);
            }
        };
        let processes = launch.process.iter().map(|process| process.name.as_str());
        let scopes: Vec<_> = KEYS.into_iter().chain(processes).collect();
        let strangers = sets.iter().filter(|set| !scopes.contains(&set.scope()));
        errors.extend(strangers.map(|set| set.unknown(&scopes)));
        if errors.is_empty() { Ok(launch) } else { Err(errors) }
    }

    /// The parameters of the process called `name`: the defaults, then its parameter file, then the
    /// launch file, then the command line.
    pub fn parameters<T: Parameters>(&self, name: &str, sets: &[Setting]) -> Result<T, Errors> {
        self.layers(name, sets).parse()
    }

    /// The same, key by key, with the place where each was written.
    pub fn listed<T: Listable>(&self, name: &str, sets: &[Setting]) -> Result<Vec<Listed>, Errors> {
        self.layers(name, sets).listed::<T>()
    }

    fn layers(&self, name: &str, sets: &[Setting]) -> Layers {
        let own = sets.iter().filter_map(|set| set.within(name));
        let own: Vec<_> = own.filter(|set| set.scope() != FAULTS).collect();
        let mut layers = Layers::new();
        if name == PAIRING {
            layers = layers.table(&self.pairing);
        } else if let Some(process) = self.process(name) {
            layers = layers.named(process.parameters_file.as_ref()).table(&process.parameters);
        }
        layers.settings(&own)
    }

    /// What goes wrong on purpose with the topics of the process called `name`, and what else
    /// `check` finds wrong with that.
    pub(crate) fn faults(
        &self,
        name: &str,
        sets: &[Setting],
        check: impl FnOnce(&FaultsByTopic, &mut Report<'_>),
    ) -> Result<FaultsByTopic, Errors> {
        let own = sets.iter().filter_map(|set| set.within(name)?.within(FAULTS));
        let own: Vec<_> = own.collect();
        let process = self.process(name).map(|process| &process.faults);
        process.into_iter().fold(Layers::new(), Layers::table).settings(&own).parse_and(check)
    }

    /// What is wrong with the faults of all processes, apart from their topics, which each process
    /// knows itself.
    fn check_faults(&self, sets: &[Setting], is_clock_known: bool) -> Errors {
        let is_lockstep = is_clock_known && self.clock == Clock::Lockstep;
        let mut errors = Errors::default();
        for process in &self.process {
            let read = self.faults(&process.name, sets, |faults, report| {
                for (topic, _) in faults.iter().filter(|(_, faults)| !faults.is_none()) {
                    if is_lockstep {
                        let help = "run it in real time (--clock realtime)";
                        report.refuse(topic, "would stall a robot in lock-step for good", help);
                    }
                    if !process.is_managed() {
                        let help = "leave it out; nodes of type = \"lifecycle\" have faults";
                        report.refuse(topic, "is sent past our ports", help);
                    }
                }
            });
            errors.extend(read.err().into_iter().flatten());
        }
        errors
    }

    /// How the process called `name` waits.
    pub fn wait(&self, process: Option<&Process>) -> Wait {
        let usual = match self.clock {
            Clock::Lockstep => Wait::Yield,
            Clock::Realtime => Wait::Block,
        };
        process.and_then(|process| process.wait).or(self.wait).unwrap_or(usual)
    }

    /// The processes in the order in which they start; they stop in reverse.
    pub fn start_order(&self) -> Vec<&Process> {
        order::start_order(&self.process).into_iter().map(|index| &self.process[index]).collect()
    }

    /// How scan and odometry are paired, as the file has it.
    pub fn pairing(&self) -> PairingParameters {
        Layers::new().table(&self.pairing).parse().unwrap_or_default()
    }

    /// The process called `name`.
    pub fn process(&self, name: &str) -> Option<&Process> {
        self.process.iter().find(|process| process.name == name)
    }
}

impl Parameters for Launch {
    fn check(&self, report: &mut Report<'_>) {
        if check_name(&self.robot).is_err() {
            report.refuse("robot", "cannot be a name", "use 1 to 32 of a-z, 0-9, '-' and '_'");
        }
        if self.for_s.is_some_and(|seconds| !(seconds.is_finite() && 0.0 < seconds)) {
            report.refuse("for_s", "is no length of time", "give a number of seconds above zero");
        }
        if self.process.is_empty() || PROCESSES_MAX < self.process.len() {
            report.refuse("process", "is no robot", "name 1 to 24 processes");
        }
        let is_lockstep = self.clock == Clock::Lockstep && !report.is_mended("clock");
        for (index, process) in self.process.iter().enumerate() {
            let key = format!("process[{index}].name");
            if check_name(&process.name).is_err() {
                report.refuse(&key, "cannot be a name", "use 1 to 32 of a-z, 0-9, '-' and '_'");
            }
            if RESERVED.contains(&process.name.as_str()) {
                report.refuse(&key, "is taken", "choose a name that no part of the launch has");
            }
            if self.process[..index].iter().any(|other| other.name == process.name) {
                report.refuse(&key, "is the name of two processes", "give each its own");
            }
            if is_lockstep && process.restart != Restart::Never {
                let key = format!("process[{index}].restart");
                let help = "leave it out, or run in real time (clock = \"realtime\")";
                report.refuse(&key, "cannot be in lock-step: what was under way is lost", help);
            }
            process.check(&mut report.within(format!("process[{index}]")));
        }
        order::check(&self.process, report);
    }
}

/// That the file at `path` is another one that belongs to a robot, where it looks so.
fn mistaken(path: &Path) -> Option<config::Error> {
    let table: toml::Table = toml::from_str(&fs::read_to_string(path).ok()?).ok()?;
    let has = |key: &&str| table.contains_key(*key);
    if table.is_empty() || ["robot", "process", "clock", PAIRING].iter().any(has) {
        return None;
    }
    let (looks, help) = if has(&"box") || table.get("start").is_some_and(toml::Value::is_table) {
        ("a world", "give it with --world, and a launch file, such as config/simulation.toml")
    } else {
        ("a node's parameters", "give a launch file, of which this is the `parameters_file`")
    };
    let message = format!("this is no launch file; it looks like {looks}");
    Some(config::Error::new(Place::File(path.to_owned()), "", message, help))
}

/// The one node that is no process of the launch file, and its table there.
const PAIRING: &str = "pairing";

/// Names that mean something else on a command line or in shared memory.
const RESERVED: [&str; 3] = [PAIRING, "supervisor", "wake"];

impl PairingParameters {
    /// As the pairing core knows it, for two topics.
    pub fn config(&self) -> pairing::Config {
        let milliseconds =
            |length: f64| Duration::try_from_secs_f64(length * 1e-3).unwrap_or(Duration::ZERO);
        let policy = match self.policy {
            Algorithm::Nearest => pairing::Policy::Nearest,
            Algorithm::Adaptive => pairing::Policy::Adaptive {
                age_penalty: self.age_penalty,
                period_min: [Duration::ZERO; pairing::TOPICS_MAX],
            },
        };
        pairing::Config {
            policy,
            topics: 2,
            queue_size: self.queue_size,
            slop: milliseconds(self.slop_ms),
            bounds: pairing::Bounds::Limited {
                max_age: milliseconds(self.max_age_ms),
                max_delay: milliseconds(self.max_delay_ms),
            },
        }
    }
}

impl Parameters for PairingParameters {
    fn check(&self, report: &mut Report<'_>) {
        process::check_affinity(&self.cpu_affinity, report);
        let Err(error) = pairing::Pairing::new(&self.config()) else { return };
        let key = match error {
            pairing::ConfigError::QueueSize | pairing::ConfigError::Combinations => "queue_size",
            pairing::ConfigError::AgePenalty => "age_penalty",
            pairing::ConfigError::MaxAge => "max_age_ms",
            pairing::ConfigError::MaxDelay => "max_delay_ms",
            pairing::ConfigError::Slop | pairing::ConfigError::Topics => "slop_ms",
        };
        report.refuse(key, error.to_string(), "leave it out for the default");
    }
}

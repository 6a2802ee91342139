//! The options of `teseo up`, most of which are shorthands for settings of the launch file.

use std::ffi::OsString;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use node::control;

/// What to run, and how.
#[derive(Debug, Clone, Args)]
pub struct Options {
    /// The launch file
    #[arg(value_name = "CONFIG", default_value = "config/simulation.toml")]
    pub config: PathBuf,

    /// World file (simulator.world)
    #[arg(long, value_name = "FILE")]
    pub world: Option<String>,

    /// Start pose, by its name in the world (simulator.start)
    #[arg(long, value_name = "NAME")]
    pub start: Option<String>,

    /// Seed of everything random
    #[arg(long, value_name = "NUMBER")]
    pub seed: Option<u64>,

    /// Whose time the robot lives in
    #[arg(long, value_name = "CLOCK", value_parser = ["lockstep", "realtime"])]
    pub clock: Option<String>,

    /// End after this long, of the robot's own time
    #[arg(long = "for", value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds)]
    pub for_s: Option<f64>,

    /// End when this is reached
    #[arg(long, value_name = "END", value_parser = ["round-trip", "goal"])]
    pub until: Option<String>,

    /// The robot's name: two of one name cannot run at once
    #[arg(long, value_name = "NAME", value_parser = control::robot_name)]
    pub robot: Option<String>,

    /// Set any key of the launch file (`clock=realtime`) or of a process (`simulator.lidar.noise=gazebo`)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,

    /// Also write the report: as JSON to a file whose name ends in .json, or else to a directory, with
    /// all that was noted, as a page to look at
    #[arg(long, value_name = "FILE.json|DIR")]
    pub report: Option<PathBuf>,

    /// Also write a timeline of all processes, a scan's way from ray to wheel in it, for Perfetto; of a
    /// long run, the end
    #[arg(long, value_name = "FILE.json")]
    pub trace: Option<PathBuf>,

    /// Return as soon as the robot is ready, and let it run on; `teseo down` ends it
    #[arg(short, long)]
    pub detach: bool,

    /// Show the robot on this terminal while it runs, and take it down when the screen is left
    #[arg(long, conflicts_with = "detach")]
    pub view: bool,

    /// Also write what nodes print to files in this directory, one for each node
    #[arg(long, value_name = "DIR")]
    pub log_dir: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "the flattened options document themselves")]
    pub log: node::log::Options,
}

impl Options {
    /// The command line of `teseo` that brings the same robot up without a screen.
    pub(crate) fn words(&self) -> Vec<OsString> {
        let mut words: Vec<OsString> = vec!["up".into(), self.config.clone().into()];
        words.extend(self.sets().into_iter().map(|set| format!("--set={set}").into()));
        words.push(format!("--log-format={}", self.log.format.label()).into());
        words.push(format!("--log-level={}", self.log.level).into());
        let files =
            [("--report", &self.report), ("--trace", &self.trace), ("--log-dir", &self.log_dir)];
        for (option, path) in files {
            words.extend(path.iter().flat_map(|path| [option.into(), path.clone().into()]));
        }
        words
    }

    /// Where the report goes as JSON.
    pub(crate) fn report_file(&self) -> Option<PathBuf> {
        let report = self.report.as_ref()?;
        Some(if is_json(report) { report.clone() } else { report.join(REPORT) })
    }

    /// The directory for all that is noted of the run.
    pub(crate) fn records(&self) -> Option<&Path> {
        self.report.as_deref().filter(|report| !is_json(report))
    }

    /// Every setting of the command line as `KEY=VALUE`, the explicit ones last.
    pub(crate) fn sets(&self) -> Vec<String> {
        let quoted = |key: &str, value: &Option<String>| {
            value.as_ref().map(|value| format!("{key}={}", toml_string(value)))
        };
        let shorthands = [
            quoted("simulator.world", &self.world),
            quoted("simulator.start", &self.start),
            self.seed.map(|seed| format!("seed={seed}")),
            quoted("clock", &self.clock),
            self.for_s.map(|seconds| format!("for_s={seconds:?}")),
            quoted("until", &self.until),
            quoted("robot", &self.robot),
        ];
        shorthands.into_iter().flatten().chain(self.sets.iter().cloned()).collect()
    }
}

/// The report's name in the directory of a run's records.
const REPORT: &str = "report.json";

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// A length of time, where there can be one.
fn seconds(typed: &str) -> Result<f64, &'static str> {
    let seconds = typed.parse().ok().filter(|seconds| f64::is_finite(*seconds) && 0.0 < *seconds);
    seconds.ok_or("give a number of seconds above zero")
}

/// As a TOML string, whatever it contains.
fn toml_string(text: &str) -> String {
    let mut quoted = String::from('"');
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            control if control.is_control() => {
                let _ = write!(quoted, "\\u{:04x}", u32::from(control));
            }
            plain => quoted.push(plain),
        }
    }
    quoted.push('"');
    quoted
}

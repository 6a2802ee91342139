//! One process of the robot: what runs, after whom, and what happens when it ends. The words are
//! systemd's and mean what they mean there (systemd.unit(5), systemd.service(5), systemd.exec(5)).

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Deserialize;

use crate::Wait;
use crate::config::{FileName, Report, Table};

/// One process of the robot.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Process {
    /// [-] Its name, and the service it runs where `exec` says nothing else.
    pub name: String,
    /// [-] An executable beside this one, or a path, and its arguments; else the service `name`.
    #[serde(default)]
    pub exec: Vec<String>,
    /// How the supervisor learns where it stands.
    #[serde(default, rename = "type")]
    pub kind: Kind,
    /// How it waits for samples.
    #[serde(default)]
    pub wait: Option<Wait>,
    /// A file of parameters, relative to the launch file.
    #[serde(default)]
    pub parameters_file: Option<FileName>,
    /// Parameters, over those of the file; the process itself knows what they mean.
    #[serde(default)]
    pub parameters: Table,
    /// What goes wrong on purpose with the topics it publishes; see [`crate::faults::Faults`].
    #[serde(default)]
    pub faults: Table,
    /// Those that are active before this one is, and stop after it.
    #[serde(default)]
    pub after: Vec<String>,
    /// The same, and this one does not run without them: where one of them stops, it stops too.
    #[serde(default)]
    pub requires: Vec<String>,
    /// Whether it is started again when it ends by itself.
    #[serde(default)]
    pub restart: Restart,
    /// Who else is started again with it.
    #[serde(default)]
    pub strategy: Strategy,
    /// [ms] Before the second restart in a row; the first is at once.
    #[serde(default = "restart_delay_ms")]
    pub restart_delay_ms: u64,
    /// [ms] The delay grows up to this.
    #[serde(default = "restart_delay_max_ms")]
    pub restart_delay_max_ms: u64,
    /// [-] In so many steps, by equal factors.
    #[serde(default = "restart_steps")]
    pub restart_steps: u32,
    /// [-] Failures within `start_limit_interval_s` after which the robot gives up.
    #[serde(default = "start_limit_burst")]
    pub start_limit_burst: u32,
    /// [s] See `start_limit_burst`.
    #[serde(default = "start_limit_interval_s")]
    pub start_limit_interval_s: u64,
    /// [ms] How long the start and each transition upwards may take, unless the process asks for
    /// more; and how long until its topics carry data.
    #[serde(default = "start_timeout_ms")]
    pub start_timeout_ms: u64,
    /// [ms] How long each transition downwards may take, and the end after SIGTERM, before SIGKILL.
    #[serde(default = "stop_timeout_ms")]
    pub stop_timeout_ms: u64,
    /// [ms] It is killed where its loop does not turn for this long.
    #[serde(default)]
    pub watchdog_ms: Option<u64>,
    /// Whether it drives the wheels. Then it does not die with its supervisor, but is told, and has
    /// 150 ms to bring the robot to rest.
    #[serde(default)]
    pub drives: bool,
    /// Variables of its environment, over the supervisor's own.
    #[serde(default)]
    pub environment: BTreeMap<String, String>,
    /// [-] The processors it may run on; all where empty.
    #[serde(default)]
    pub cpu_affinity: Vec<usize>,
    /// [-] 1 to 99: `SCHED_FIFO` at this priority.
    #[serde(default)]
    pub cpu_scheduling_priority: Option<u32>,
    /// Whether its memory is kept from ever being paged: `true` demands it, `false` forgoes it, and
    /// where nothing is said a process in real time does so if its limit allows.
    #[serde(default)]
    pub memory_lock: Option<bool>,
}

/// How the supervisor learns where a process stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// It is a managed node: configured, activated and stopped by the lifecycle topics.
    #[default]
    Lifecycle,
    /// It is started when its turn to be active comes, and says `READY=1` (`sd_notify(3)`).
    Notify,
    /// It is started when its turn to be active comes, and that is all.
    Simple,
}

/// Whether a process is started again when it ends by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Restart {
    /// The run ends with it.
    #[default]
    Never,
    /// Unless it ended with exit code 0.
    OnFailure,
    /// However it ended.
    Always,
}

/// Who else is started again with a process that failed, after OTP's supervisors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// Those that require it.
    OneForOne,
    /// All that start after it.
    #[default]
    RestForOne,
    /// All.
    All,
}

const fn restart_delay_ms() -> u64 {
    100
}

const fn restart_delay_max_ms() -> u64 {
    5_000
}

const fn restart_steps() -> u32 {
    5
}

const fn start_limit_burst() -> u32 {
    5
}

const fn start_limit_interval_s() -> u64 {
    30
}

const fn start_timeout_ms() -> u64 {
    10_000
}

const fn stop_timeout_ms() -> u64 {
    2_000
}

/// [ms] A watchdog below three of a busy machine's pauses kills the innocent.
const WATCHDOG_MIN_MS: u64 = 300;

/// [ms] An hour: whatever is to take longer is meant to take for ever.
const TIMEOUT_MAX_MS: u64 = 3_600_000;

/// [-] As many processors as the system call's mask has bits.
const CPUS_MAX: usize = 1024;

/// What the supervisor itself says to a process in its environment.
const RESERVED_VARIABLES: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

/// Refuses processors that no machine has.
pub(super) fn check_affinity(cpus: &[usize], report: &mut Report<'_>) {
    for (index, _) in cpus.iter().enumerate().filter(|(_, cpu)| CPUS_MAX <= **cpu) {
        let help = "count processors from 0, as /proc/cpuinfo does";
        report.refuse(format!("cpu_affinity[{index}]"), "names no processor", help);
    }
}

impl Process {
    /// Whether it speaks the lifecycle protocol.
    pub fn is_managed(&self) -> bool {
        self.kind == Kind::Lifecycle
    }

    /// How long its loop may stand still.
    pub fn watchdog(&self) -> Option<Duration> {
        self.watchdog_ms.map(Duration::from_millis)
    }

    /// Says what is wrong with it alone.
    pub(super) fn check(&self, report: &mut Report<'_>) {
        let timeout = "give 1 to 3600000 milliseconds";
        if !(1..=TIMEOUT_MAX_MS).contains(&self.start_timeout_ms) {
            report.refuse("start_timeout_ms", "is no time-out", timeout);
        }
        if !(1..=TIMEOUT_MAX_MS).contains(&self.stop_timeout_ms) {
            report.refuse("stop_timeout_ms", "is no time-out", timeout);
        }
        if self.kind != Kind::Lifecycle && self.exec.is_empty() && !report.is_mended("exec") {
            let help = "say with `exec` what to run; our own services are type = \"lifecycle\"";
            report.refuse("type", "is no service's of ours", help);
        }
        if self.cpu_scheduling_priority.is_some_and(|priority| !(1..=99).contains(&priority)) {
            report.refuse("cpu_scheduling_priority", "is none", "give 1 to 99, or leave it out");
        }
        check_affinity(&self.cpu_affinity, report);
        self.check_watchdog(report);
        self.check_restart(report);
        self.check_environment(report);
    }

    fn check_watchdog(&self, report: &mut Report<'_>) {
        let Some(limit) = self.watchdog_ms else { return };
        if !(WATCHDOG_MIN_MS..=TIMEOUT_MAX_MS).contains(&limit) {
            let help = "give 300 milliseconds or more: a busy machine pauses for longer than less";
            report.refuse("watchdog_ms", "would bite the innocent", help);
        }
        if self.kind == Kind::Simple {
            let help = "leave it out, or say type = \"notify\" and send WATCHDOG=1";
            report.refuse("watchdog_ms", "hears nothing from this type", help);
        }
    }

    fn check_restart(&self, report: &mut Report<'_>) {
        if self.restart_delay_max_ms < self.restart_delay_ms {
            let help = "give at least `restart_delay_ms`";
            report.refuse("restart_delay_max_ms", "is below the first delay", help);
        }
        let numbers = [
            ("restart_steps", u64::from(self.restart_steps)),
            ("start_limit_burst", u64::from(self.start_limit_burst)),
            ("start_limit_interval_s", self.start_limit_interval_s),
        ];
        for (key, number) in numbers {
            if !(1..=3_600).contains(&number) {
                report.refuse(key, "is out of range", "give 1 to 3600");
            }
        }
    }

    fn check_environment(&self, report: &mut Report<'_>) {
        for (name, value) in &self.environment {
            let key = format!("environment.{name}");
            let is_word = !name.is_empty()
                && !name.starts_with(|first: char| first.is_ascii_digit())
                && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
            if !is_word || value.contains('\0') {
                report.refuse(&key, "is no variable", "use letters, digits and '_' in its name");
            }
            if RESERVED_VARIABLES.contains(&name.as_str()) || name.starts_with("TESEO_") {
                report.refuse(&key, "is the supervisor's to set", "leave it out");
            }
        }
    }
}

//! The card: on which machine, in which state, figures were measured.

use std::fmt::Write;
use std::fs;

use serde::{Deserialize, Serialize};

use crate::busy::read;

/// What a sceptic asks first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Card {
    /// The processor's model.
    pub cpu: String,
    /// [-] Processors that this process may run on.
    pub cores: usize,
    /// Who chooses the processors' frequency; a virtual machine is not told.
    pub governor: String,
    /// The kernel's release.
    pub kernel: String,
    /// Whether a hypervisor lies below.
    pub virtual_machine: bool,
    /// What the kernel makes its time of.
    pub clock_source: String,
    /// [-] Processes that wanted to run, over the last minute, before anything was measured.
    pub load_before: f64,
    /// [-] The same afterwards: our own are in it.
    pub load_after: f64,
    /// [-] Share of the processors' time that went to others, over all rounds.
    pub foreign: f64,
    /// [-] Share of the processors' time that the host took, over all rounds.
    pub steal: f64,
    /// This program's version, and how it was built.
    pub teseo: String,
    /// The transport's version.
    pub iceoryx2: String,
    /// The compiler that built it.
    pub rustc: String,
}

/// The transport's version; a test compares it with what the workspace asks for.
pub(crate) const ICEORYX2: &str = "0.10.0";

impl Card {
    /// Of this machine, before anything is measured on `cores`.
    pub(crate) fn of_this_machine(cores: usize) -> Self {
        let information = read("/proc/cpuinfo");
        let field = |name: &str| {
            let line = information.lines().find(|line| line.starts_with(name));
            line.and_then(|line| line.split_once(':')).map(|(_, value)| value.trim().to_owned())
        };
        let build = if cfg!(debug_assertions) { "debug build" } else { "release build" };
        Self {
            cpu: field("model name").or_else(|| field("Model")).unwrap_or_else(unknown),
            cores,
            governor: first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
            kernel: first_line("/proc/sys/kernel/osrelease"),
            virtual_machine: field("flags").is_some_and(|flags| flags.contains("hypervisor")),
            clock_source: first_line(
                "/sys/devices/system/clocksource/clocksource0/current_clocksource",
            ),
            load_before: load(),
            load_after: 0.0,
            foreign: 0.0,
            steal: 0.0,
            teseo: format!("{}, {build}", env!("CARGO_PKG_VERSION")),
            iceoryx2: ICEORYX2.to_owned(),
            rustc: env!("BENCH_RUSTC").to_owned(),
        }
    }

    /// [-] Processes that want to run, over the last minute.
    pub(crate) fn note_load_after(&mut self) {
        self.load_after = load();
    }

    /// Whether figures of the two can be compared at all.
    pub(crate) fn is_same_machine(&self, other: &Self) -> bool {
        self.cpu == other.cpu && self.cores == other.cores
    }

    /// For a person.
    pub(crate) fn write(&self, text: &mut String) {
        let guest = if self.virtual_machine { ", in a virtual machine" } else { "" };
        let _ = writeln!(text, "processor     {}, {} cores{guest}", self.cpu, self.cores);
        let _ = writeln!(
            text,
            "kernel        {}, clock source {}, governor {}",
            self.kernel, self.clock_source, self.governor
        );
        let _ = writeln!(
            text,
            "busy          load {:.2} before, {:.2} after; others took {:.0} % of the processors, \
             the host {:.1} %",
            self.load_before,
            self.load_after,
            self.foreign * 100.0,
            self.steal * 100.0
        );
        let _ = writeln!(
            text,
            "versions      teseo {}; iceoryx2 {}; {}",
            self.teseo, self.iceoryx2, self.rustc
        );
    }
}

fn load() -> f64 {
    let load = read("/proc/loadavg");
    load.split_whitespace().next().and_then(|load| load.parse().ok()).unwrap_or_default()
}

fn first_line(path: &str) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines().next().map(str::to_owned).filter(|line| !line.is_empty()).unwrap_or_else(unknown)
}

fn unknown() -> String {
    "unknown".to_owned()
}

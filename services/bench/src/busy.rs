//! How busy others kept the machine while something was measured.

use std::fs;

use serde::{Deserialize, Serialize};

/// [-] Of the processors' time; a round in which others took more is contaminated.
pub(crate) const FOREIGN_MAX: f64 = 0.10;

/// [-] Of the processors' time; a round in which the host took more is contaminated.
pub(crate) const STEAL_MAX: f64 = 0.02;

/// [1/100 s] Less than this cannot be told from the counters' own coarseness.
const TICKS_MIN: f64 = 3.0;

/// What others did meanwhile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Others {
    /// [-] Share of the processors' time that went to processes that are none of ours.
    pub foreign: f64,
    /// [-] Share of the processors' time that the host took.
    pub steal: f64,
    /// Whether that is too much for the figure to be believed.
    pub contaminated: bool,
}

/// The processors' time so far, in hundredths of a second.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Watch {
    total: f64,
    busy: f64,
    steal: f64,
    own: f64,
}

impl Watch {
    /// Begins to watch.
    pub(crate) fn start() -> Self {
        Self::of(&read("/proc/stat"), &read("/proc/self/stat"))
    }

    /// What others have done since then. Our own processes have to be reaped by now.
    pub(crate) fn others(&self) -> Others {
        self.others_until(Self::start())
    }

    fn of(machine: &str, own: &str) -> Self {
        let columns = machine.lines().next().unwrap_or_default().split_whitespace().skip(1);
        let columns: Vec<f64> = columns.filter_map(|column| column.parse().ok()).collect();
        let column = |index: usize| columns.get(index).copied().unwrap_or_default();
        // user, nice, system, idle, iowait, irq, softirq, steal; guests are users too.
        let busy = [0, 1, 2, 5, 6].map(column).iter().sum::<f64>();
        let (idle, steal) = (column(3) + column(4), column(7));
        // The name of a process may have blanks, but ends with the last bracket.
        let fields = own.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(4);
        let own = fields.filter_map(|field| field.parse::<f64>().ok()).sum();
        Self { total: busy + idle + steal, busy, steal, own }
    }

    fn others_until(&self, end: Self) -> Others {
        let total = (end.total - self.total).max(1.0);
        let foreign = ((end.busy - self.busy) - (end.own - self.own)).max(0.0);
        let steal = (end.steal - self.steal).max(0.0);
        let is_much = |ticks: f64, limit: f64| TICKS_MIN <= ticks && limit < ticks / total;
        Others {
            foreign: (foreign / total).min(1.0),
            steal: (steal / total).min(1.0),
            contaminated: is_much(foreign, FOREIGN_MAX) || is_much(steal, STEAL_MAX),
        }
    }
}

/// A file of the system, or nothing where there is none.
pub(crate) fn read(path: &str) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(machine: [u32; 8], own: [u32; 4]) -> Watch {
        let machine = machine.map(|ticks| ticks.to_string()).join(" ");
        let own = own.map(|ticks| ticks.to_string()).join(" ");
        Watch::of(
            &format!("cpu  {machine} 0 0\n"),
            &format!("7 (a b) c) S 1 1 1 0 0 0 0 0 0 0 {own} 0"),
        )
    }

    #[test]
    fn what_our_own_processes_did_is_not_held_against_the_machine() {
        let others = watch([0; 8], [0; 4])
            .others_until(watch([50, 0, 50, 100, 0, 0, 0, 0], [10, 20, 30, 40]));
        assert_eq!(others, Others::default());
    }

    #[test]
    fn what_others_or_the_host_took_contaminates_a_round() {
        let start = watch([0; 8], [0; 4]);
        let foreign = start.others_until(watch([50, 0, 0, 150, 0, 0, 0, 0], [20, 0, 0, 0]));
        assert!(foreign.contaminated && (foreign.foreign - 0.15).abs() < 1e-9, "{foreign:?}");
        let stolen = start.others_until(watch([50, 0, 0, 140, 0, 0, 0, 10], [50, 0, 0, 0]));
        assert!(stolen.contaminated && (stolen.steal - 0.05).abs() < 1e-9, "{stolen:?}");
    }

    #[test]
    fn the_coarseness_of_the_counters_contaminates_nothing() {
        let others =
            watch([0; 8], [0; 4]).others_until(watch([6, 0, 0, 4, 0, 0, 0, 0], [4, 0, 0, 0]));
        assert!(!others.contaminated && 0.1 < others.foreign, "{others:?}");
    }
}

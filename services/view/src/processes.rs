//! What processes take of the machine, as the kernel tells it: the robot has no part in that.

use std::collections::{BTreeMap, VecDeque};

use interfaces::Stamp;
use node::process;

/// [-] Looks over which a process's share is told: the kernel counts too coarsely for one.
const LOOKS: usize = 5;

/// What each process had used whenever it was looked at lately.
#[derive(Debug, Default)]
pub(crate) struct Processes {
    used: BTreeMap<u32, VecDeque<(Stamp, f64)>>,
}

impl Processes {
    /// [%] Of one processor, over the last few looks; nothing at the first.
    pub(crate) fn cpu_percent(&mut self, now: Stamp, pid: u32) -> Option<f64> {
        let used = process::processor_s(pid)?;
        let looks = self.used.entry(pid).or_default();
        looks.push_back((now, used));
        if LOOKS < looks.len() {
            looks.pop_front();
        }
        let (before, had_used) = *looks.front()?;
        let elapsed = now.since(before).as_secs_f64();
        (0.0 < elapsed).then(|| (used - had_used) / elapsed * 100.0)
    }

    /// Forgets those that are no more.
    pub(crate) fn keep(&mut self, pids: &[u32]) {
        self.used.retain(|pid, _| pids.contains(pid));
    }
}

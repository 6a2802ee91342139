//! What processes take of the machine, as the kernel tells it: the robot has no part in that.

use std::collections::{BTreeMap, VecDeque};
use std::fs;

use interfaces::Stamp;

/// [Hz] What `/proc/PID/stat` counts processor time in, on every Linux that there is.
const TICKS_PER_SECOND: f64 = 100.0;

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
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let used = ticks(&stat)? / TICKS_PER_SECOND;
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

/// [KiB] What of a process is in memory.
pub(crate) fn memory_kib(pid: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    value.split_whitespace().next()?.parse().ok()
}

/// [1/100 s] User's and system's time.
fn ticks(stat: &str) -> Option<f64> {
    // After the name, which may contain anything but ends with the last parenthesis.
    let fields = stat.rsplit(')').next()?.split_whitespace();
    let times: Vec<f64> = fields.skip(11).take(2).filter_map(|field| field.parse().ok()).collect();
    (times.len() == 2).then(|| times.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_found_whatever_the_process_is_called() {
        let stat = "12 (a) b (c) S 1 2 3 4 5 6 7 8 9 10 30 12 0 0 20 0 1";

        assert_eq!(ticks(stat), Some(42.0));
        assert_eq!(ticks("12 (a) S 1"), None);
    }
}

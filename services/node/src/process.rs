//! What a process takes of the machine, as the kernel tells it.

use std::fs;

/// [Hz] What `/proc/PID/stat` counts processor time in, on every Linux that there is.
const TICKS_PER_SECOND: f64 = 100.0;

/// [KiB] A process's memory by one row of its `/proc/PID/status`, such as `VmRSS:`.
pub fn memory_kib(pid: u32, row: &str) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix(row))?;
    value.split_whitespace().next()?.parse().ok()
}

/// [s] What a process has used of processors so far, the kernel's work for it included.
pub fn processor_s(pid: u32) -> Option<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    Some(ticks(&stat)? / TICKS_PER_SECOND)
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

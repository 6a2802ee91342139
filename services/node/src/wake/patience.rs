//! For how long looking is worth it before going to sleep.

use std::time::Duration;

/// About what it costs to be woken from sleep on another core: to look for longer can cost more than
/// twice as much as to sleep at once, whatever comes (Karlin et al. 1990, competitive snooping).
const LENGTH_MAX: Duration = Duration::from_micros(50);

/// So short that it costs nothing.
const LENGTH_MIN: Duration = Duration::from_micros(1);

/// [-] Of so many waits one looks for the longest, to learn whether things have changed.
const PROBE: u32 = 32;

/// For how long a process looks before it sleeps: twice as long whenever something came meanwhile,
/// half as long whenever nothing did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Patience {
    length: Duration,
    /// [-] Waits since the last probe.
    waits: u32,
}

impl Default for Patience {
    fn default() -> Self {
        Self { length: LENGTH_MAX, waits: 0 }
    }
}

impl Patience {
    /// For how long to look now.
    pub(crate) fn length(self) -> Duration {
        if self.is_probe() { LENGTH_MAX } else { self.length }
    }

    /// What is known after one more wait.
    pub(crate) fn after(self, found: bool) -> Self {
        let length = match (found, self.is_probe()) {
            (true, true) => LENGTH_MAX,
            (true, false) => (self.length * 2).min(LENGTH_MAX),
            (false, true) => self.length,
            (false, false) => (self.length / 2).max(LENGTH_MIN),
        };
        Self { length, waits: (self.waits + 1) % PROBE }
    }

    const fn is_probe(self) -> bool {
        self.waits == PROBE - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The time spent looking in `waits` waits, if something comes `delay` after each began.
    fn looked(patience: &mut Patience, waits: u32, delay: Duration) -> Duration {
        (0..waits)
            .map(|_| {
                let length = patience.length();
                *patience = patience.after(delay <= length);
                length.min(delay)
            })
            .sum()
    }

    #[test]
    fn where_samples_come_soon_they_are_waited_for_awake() {
        let mut patience = Patience::default();
        let delay = Duration::from_micros(20);
        looked(&mut patience, 1000, delay);
        assert_eq!(looked(&mut patience, 1000, delay), delay * 1000);
    }

    #[test]
    fn where_they_come_late_next_to_nothing_is_spent_on_looking() {
        let mut patience = Patience::default();
        looked(&mut patience, 100, Duration::from_millis(50));
        let spent = looked(&mut patience, 32_000, Duration::from_millis(50));
        assert!(spent < Duration::from_micros(3) * 32_000, "{spent:?}");
    }

    // Broken on purpose: without probes, who had once lost his patience never found it again.
    #[test]
    fn a_change_is_noticed_either_way() {
        let mut patience = Patience::default();
        for (delay, expected) in [(50_000, LENGTH_MIN), (10, LENGTH_MAX), (50_000, LENGTH_MIN)] {
            looked(&mut patience, 2 * PROBE, Duration::from_micros(delay));
            assert_eq!(patience.length, expected, "{delay} us");
        }
    }
}

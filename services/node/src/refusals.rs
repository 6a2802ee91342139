//! Input that a node refuses: counted by reason, told when it begins and when it is over.

use crate::{Gauge, Node};

/// [-] Good samples in a row that end a spell of refusals: a second of the lab's 20 Hz. Where every
/// other sample is bad, that is one story and not ten lines a second.
const CALM: u32 = 20;

/// What a node refuses of its input.
#[derive(Debug)]
pub struct Refusals {
    counts: Vec<(&'static str, Gauge)>,
    /// [-] Refused in this spell; zero where there is none.
    refused: u64,
    /// [-] Good ones since the last that was refused.
    good: u32,
}

impl Refusals {
    /// Counts in gauges `KIND_LABEL`, one for each reason.
    pub fn new(
        node: &mut Node<'_>,
        kind: &str,
        labels: impl IntoIterator<Item = &'static str>,
    ) -> Self {
        let gauge = |label| (label, node.gauge(&format!("{kind}_{label}")));
        Self { counts: labels.into_iter().map(gauge).collect(), refused: 0, good: 0 }
    }

    /// One more, for the reason with this number; true where a spell begins with it.
    pub fn refuse(&mut self, number: usize) -> bool {
        let (reason, count) = &self.counts[number];
        count.count();
        self.good = 0;
        self.refused += 1;
        if self.refused == 1 {
            tracing::warn!(reason, "refuses its input");
        }
        self.refused == 1
    }

    /// A good one; true where a spell is over with it.
    pub fn accept(&mut self) -> bool {
        if self.refused == 0 {
            return false;
        }
        self.good += 1;
        if self.good < CALM {
            return false;
        }
        tracing::info!(refused = self.refused, "takes its input again");
        self.refused = 0;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusals() -> Refusals {
        let counts = ["blind", "old"].map(|label| (label, Gauge::default())).to_vec();
        Refusals { counts, refused: 0, good: 0 }
    }

    #[test]
    fn a_spell_is_told_twice_however_long_and_counted_by_reason() {
        let mut refusals = refusals();
        assert!(!refusals.accept());
        assert!(refusals.refuse(0));
        for _ in 0..100 {
            assert!(!refusals.refuse(1) && !refusals.accept());
        }
        let over = (0..100).filter(|_| refusals.accept()).count();
        assert_eq!(over, 1);
        assert!(refusals.refuse(1));

        let counts = refusals.counts.iter().map(|(_, count)| count.get().to_bits());
        assert!(counts.eq([1.0_f64, 101.0].map(f64::to_bits)));
    }
}

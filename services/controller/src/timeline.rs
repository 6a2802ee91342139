//! Notices that the clock behind a stream of samples was set back.

use std::time::Duration;

use interfaces::{Header, Stamp};

/// The stamps of one stream.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Timeline {
    /// [-] Life of the publisher; a new one starts time anew.
    epoch: u32,
    /// [ns] The newest stamp.
    newest: Stamp,
    /// [ns] The last stamp, where that was far behind.
    behind: Option<Stamp>,
}

/// Two of the lab's periods: a clock that was less ahead has caught up by then.
const LAG_MAX: Duration = Duration::from_millis(100);

impl Timeline {
    /// Takes the next stamp, and says whether it is on a clock that was set back.
    ///
    /// One sample may have been held up. Two in a row that are far behind, and themselves in order,
    /// mean that the clock is back there to stay, or was wrong before.
    pub(crate) fn turns_back(&mut self, header: &Header) -> bool {
        let stamp = header.stamp;
        if header.epoch != self.epoch {
            *self = Self { epoch: header.epoch, newest: stamp, behind: None };
            return false;
        }
        if self.newest.since(stamp) <= LAG_MAX {
            self.newest = self.newest.max(stamp);
            self.behind = None;
            return false;
        }
        let before = self.behind.replace(stamp);
        let turns_back = before.is_some_and(|before| before < stamp);
        if turns_back {
            self.newest = stamp;
            self.behind = None;
        }
        turns_back
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::stamp;

    /// The stamps, in ms, at which the clock turns back.
    fn turns(stamps: &[u64]) -> Vec<u64> {
        let mut timeline = Timeline::default();
        let header = |at| Header { stamp: stamp(at), epoch: 1, ..Header::default() };
        stamps.iter().copied().filter(|&at| timeline.turns_back(&header(at))).collect()
    }

    #[test]
    fn the_second_stamp_after_a_step_back_is_believed() {
        const HOUR: u64 = 3_600_000;
        let none: [u64; 0] = [];
        assert_eq!(turns(&[1000, 1050, 1100]), none);
        assert_eq!(turns(&[1000, HOUR, 1050, 1100, 1150]), [1100]);
        assert_eq!(turns(&[HOUR, 0, 50, 100]), [50]);
        // Held up, one by one; repeated; the same moment for ever.
        assert_eq!(turns(&[1000, 850, 1050, 950, 1100]), none);
        assert_eq!(turns(&[1000, 1000, 950, 1000]), none);
        assert_eq!(turns(&[1000, 0, 0, 0]), none);
    }

    #[test]
    fn a_new_life_is_no_step_back() {
        let mut timeline = Timeline::default();
        for (at, epoch) in [(9000, 1), (50, 2), (100, 2)] {
            let header = Header { stamp: stamp(at), epoch, ..Header::default() };
            assert!(!timeline.turns_back(&header));
        }
    }
}

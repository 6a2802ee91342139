//! When a reading was true: the board's clock, told by ours.

use std::time::Duration;

use interfaces::Stamp;

/// [-] Readings over which the quickest is looked for: two seconds of the board's 50 Hz. Two crystals
/// drift apart by less than 0.2 ms meanwhile.
const WINDOW: u32 = 100;

/// The board's milliseconds on our clock.
///
/// A reading comes some time after it was true, and how long is different each time. The shortest
/// way in a while is taken for the way itself, so stamps are as even as the board's own clock.
#[derive(Debug, Clone, Default)]
pub struct BoardClock {
    last: Option<u32>,
    /// [ms] The board's time without its wraps.
    millis: u64,
    /// [-] Readings of this window so far.
    count: u32,
    /// [ns] Ours less the board's, at the least: in the window before, and in this one.
    least: [Option<i128>; 2],
}

/// What a reading's milliseconds say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// It is newer than the one before, and was true then.
    New(Stamp),
    /// The board has gathered nothing since the one before.
    Same,
    /// The same as `New`, but the board was started meanwhile.
    Restarted(Stamp),
}

/// [ms] A board that is younger than before by more than this was started anew.
const BACKWARDS_MAX: u32 = 1 << 31;

impl BoardClock {
    /// A reading that says `millis` has come by `received`.
    pub fn read(&mut self, millis: u32, received: Stamp) -> Told {
        let Some(last) = self.last.replace(millis) else {
            self.millis = u64::from(millis);
            return Told::New(self.stamp(received));
        };
        let gone = millis.wrapping_sub(last);
        if gone == 0 {
            return Told::Same;
        }
        if BACKWARDS_MAX < gone {
            *self = Self { last: Some(millis), millis: u64::from(millis), ..Self::default() };
            return Told::Restarted(self.stamp(received));
        }
        self.millis += u64::from(gone);
        Told::New(self.stamp(received))
    }

    fn stamp(&mut self, received: Stamp) -> Stamp {
        let board = i128::from(self.millis) * 1_000_000;
        let way = i128::from(received.nanoseconds) - board;
        if self.count == WINDOW {
            self.count = 0;
            self.least = [self.least[1], None];
        }
        self.count += 1;
        self.least[1] = Some(self.least[1].map_or(way, |least| least.min(way)));
        let least = self.least.into_iter().flatten().min().unwrap_or(way);
        let stamp = u64::try_from(board + least).unwrap_or_default();
        Stamp::from_nanoseconds(stamp).min(received)
    }
}

/// A board whose clock stands for longer than this hangs: it gathers anew every 20 ms.
pub const STANDSTILL_MAX: Duration = Duration::from_millis(500);

#[cfg(test)]
mod tests {
    use super::*;

    fn at(micros: u64) -> Stamp {
        Stamp::from_nanoseconds(micros * 1_000)
    }

    // Broken on purpose: with the moment of receipt as stamp, steps were off by up to 9 ms.
    #[test]
    fn stamps_are_as_even_as_the_board_s_clock_however_late_readings_come() {
        let mut clock = BoardClock::default();
        let mut before = None;
        for step in 0..1_000_u64 {
            let millis = u32::try_from(5_000 + 20 * step).unwrap();
            // Ours began elsewhere; the way takes 1 to 10 ms.
            let late = 1_000 + step * 7_919 % 9_000;
            let received = at(77_000_000 + 20_000 * step + late);
            let Told::New(stamp) = clock.read(millis, received) else { panic!("step {step}") };
            assert!(stamp <= received);
            if 200 < step {
                let gone = stamp.since(before.unwrap());
                let off = gone.abs_diff(Duration::from_millis(20));
                assert!(off < Duration::from_micros(500), "step {step}: {gone:?}");
            }
            before = Some(stamp);
        }
    }

    #[test]
    fn what_was_gathered_before_is_told_once() {
        let mut clock = BoardClock::default();
        assert_eq!(clock.read(100, at(9_000)), Told::New(at(9_000)));
        assert_eq!(clock.read(100, at(11_000)), Told::Same);
        assert_eq!(clock.read(120, at(29_000)), Told::New(at(29_000)));
    }

    #[test]
    fn a_clock_that_wraps_goes_on_and_one_that_falls_back_was_started_anew() {
        let mut clock = BoardClock::default();
        clock.read(u32::MAX - 9, at(10_000));
        assert_eq!(clock.read(10, at(30_000)), Told::New(at(30_000)));
        assert_eq!(clock.read(5_000, at(5_020_000)), Told::New(at(5_020_000)));
        assert_eq!(clock.read(40, at(5_100_000)), Told::Restarted(at(5_100_000)));
    }
}

//! Which measurements are believed, and with which one before them each is compared.

use std::fmt;
use std::time::Duration;

use interfaces::{Header, Stamp};

/// Why a measurement is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rejected {
    /// A number is not finite.
    NotFinite,
    /// A number is beyond any robot's.
    TooGreat,
    /// Its stamp is that of the one before.
    Repeated,
    /// Its stamp is before that of the one before.
    Backwards,
    /// Its stamp is farther ahead than measurements may be apart.
    Ahead,
    /// The robot cannot have moved so far since the one before.
    TooFast,
}

impl Rejected {
    /// All of them, in order.
    pub const ALL: [Self; 6] = [
        Self::NotFinite,
        Self::TooGreat,
        Self::Repeated,
        Self::Backwards,
        Self::Ahead,
        Self::TooFast,
    ];

    /// Its name in reports.
    pub const fn label(self) -> &'static str {
        match self {
            Self::NotFinite => "not_finite",
            Self::TooGreat => "too_great",
            Self::Repeated => "repeated",
            Self::Backwards => "backwards",
            Self::Ahead => "ahead",
            Self::TooFast => "too_fast",
        }
    }
}

impl fmt::Display for Rejected {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::NotFinite => "a number is not finite",
            Self::TooGreat => "a number is beyond any robot's",
            Self::Repeated => "a stamp is that of the measurement before",
            Self::Backwards => "stamps run backwards",
            Self::Ahead => "stamps jump ahead",
            Self::TooFast => "the robot cannot move so fast",
        })
    }
}

/// The measurement that the next one is compared with.
///
/// One that does not follow from it is rejected, and remembered as a suspect: if the next does not
/// follow from the good one either, but does from the suspect, then it is the world that has
/// changed, and that one is the base from now on. So one false stamp costs one measurement, and
/// a clock that was really set, an hour that was really lost, or a wheel that was really moved
/// costs one as well. An hour ahead for one measurement and a lost hour look the same at first; the
/// next measurement tells.
#[derive(Debug, Clone)]
pub(crate) struct Continuity<T> {
    gap_max: Duration,
    good: Option<Measured<T>>,
    suspect: Option<Measured<T>>,
    rebases: u64,
}

#[derive(Debug, Clone, Copy)]
struct Measured<T> {
    stamp: Stamp,
    epoch: u32,
    value: T,
}

/// What a measurement that is believed follows from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Base<T> {
    /// Nothing: it is the first in this life of its publisher.
    None,
    /// The one before it.
    Last { value: T, dt: f64 },
    /// The suspect before it. `lost` is the last good one, if only the stamps have jumped since.
    Suspect { value: T, dt: f64, lost: Option<T> },
}

impl<T: Copy> Continuity<T> {
    pub(crate) fn new(gap_max: Duration) -> Self {
        Self { gap_max, good: None, suspect: None, rebases: 0 }
    }

    /// [-] Times that a suspect became the base.
    pub(crate) fn rebases(&self) -> u64 {
        self.rebases
    }

    /// Decides about the next measurement; `is_possible` says whether a robot can get from one to
    /// the other within so many seconds.
    pub(crate) fn judge(
        &mut self,
        header: &Header,
        value: T,
        is_possible: impl Fn(&T, &T, f64) -> bool,
    ) -> Result<Base<T>, Rejected> {
        let measured = Measured { stamp: header.stamp, epoch: header.epoch, value };
        let Some(good) = self.good.filter(|good| good.epoch == measured.epoch) else {
            self.believe(measured);
            return Ok(Base::None);
        };
        let why = match self.follows(&good, &measured, &is_possible) {
            Ok(dt) => {
                self.believe(measured);
                return Ok(Base::Last { value: good.value, dt });
            }
            Err(why) => why,
        };
        let suspect = self.suspect.filter(|suspect| suspect.epoch == measured.epoch);
        if let Some(suspect) = suspect
            && let Ok(dt) = self.follows(&suspect, &measured, &is_possible)
        {
            self.rebases += 1;
            self.believe(measured);
            let is_moved = why == Rejected::TooFast
                || !is_possible(&good.value, &value, self.gap_max.as_secs_f64());
            let lost = (!is_moved).then_some(good.value);
            return Ok(Base::Suspect { value: suspect.value, dt, lost });
        }
        if why != Rejected::Repeated {
            self.suspect = Some(measured);
        }
        Err(why)
    }

    fn believe(&mut self, measured: Measured<T>) {
        self.good = Some(measured);
        self.suspect = None;
    }

    /// [s] By how much `later` is later.
    fn follows(
        &self,
        earlier: &Measured<T>,
        later: &Measured<T>,
        is_possible: impl Fn(&T, &T, f64) -> bool,
    ) -> Result<f64, Rejected> {
        if later.stamp == earlier.stamp {
            return Err(Rejected::Repeated);
        }
        if later.stamp < earlier.stamp {
            return Err(Rejected::Backwards);
        }
        let gap = later.stamp.since(earlier.stamp);
        if self.gap_max < gap {
            return Err(Rejected::Ahead);
        }
        let dt = gap.as_secs_f64();
        if is_possible(&earlier.value, &later.value, dt) { Ok(dt) } else { Err(Rejected::TooFast) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: u64 = 3_600_000;

    /// What becomes of each of these (ms, place), at no more than one place in 10 ms.
    #[track_caller]
    fn expect(steps: &[(u64, u32, &str)]) {
        let mut continuity = Continuity::new(Duration::from_secs(1));
        for &(at, place, expected) in steps {
            let stamp = Stamp::from_nanoseconds(at * 1_000_000);
            let header = Header { stamp, epoch: 1, ..Header::default() };
            let base = continuity
                .judge(&header, place, |&from, &to, dt| f64::from(from.abs_diff(to)) <= 100.0 * dt);
            let told = match base {
                Ok(Base::None) => "first".to_owned(),
                Ok(Base::Last { value, .. }) => format!("{value}"),
                Ok(Base::Suspect { value, lost: None, .. }) => format!("suspect {value}"),
                Ok(Base::Suspect { value, lost: Some(lost), .. }) => {
                    format!("suspect {value}, lost {lost}")
                }
                Err(why) => why.label().to_owned(),
            };
            assert_eq!(told, expected, "{place} at {at}");
        }
    }

    #[test]
    fn reasons_are_listed_in_the_order_of_their_numbers() {
        for (number, rejected) in Rejected::ALL.into_iter().enumerate() {
            assert_eq!(rejected as usize, number);
        }
    }

    #[test]
    fn one_false_stamp_costs_one_measurement() {
        for (jumped, reason) in [
            (HOUR, "ahead"),
            (u64::MAX / 1_000_000, "ahead"),
            (1_101, "ahead"),
            (0, "backwards"),
            (99, "backwards"),
        ] {
            expect(&[(50, 0, "first"), (100, 5, "0"), (jumped, 10, reason), (150, 10, "5")]);
        }
        expect(&[(50, 0, "first"), (50, 1, "repeated"), (50, 2, "repeated"), (100, 5, "0")]);
    }

    #[test]
    fn a_clock_that_was_set_is_believed_at_the_second_measurement() {
        let start = 2 * HOUR;
        for (jumped, reason) in [(start + HOUR, "ahead"), (HOUR, "backwards"), (0, "backwards")] {
            expect(&[
                (start, 0, "first"),
                (jumped, 5, reason),
                (jumped + 50, 10, "suspect 5, lost 0"),
                (jumped + 100, 15, "10"),
            ]);
        }
    }

    #[test]
    fn stamps_that_jump_ahead_and_back_again_cost_only_those_that_jumped() {
        expect(&[
            (0, 0, "first"),
            (HOUR, 5, "ahead"),
            (100, 10, "0"),
            (HOUR + 100, 15, "ahead"),
            (200, 20, "10"),
        ]);
    }

    #[test]
    fn one_false_place_costs_one_measurement_and_a_new_place_another() {
        expect(&[(50, 0, "first"), (100, 900, "too_fast"), (150, 10, "0")]);
        // Not moved there: the way between is not known.
        expect(&[(50, 0, "first"), (100, 20, "too_fast"), (150, 25, "suspect 20")]);
    }

    #[test]
    fn after_a_long_gap_only_a_way_that_is_possible_is_known() {
        expect(&[(0, 0, "first"), (5_000, 60, "ahead"), (5_050, 60, "suspect 60, lost 0")]);
        expect(&[(0, 0, "first"), (5_000, 200, "ahead"), (5_050, 200, "suspect 200")]);
    }
}

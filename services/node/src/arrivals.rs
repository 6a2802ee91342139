//! Which samples of a publisher have come, by number: what is missing, late, or there twice.

/// The numbers that have come of one life of a publisher.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Arrivals {
    first: u64,
    next: u64,
    /// Bit 0 stands for the number before `next`, bit 1 for the one before that, and so on.
    come: u64,
}

/// What a sample's number says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// It is the newest, and so many before it have not come.
    Newest {
        /// [-] Numbers left out.
        missing: u64,
    },
    /// It was counted as missing before.
    Late,
    /// It has come before, or is so old that nobody knows.
    Again,
}

impl Arrivals {
    /// `first` is the first that has come: of those before it none is missed.
    pub(crate) fn from(first: u64) -> Self {
        Self { first, next: first.saturating_add(1), come: 1 }
    }

    /// One more has come.
    pub(crate) fn note(&mut self, number: u64) -> Arrival {
        let Some(age) = self.next.checked_sub(number.saturating_add(1)) else {
            let missing = number - self.next;
            let shift = u32::try_from(missing.saturating_add(1)).unwrap_or(u32::MAX);
            self.come = self.come.checked_shl(shift).unwrap_or(0) | 1;
            self.next = number.saturating_add(1);
            return Arrival::Newest { missing };
        };
        let bit = u32::try_from(age).ok().and_then(|age| 1_u64.checked_shl(age)).unwrap_or(0);
        if bit == 0 || self.come & bit != 0 {
            return Arrival::Again;
        }
        self.come |= bit;
        if number < self.first { Arrival::Newest { missing: 0 } } else { Arrival::Late }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the numbers after the first one say.
    fn note(numbers: &[u64]) -> Vec<Arrival> {
        let mut arrivals = Arrivals::from(numbers[0]);
        numbers[1..].iter().map(|&number| arrivals.note(number)).collect()
    }

    const NEWEST: Arrival = Arrival::Newest { missing: 0 };

    #[test]
    fn numbers_in_order_miss_nothing() {
        assert_eq!(note(&[7, 8, 9]), [NEWEST; 2]);
    }

    #[test]
    fn a_gap_is_missing_until_it_comes() {
        let two_missing = Arrival::Newest { missing: 2 };
        assert_eq!(note(&[0, 3, 2, 4, 1]), [two_missing, Arrival::Late, NEWEST, Arrival::Late]);
    }

    #[test]
    fn what_comes_twice_is_told_however_late() {
        assert_eq!(
            note(&[0, 0, 1, 0, 1]),
            [Arrival::Again, NEWEST, Arrival::Again, Arrival::Again]
        );
        assert_eq!(note(&[0, 2, 1, 1])[2], Arrival::Again);
        // Nobody remembers so far back.
        assert_eq!(note(&[0, 100, 1])[1], Arrival::Again);
        assert_eq!(note(&[0, 64, 1])[1], Arrival::Late);
    }

    #[test]
    fn what_precedes_the_first_was_never_missing() {
        assert_eq!(note(&[5, 4, 4]), [NEWEST, Arrival::Again]);
    }

    #[test]
    fn no_number_is_too_large() {
        let all_missing = Arrival::Newest { missing: u64::MAX - 1 };
        assert_eq!(note(&[0, u64::MAX, u64::MAX])[0], all_missing);
    }
}

//! Where every sample of a topic went.

/// Why a sample is in no pair.
///
/// The cause comes before the occasion: a sample that is evicted, or becomes too old, when nothing
/// could have matched it any more has [`Reason::NoPartner`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Reason {
    /// Another topic went past its window without a sample inside.
    NoPartner,
    /// A partner within its window was paired with a better, or an earlier, sample.
    Superseded,
    /// Its partner may be among those that another topic's full queue dropped.
    PartnerLost,
    /// It waited for `max_age`, and a topic was still silent.
    TooOld,
    /// The queue was full, and a partner might still have come.
    Overflow,
    /// It was behind its predecessors: too late for `adaptive`, or for a full queue.
    OutOfOrder,
    /// A later sample with the same stamp took its place.
    Replaced,
    /// The clock ran backwards, and it was from before.
    Reset,
    /// Its stamp is beyond any clock.
    NoStamp,
}

impl Reason {
    /// [-] How many there are.
    pub const COUNT: usize = Self::ALL.len();

    /// All of them, in order.
    pub const ALL: [Self; 9] = [
        Self::NoPartner,
        Self::Superseded,
        Self::PartnerLost,
        Self::TooOld,
        Self::Overflow,
        Self::OutOfOrder,
        Self::Replaced,
        Self::Reset,
        Self::NoStamp,
    ];

    /// Its name in reports.
    pub const fn label(self) -> &'static str {
        match self {
            Self::NoPartner => "no_partner",
            Self::Superseded => "superseded",
            Self::PartnerLost => "partner_lost",
            Self::TooOld => "too_old",
            Self::Overflow => "overflow",
            Self::OutOfOrder => "out_of_order",
            Self::Replaced => "replaced",
            Self::Reset => "reset",
            Self::NoStamp => "no_stamp",
        }
    }
}

/// One topic's account.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Books {
    /// [-] Samples that came in.
    pub received: u64,
    /// [-] Samples that went out in a pair.
    pub paired: u64,
    /// [-] Samples that still wait.
    pub queued: u64,
    pub(super) dropped: [u64; Reason::COUNT],
}

impl Books {
    /// [-] Samples dropped for `reason`.
    pub const fn dropped(&self, reason: Reason) -> u64 {
        self.dropped[reason as usize]
    }

    /// [-] Samples dropped for any reason.
    pub fn dropped_total(&self) -> u64 {
        self.dropped.iter().sum()
    }

    /// Whether every sample is accounted for. It always is.
    pub fn close(&self) -> bool {
        self.received == self.paired + self.dropped_total() + self.queued
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_listed_in_the_order_of_their_numbers() {
        for (number, reason) in Reason::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, number);
        }
    }
}

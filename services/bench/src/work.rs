//! Everything that can be measured.

use node::{Namespace, Result};

use crate::hop::{self, Hop};
use crate::measured::{Collected, Unit, Values};
use crate::pairing::{self, Core};
use crate::ticket::Payload;
use crate::{Effort, Row};

/// One thing to measure; it yields one figure or more.
#[derive(Debug)]
pub(crate) enum Work {
    /// One hop.
    Hop(Hop),
    /// What a sample costs the pairing.
    Core(Core),
    /// A pair by ticket.
    Ticket(Payload),
}

/// All of `rows`, or of every row where there are none, and what is left out, with the reason.
pub(crate) fn configurations(rows: &[Row], cores: usize) -> (Vec<Work>, Vec<String>) {
    let (mut works, mut absent) = (Vec::new(), Vec::new());
    let is_asked = |row| rows.is_empty() || rows.contains(&row);
    if is_asked(Row::Hop) {
        let (hops, left_out) = hop::configurations(cores);
        works.extend(hops.into_iter().map(Work::Hop));
        absent.extend(left_out);
    }
    if is_asked(Row::Pair) {
        works.extend(pairing::configurations().into_iter().map(Work::Core));
        works.extend(Payload::ALL.map(Work::Ticket));
    }
    (works, absent)
}

impl Work {
    /// A place for each figure that [`Work::measure`] yields.
    pub(crate) fn collected(&self) -> Vec<Collected> {
        let collected = |row, name| Collected::new(row, name, Unit::Nanoseconds);
        match self {
            Self::Hop(hop) => vec![collected("hop", hop.name())],
            Self::Core(core) => vec![collected("pair", core.name())],
            Self::Ticket(payload) => payload.names().map(|name| collected("pair", name)).into(),
        }
    }

    /// One round.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        match self {
            Self::Hop(hop) => Ok(vec![hop.measure(namespace, effort)?]),
            Self::Core(core) => Ok(vec![core.measure()]),
            Self::Ticket(payload) => Ok(payload.measure(namespace, effort)?.into()),
        }
    }
}

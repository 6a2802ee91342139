//! The two sides of a hop: one sends and waits for the answer, the others answer.

use std::time::Duration;

use hdrhistogram::Histogram;
use interfaces::{LaserScan, Stamp};
use node::{Error, Namespace, Result, clock};

use super::{Hop, Size, Way, bytes, ours, plain, raw};
use crate::measured::history;
use crate::payload::{Large, Line, Medium, Words};
use crate::peers::{Part, Role};

/// However long a side waits altogether: by then something is wrong.
pub(super) const LIFE_MAX: Duration = Duration::from_secs(60);

/// [-] Samples before the first that counts: they touch every page, and warm what is warm in a loop.
const WARM_UP: u64 = 64;

/// One side's end of the way.
pub(super) trait Link {
    /// Sends sample `number`, written in full.
    fn send(&mut self, number: u64, stamp: Stamp) -> Result;

    /// Waits for the next sample and reads it in full.
    fn receive(&mut self) -> Result<Arrival>;
}

/// What a sample said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Arrival {
    pub(super) number: u64,
    pub(super) stamp: Stamp,
    /// Whether all that was read is what was written.
    pub(super) intact: bool,
}

/// Whose end it is.
pub(super) struct End<'a> {
    pub(super) hop: &'a Hop,
    pub(super) role: Role,
    /// [-] Samples that count.
    samples: u64,
}

/// What a side does with its end.
pub(super) type Body<'a> = &'a mut dyn FnMut(&mut dyn Link) -> Result<Histogram<u64>>;

/// Plays one part of a hop, and returns what it has measured, if that is its part.
pub(crate) fn play(hop: &Hop, part: &Part, namespace: &Namespace) -> Result<Histogram<u64>> {
    let end = &End { hop, role: part.role, samples: part.samples };
    let body: Body<'_> = &mut |link| match end.role {
        Role::Sender => send(end, link),
        Role::Reader(_) => answer(end, link),
    };
    match hop.way {
        Way::Flag | Way::FlagYield | Way::Futex => raw::with_link(end, namespace, body),
        Way::Pipe => bytes::with_pipes(end, namespace, body),
        Way::Socket => bytes::with_socket(end, namespace, body),
        Way::PlainBare => plain::with_bare_link(end, namespace, body),
        Way::Poll
        | Way::Hybrid
        | Way::Yield
        | Way::Block
        | Way::PlainPoll
        | Way::PlainYield
        | Way::PlainBlock => match hop.size {
            Size::Line => with_samples::<Line>(end, namespace, body),
            Size::Scan => with_samples::<LaserScan>(end, namespace, body),
            Size::Medium => with_samples::<Medium>(end, namespace, body),
            Size::Large => with_samples::<Large>(end, namespace, body),
        },
    }
}

fn with_samples<T: Words>(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    match end.hop.way.wait() {
        Some(wait) => ours::with_link::<T>(end, namespace, wait, body),
        None => plain::with_link::<T>(end, namespace, body),
    }
}

/// Sends, and waits until all have answered; records half of that where samples follow each other.
fn send(end: &End<'_>, link: &mut dyn Link) -> Result<Histogram<u64>> {
    let mut history = history()?;
    let period = end.hop.pace.period().map(Duration::from_nanos);
    let mut due = clock::now();
    for number in 0..WARM_UP + end.samples {
        if let Some(period) = period.filter(|_| WARM_UP <= number) {
            due = due.after(period).max(clock::now());
            clock::nap(due.since(clock::now()));
        } else {
            due = clock::now();
        }
        let begun = clock::now();
        link.send(number, begun)?;
        for _ in 0..end.hop.readers {
            link.receive()?.check(end.hop, number)?;
        }
        if WARM_UP <= number && period.is_none() {
            history.saturating_record(nanoseconds(clock::now().since(begun)) / 2);
        }
    }
    Ok(history)
}

/// Answers each sample with one of the same size; records how long it was under way where there is
/// a pause before each.
fn answer(end: &End<'_>, link: &mut dyn Link) -> Result<Histogram<u64>> {
    let mut history = history()?;
    let is_paced = end.hop.pace.period().is_some();
    for number in 0..WARM_UP + end.samples {
        let arrival = link.receive()?;
        if is_paced {
            let took = clock::now().since(arrival.stamp);
            if WARM_UP <= number {
                history.saturating_record(nanoseconds(took));
            }
        }
        arrival.check(end.hop, number)?;
        link.send(number, arrival.stamp)?;
    }
    Ok(history)
}

impl Arrival {
    fn check(self, hop: &Hop, number: u64) -> Result {
        if self.number == number && (self.intact || !hop.touched) {
            return Ok(());
        }
        let found = if self.intact { "whole" } else { "damaged" };
        Err(Error::Fault(format!(
            "{}: sample {} came {found}, where {number} was due",
            hop.name(),
            self.number
        )))
    }
}

/// Looks until something has come, but not for ever.
pub(super) fn look<T>(
    until: Stamp,
    pause: impl Fn(),
    mut find: impl FnMut() -> Result<Option<T>>,
) -> Result<T> {
    /// [-] Looks between two at the clock.
    const LOOKS: u32 = 4096;
    loop {
        for _ in 0..LOOKS {
            if let Some(found) = find()? {
                return Ok(found);
            }
            pause();
        }
        check_time(until)?;
    }
}

/// Fails where a side has waited for longer than any measurement takes.
pub(super) fn check_time(until: Stamp) -> Result {
    if until < clock::now() {
        return Err(Error::Fault("the other side is silent".to_owned()));
    }
    Ok(())
}

/// Waits for the other side to be there.
pub(super) fn await_peer(until: Stamp, mut is_there: impl FnMut() -> bool) -> Result {
    const PAUSE: Duration = Duration::from_millis(1);
    while !is_there() {
        check_time(until)?;
        clock::nap(PAUSE);
    }
    Ok(())
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

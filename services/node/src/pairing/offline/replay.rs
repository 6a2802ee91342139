//! Runs one stream through the pairing and keeps what came of it.

use std::collections::BTreeMap;

use interfaces::Stamp;
use serde::Serialize;

use super::super::{Config, Entry, Outcome, Pairing, Reason};
use super::{Algorithm, Event, Options, Stream, StreamError, hints};

/// What came of one stream. Samples are named by the number of the event that brought them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Replay {
    /// The stream's name.
    pub id: String,
    /// The algorithm's name.
    pub policy: &'static str,
    /// [-] Samples that waited at most, per topic.
    pub queue_size: usize,
    /// [ns] Stamps of a match are less than this apart.
    pub slop_ns: u64,
    /// The names of the topics.
    pub topics: Vec<String>,
    /// [-] Samples that arrived.
    pub events: usize,
    /// [ns] The stamps of each match, in the order of the topics.
    pub matches: Vec<Vec<u64>>,
    /// [-] The events of each match, in the order of the topics.
    pub match_events: Vec<Vec<usize>>,
    /// [-] The newest event when each match was found.
    pub match_at: Vec<usize>,
    /// [ns] Between the stamps of each match.
    pub spreads_ns: Vec<u64>,
    /// [ns] From the arrival of its last sample to each match, on the stream's own clock.
    pub delays_ns: Vec<u64>,
    /// The samples that were dropped.
    pub dropped: Vec<Loss>,
    /// [ns] By topic, the stamps that still wait at the end, in the order of the queue.
    pub leftover: Vec<Vec<u64>>,
    /// The account of each topic.
    pub books: BTreeMap<String, TopicBooks>,
    /// [-] Times that the clock ran backwards and the pairing started afresh.
    pub resets: u64,
    /// [-] Matches that a bounded delay forced out.
    pub forced: u64,
    /// What may be wrong with the stream.
    pub hints: Vec<String>,
}

/// A sample that was dropped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Loss {
    /// [-] The event that brought it.
    pub event: usize,
    /// Its topic.
    pub topic: String,
    /// [ns] Its stamp.
    pub stamp_ns: u64,
    /// The reason's name.
    pub reason: &'static str,
    /// [-] The newest event when it was dropped.
    pub at: usize,
}

/// One topic's account: received = paired + dropped + queued.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TopicBooks {
    /// [-] Samples that came in.
    pub received: u64,
    /// [-] Samples that went out in a match.
    pub paired: u64,
    /// [-] Samples that still wait.
    pub queued: u64,
    /// [-] Samples dropped, by reason.
    pub dropped: BTreeMap<&'static str, u64>,
}

/// Runs `stream` through the pairing.
pub fn replay(stream: &Stream, options: &Options) -> Result<Replay, StreamError> {
    let config = stream.config(options)?;
    let mut pairing = Pairing::new(&config).map_err(StreamError::Config)?;
    let algorithm = options.algorithm.unwrap_or_else(|| stream.algorithm());
    let mut replay = Replay::new(stream, &config, algorithm);

    let mut now = Stamp::ZERO;
    for (index, event) in stream.events.iter().enumerate() {
        let (topic, stamp) = placed(stream, index, event)?;
        now = now.max(event.received_ns.map_or(stamp, Stamp::from_nanoseconds));
        while let Some(due) = pairing.next_deadline().filter(|&due| due < now) {
            replay.note(&pairing.poll(due), due, index.saturating_sub(1));
        }
        let entry = Entry { stamp, sequence: index as u64, epoch: 0, received: now };
        replay.note(&pairing.push(topic, entry), now, index);
    }

    replay.close(&pairing);
    replay.hints = hints::hints(stream, &replay);
    Ok(replay)
}

/// An event's topic, by number, and its stamp.
fn placed(stream: &Stream, index: usize, event: &Event) -> Result<(usize, Stamp), StreamError> {
    let topic =
        stream.topics.iter().position(|name| *name == event.topic).ok_or_else(|| {
            StreamError::UnknownTopic { event: index, topic: event.topic.clone() }
        })?;
    let stamp =
        u64::try_from(event.stamp_ns).map_err(|_| StreamError::NegativeStamp { event: index })?;
    Ok((topic, Stamp::from_nanoseconds(stamp)))
}

impl Replay {
    fn new(stream: &Stream, config: &Config, algorithm: Algorithm) -> Self {
        Self {
            id: stream.id.clone(),
            policy: algorithm.label(),
            queue_size: config.queue_size,
            slop_ns: super::super::nanoseconds(config.slop),
            topics: stream.topics.clone(),
            events: stream.events.len(),
            matches: Vec::new(),
            match_events: Vec::new(),
            match_at: Vec::new(),
            spreads_ns: Vec::new(),
            delays_ns: Vec::new(),
            dropped: Vec::new(),
            leftover: Vec::new(),
            books: BTreeMap::new(),
            resets: 0,
            forced: 0,
            hints: Vec::new(),
        }
    }

    fn note(&mut self, outcome: &Outcome<'_>, now: Stamp, at: usize) {
        for pair in outcome.pairs() {
            let members = pair.members.iter();
            self.matches.push(members.clone().map(|member| member.stamp.nanoseconds).collect());
            self.match_events.push(members.map(event_of).collect());
            self.match_at.push(at);
            self.spreads_ns.push(super::super::nanoseconds(pair.spread()));
            self.delays_ns.push(super::super::nanoseconds(now.since(pair.completed())));
        }
        self.dropped.extend(outcome.dropped().iter().map(|dropped| Loss {
            event: event_of(&dropped.entry),
            topic: self.topics[dropped.topic].clone(),
            stamp_ns: dropped.entry.stamp.nanoseconds,
            reason: dropped.reason.label(),
            at,
        }));
    }

    fn close(&mut self, pairing: &Pairing) {
        self.resets = pairing.resets();
        self.forced = pairing.forced();
        for (topic, name) in self.topics.iter().enumerate() {
            let stamps = pairing.queue(topic).map(|entry| entry.stamp.nanoseconds);
            self.leftover.push(stamps.collect());

            let books = pairing.books(topic);
            let counts = Reason::ALL.map(|reason| (reason.label(), books.dropped(reason)));
            let dropped = counts.into_iter().filter(|&(_, count)| 0 < count).collect();
            let (received, paired, queued) = (books.received, books.paired, books.queued);
            self.books.insert(name.clone(), TopicBooks { received, paired, queued, dropped });
        }
    }
}

fn event_of(entry: &Entry) -> usize {
    usize::try_from(entry.sequence).expect("it was an index")
}

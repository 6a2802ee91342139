//! What comes of one step: pairs, dropped samples, and the entries in the books.

use std::time::Duration;

use interfaces::Stamp;

use super::{Books, Config, Reason};

/// What pairing knows of a sample; the payload stays where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Entry {
    /// [ns] When the data was true.
    pub stamp: Stamp,
    /// [-] Its number; carried, not interpreted.
    pub sequence: u64,
    /// [-] Its publisher's life; carried, not interpreted.
    pub epoch: u32,
    /// [ns] When it was received, on the receiver's clock.
    pub received: Stamp,
}

/// Samples that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair<'a> {
    /// One sample of each topic, in the order of the topics.
    pub members: &'a [Entry],
}

impl Pair<'_> {
    /// The newest of the stamps.
    pub fn stamp(&self) -> Stamp {
        self.members.iter().map(|member| member.stamp).max().unwrap_or_default()
    }

    /// Between the oldest and the newest stamp.
    pub fn spread(&self) -> Duration {
        let oldest = self.members.iter().map(|member| member.stamp).min().unwrap_or_default();
        self.stamp().since(oldest)
    }

    /// When the last of the samples was received: the earliest moment for this pair.
    pub fn completed(&self) -> Stamp {
        self.members.iter().map(|member| member.received).max().unwrap_or_default()
    }
}

/// A sample that is in no pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dropped {
    /// [-] Its topic.
    pub topic: usize,
    /// The sample.
    pub entry: Entry,
    /// Why.
    pub reason: Reason,
}

/// What came of one step; read it before the next.
#[derive(Debug, Clone, Copy)]
pub struct Outcome<'a> {
    topics: usize,
    members: &'a [Entry],
    dropped: &'a [Dropped],
}

impl<'a> Outcome<'a> {
    /// The pairs, in the order in which they were found.
    pub fn pairs(&self) -> impl Iterator<Item = Pair<'a>> {
        self.members.chunks_exact(self.topics).map(|members| Pair { members })
    }

    /// The dropped samples.
    pub fn dropped(&self) -> &'a [Dropped] {
        self.dropped
    }
}

/// Collects the outcome of a step and keeps the books.
#[derive(Debug)]
pub(super) struct Ledger {
    topics: usize,
    members: Vec<Entry>,
    dropped: Vec<Dropped>,
    books: Vec<Books>,
}

impl Ledger {
    pub(super) fn new(config: &Config) -> Self {
        // No step can touch more than what is queued and the sample that arrives.
        let capacity = config.topics * config.queue_size + 1;
        Self {
            topics: config.topics,
            members: Vec::with_capacity(capacity),
            dropped: Vec::with_capacity(capacity),
            books: vec![Books::default(); config.topics],
        }
    }

    pub(super) fn topics(&self) -> usize {
        self.topics
    }

    pub(super) fn begin(&mut self) {
        self.members.clear();
        self.dropped.clear();
    }

    pub(super) fn receive(&mut self, topic: usize) {
        self.books[topic].received += 1;
    }

    /// Adds one member to a pair; called once for each topic, in order.
    pub(super) fn pair(&mut self, topic: usize, entry: Entry) {
        debug_assert_eq!(self.members.len() % self.topics, topic, "members come in topic order");
        self.books[topic].paired += 1;
        self.members.push(entry);
    }

    pub(super) fn drop(&mut self, topic: usize, entry: Entry, reason: Reason) {
        self.books[topic].dropped[reason as usize] += 1;
        self.dropped.push(Dropped { topic, entry, reason });
    }

    pub(super) fn outcome(&self) -> Outcome<'_> {
        Outcome { topics: self.topics, members: &self.members, dropped: &self.dropped }
    }

    pub(super) fn books(&self, topic: usize, queued: u64) -> Books {
        Books { queued, ..self.books[topic] }
    }
}

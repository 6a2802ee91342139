//! `nearest`: an arriving sample at once takes the nearest queued partners, as
//! `message_filters.ApproximateTimeSynchronizer` of ROS 2's Python does.
//!
//! Greedy and immediate: a better partner may come later, output may go back in time, and what is
//! left unpaired waits until the queue is full. ROS 2's users know it so.

use std::collections::VecDeque;
use std::ops::Range;

use interfaces::Stamp;

use super::{Config, Entry, Reason, TOPICS_MAX, nanoseconds, outcome::Ledger};

/// Queues of samples in the order of their arrival, each stamp once.
#[derive(Debug)]
pub(super) struct Nearest {
    /// [ns] Stamps of a pair are less than this apart.
    slop: u64,
    /// [-] Samples that a queue holds.
    queue_size: usize,
    queues: Vec<Queue>,
    /// By topic: the arriving sample's possible partners, nearest first.
    candidates: Vec<Vec<Candidate>>,
}

#[derive(Debug)]
struct Queue {
    waiting: VecDeque<Waiting>,
    /// Whether the stamps ascend, so that a search need not look at all of them.
    ascending: bool,
    /// [ns] The greatest stamp that the topic has shown.
    newest: Option<u64>,
    /// [ns] No sample in the queue was received before this.
    oldest_received: u64,
}

#[derive(Debug, Clone, Copy)]
struct Waiting {
    entry: Entry,
    /// Whether a partner within its window went to another sample.
    beaten: bool,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// [ns] Between its stamp and the arriving one; the first to sort by.
    distance: u64,
    /// [-] In the queue; the second to sort by.
    position: usize,
}

/// By topic, the position in its queue.
type Positions = [usize; TOPICS_MAX];

impl Nearest {
    pub(super) fn new(config: &Config) -> Self {
        let queue = |_| Queue {
            // The arriving sample comes in before another one goes.
            waiting: VecDeque::with_capacity(config.queue_size + 1),
            ascending: true,
            newest: None,
            oldest_received: u64::MAX,
        };
        let candidates = |_| Vec::with_capacity(config.queue_size);
        Self {
            slop: nanoseconds(config.slop),
            queue_size: config.queue_size,
            queues: (0..config.topics).map(queue).collect(),
            candidates: (0..config.topics).map(candidates).collect(),
        }
    }

    pub(super) fn retune(&mut self, config: &Config) {
        self.slop = nanoseconds(config.slop);
    }

    pub(super) fn push(&mut self, topic: usize, entry: Entry, ledger: &mut Ledger) {
        let Some(position) = self.insert(topic, entry, ledger) else { return };
        let found = if self.queues.len() == 2 {
            self.find_partner(1 - topic, entry.stamp)
        } else {
            self.find_partners(topic, entry.stamp)
        };
        if let Some(mut chosen) = found {
            chosen[topic] = position;
            self.mark_beaten(topic, entry.stamp);
            for (topic, queue) in self.queues.iter_mut().enumerate() {
                let member = queue.waiting.remove(chosen[topic]).expect("the chosen are queued");
                ledger.pair(topic, member.entry);
            }
        }
    }

    /// Drops what was received before `oldest`.
    pub(super) fn expire(&mut self, oldest: Stamp, ledger: &mut Ledger) {
        for topic in 0..self.queues.len() {
            if oldest.nanoseconds <= self.queues[topic].oldest_received {
                continue;
            }
            let mut position = 0;
            let mut oldest_received = u64::MAX;
            while let Some(&waiting) = self.queues[topic].waiting.get(position) {
                if waiting.entry.received < oldest {
                    self.queues[topic].waiting.remove(position);
                    ledger.drop(topic, waiting.entry, self.cause(topic, &waiting, Reason::TooOld));
                } else {
                    oldest_received = oldest_received.min(waiting.entry.received.nanoseconds);
                    position += 1;
                }
            }
            self.queues[topic].oldest_received = oldest_received;
        }
    }

    /// Drops everything that waits on `topic`, and forgets its stamps.
    pub(super) fn clear(&mut self, topic: usize, ledger: &mut Ledger) {
        let queue = &mut self.queues[topic];
        for waiting in queue.waiting.drain(..) {
            ledger.drop(topic, waiting.entry, Reason::Reset);
        }
        queue.newest = None;
        queue.oldest_received = u64::MAX;
    }

    pub(super) fn queue(&self, topic: usize) -> impl Iterator<Item = &Entry> {
        self.queues[topic].waiting.iter().map(|waiting| &waiting.entry)
    }

    /// Where the sample now is, if it stays: from a full queue the smallest stamp goes, whichever it
    /// is.
    fn insert(&mut self, topic: usize, entry: Entry, ledger: &mut Ledger) -> Option<usize> {
        let queue = &mut self.queues[topic];
        let waiting = Waiting { entry, beaten: false };
        queue.newest = queue.newest.max(Some(entry.stamp.nanoseconds));
        queue.oldest_received = queue.oldest_received.min(entry.received.nanoseconds);

        if let Some(position) = queue.position(entry.stamp) {
            let replaced = std::mem::replace(&mut queue.waiting[position], waiting);
            ledger.drop(topic, replaced.entry, Reason::Replaced);
            return Some(position);
        }
        let last = queue.waiting.back();
        queue.ascending = last.is_none_or(|last| queue.ascending && last.stamp() < waiting.stamp());
        queue.waiting.push_back(waiting);
        if queue.waiting.len() <= self.queue_size {
            return Some(queue.waiting.len() - 1);
        }
        let smallest = queue.smallest();
        let evicted = queue.waiting.remove(smallest).expect("the queue is more than full");
        if smallest == self.queue_size {
            ledger.drop(topic, entry, Reason::OutOfOrder);
            return None;
        }
        ledger.drop(topic, evicted.entry, self.cause(topic, &evicted, Reason::Overflow));
        Some(self.queue_size - 1)
    }

    /// The nearest sample of the one other topic; of two equally near ones, the first to arrive.
    fn find_partner(&self, other: usize, stamp: Stamp) -> Option<Positions> {
        let nearest = self.queues[other].nearest(stamp)?;
        let mut chosen = [0; TOPICS_MAX];
        chosen[other] = nearest.position;
        (nearest.distance < self.slop).then_some(chosen)
    }

    /// The first combination that fits, where the last topic's candidates change fastest.
    fn find_partners(&mut self, topic: usize, stamp: Stamp) -> Option<Positions> {
        for (other, candidates) in self.candidates.iter_mut().enumerate() {
            candidates.clear();
            if other == topic {
                continue;
            }
            let queue = &self.queues[other];
            let near = queue.window(stamp, self.slop);
            candidates.extend(
                near.map(|position| queue.candidate(position, stamp))
                    .filter(|candidate| candidate.distance < self.slop),
            );
            if candidates.is_empty() {
                return None;
            }
            candidates.sort_unstable_by_key(|candidate| (candidate.distance, candidate.position));
        }
        let mut chosen = [0; TOPICS_MAX];
        let stamp = stamp.nanoseconds;
        self.complete(0, topic, (stamp, stamp), &mut chosen).then_some(chosen)
    }

    /// Chooses from the topics from `next` on, so that all stamps are less than the slop apart;
    /// those chosen so far span `low..=high`.
    fn complete(
        &self,
        next: usize,
        arriving: usize,
        (low, high): (u64, u64),
        chosen: &mut Positions,
    ) -> bool {
        if next == self.queues.len() {
            return true;
        }
        if next == arriving {
            return self.complete(next + 1, arriving, (low, high), chosen);
        }
        self.candidates[next].iter().any(|candidate| {
            let stamp = self.queues[next].waiting[candidate.position].stamp();
            let (low, high) = (low.min(stamp), high.max(stamp));
            chosen[next] = candidate.position;
            high - low < self.slop && self.complete(next + 1, arriving, (low, high), chosen)
        })
    }

    /// Notes in the other topics who else could have had the sample that is about to be paired.
    fn mark_beaten(&mut self, topic: usize, stamp: Stamp) {
        for (other, queue) in self.queues.iter_mut().enumerate() {
            if other != topic {
                for waiting in queue.waiting.range_mut(queue.window(stamp, self.slop)) {
                    waiting.beaten |= waiting.distance(stamp) < self.slop;
                }
            }
        }
    }

    /// Why a sample that has left its queue was in no pair, if the `occasion` is not all there is.
    fn cause(&self, topic: usize, waiting: &Waiting, occasion: Reason) -> Reason {
        if waiting.beaten {
            return Reason::Superseded;
        }
        let window_end = waiting.stamp().saturating_add(self.slop);
        let mut others = self.queues.iter().enumerate().filter(|&(other, _)| other != topic);
        let passed_by = others.any(|(_, queue)| {
            let passed = queue.newest.is_some_and(|newest| window_end <= newest);
            let nearest = queue.nearest(waiting.entry.stamp);
            passed && nearest.is_none_or(|nearest| self.slop <= nearest.distance)
        });
        if passed_by { Reason::NoPartner } else { occasion }
    }
}

impl Queue {
    /// Where this very stamp is.
    fn position(&self, stamp: Stamp) -> Option<usize> {
        if self.ascending && self.waiting.back().is_none_or(|last| last.entry.stamp < stamp) {
            return None;
        }
        self.waiting.iter().position(|waiting| waiting.entry.stamp == stamp)
    }

    /// Where the smallest stamp is, in a queue that is not empty.
    fn smallest(&self) -> usize {
        if self.ascending {
            return 0;
        }
        let stamps = self.waiting.iter().map(Waiting::stamp).enumerate();
        stamps.min_by_key(|&(_, stamp)| stamp).map_or(0, |(position, _)| position)
    }

    /// The nearest sample; of two equally near ones, the first to arrive.
    fn nearest(&self, stamp: Stamp) -> Option<Candidate> {
        let positions = if self.ascending {
            let after = self.waiting.partition_point(|waiting| waiting.entry.stamp < stamp);
            after.saturating_sub(1)..self.waiting.len().min(after + 1)
        } else {
            0..self.waiting.len()
        };
        let candidates = positions.map(|position| self.candidate(position, stamp));
        candidates.min_by_key(|candidate| candidate.distance)
    }

    /// Where samples less than `slop` from `stamp` may be.
    fn window(&self, stamp: Stamp, slop: u64) -> Range<usize> {
        if !self.ascending {
            return 0..self.waiting.len();
        }
        let start = stamp.nanoseconds.saturating_sub(slop);
        let end = stamp.nanoseconds.saturating_add(slop);
        self.waiting.partition_point(|waiting| waiting.stamp() < start)
            ..self.waiting.partition_point(|waiting| waiting.stamp() < end)
    }

    fn candidate(&self, position: usize, stamp: Stamp) -> Candidate {
        Candidate { distance: self.waiting[position].distance(stamp), position }
    }
}

impl Waiting {
    fn stamp(&self) -> u64 {
        self.entry.stamp.nanoseconds
    }

    fn distance(&self, stamp: Stamp) -> u64 {
        self.stamp().abs_diff(stamp.nanoseconds)
    }
}

//! `nearest`: an arriving sample at once takes the nearest queued partners, as
//! `message_filters.ApproximateTimeSynchronizer` of ROS 2's Python does.
//!
//! Greedy and immediate: a better partner may come later, output may go back in time, and what is
//! left unpaired waits until the queue is full. ROS 2's users know it so.

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
    waiting: Vec<Waiting>,
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
            waiting: Vec::with_capacity(config.queue_size + 1),
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

    pub(super) fn push(&mut self, topic: usize, entry: Entry, ledger: &mut Ledger) {
        if !self.insert(topic, entry, ledger) {
            return;
        }
        let found = if self.queues.len() == 2 {
            self.find_partner(1 - topic, entry.stamp)
        } else {
            self.find_partners(topic, entry.stamp)
        };
        if let Some(mut chosen) = found {
            let own = self.queues[topic].position(entry.stamp);
            chosen[topic] = own.expect("the arriving sample is queued");
            self.mark_beaten(topic, entry.stamp);
            for (topic, queue) in self.queues.iter_mut().enumerate() {
                ledger.pair(topic, queue.waiting.remove(chosen[topic]).entry);
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
            while let Some(&waiting) = self.queues[topic].waiting.get(position) {
                if waiting.entry.received < oldest {
                    self.queues[topic].waiting.remove(position);
                    ledger.drop(topic, waiting.entry, self.cause(topic, &waiting, Reason::TooOld));
                } else {
                    position += 1;
                }
            }
            self.queues[topic].note_oldest_received();
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

    /// Whether the sample stays: from a full queue the smallest stamp goes, whichever it is.
    fn insert(&mut self, topic: usize, entry: Entry, ledger: &mut Ledger) -> bool {
        let queue = &mut self.queues[topic];
        let waiting = Waiting { entry, beaten: false };
        queue.newest = queue.newest.max(Some(entry.stamp.nanoseconds));
        queue.oldest_received = queue.oldest_received.min(entry.received.nanoseconds);

        if let Some(position) = queue.position(entry.stamp) {
            let replaced = std::mem::replace(&mut queue.waiting[position], waiting);
            ledger.drop(topic, replaced.entry, Reason::Replaced);
            return true;
        }
        queue.waiting.push(waiting);
        if queue.waiting.len() <= self.queue_size {
            return true;
        }
        let smallest = queue.smallest();
        let evicted = queue.waiting.remove(smallest);
        if smallest == self.queue_size {
            ledger.drop(topic, entry, Reason::OutOfOrder);
            return false;
        }
        ledger.drop(topic, evicted.entry, self.cause(topic, &evicted, Reason::Overflow));
        true
    }

    /// The nearest sample of the one other topic; of two equally near ones, the first to arrive.
    fn find_partner(&self, other: usize, stamp: Stamp) -> Option<Positions> {
        let distances = self.queues[other].waiting.iter().map(|waiting| waiting.distance(stamp));
        let (position, distance) = distances.enumerate().min_by_key(|&(_, distance)| distance)?;
        let mut chosen = [0; TOPICS_MAX];
        chosen[other] = position;
        (distance < self.slop).then_some(chosen)
    }

    /// The first combination that fits, where the last topic's candidates change fastest.
    fn find_partners(&mut self, topic: usize, stamp: Stamp) -> Option<Positions> {
        for (other, candidates) in self.candidates.iter_mut().enumerate() {
            candidates.clear();
            if other == topic {
                continue;
            }
            let waiting = self.queues[other].waiting.iter().enumerate();
            candidates.extend(
                waiting
                    .map(|(position, waiting)| Candidate {
                        distance: waiting.distance(stamp),
                        position,
                    })
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
                for waiting in &mut queue.waiting {
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
            let stamp = waiting.entry.stamp;
            passed && queue.waiting.iter().all(|partner| self.slop <= partner.distance(stamp))
        });
        if passed_by { Reason::NoPartner } else { occasion }
    }
}

impl Queue {
    fn position(&self, stamp: Stamp) -> Option<usize> {
        self.waiting.iter().position(|waiting| waiting.entry.stamp == stamp)
    }

    /// Where the smallest stamp is, in a queue that is not empty.
    fn smallest(&self) -> usize {
        let stamps = self.waiting.iter().map(Waiting::stamp).enumerate();
        stamps.min_by_key(|&(_, stamp)| stamp).map_or(0, |(position, _)| position)
    }

    fn note_oldest_received(&mut self) {
        let received = self.waiting.iter().map(|waiting| waiting.entry.received.nanoseconds);
        self.oldest_received = received.min().unwrap_or(u64::MAX);
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

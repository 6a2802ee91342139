//! Approximate-time pairing: which samples of several topics belong to the same moment.
//!
//! Two algorithms, exactly as ROS 2's `message_filters` has them, over stamps alone; no payload, no
//! clock, and no allocation once constructed. What comes in ends in exactly one place: in a pair,
//! among the dropped with a [`Reason`], or still queued. [`Books`] show it, per topic.
//!
//! ```no_run
//! # use std::time::Duration;
//! # use interfaces::Stamp;
//! # use node::pairing::{Bounds, Config, Entry, Pairing, Policy};
//! const SCAN: usize = 0;
//! let mut pairing = Pairing::new(&Config {
//!     policy: Policy::Nearest,
//!     topics: 2,
//!     queue_size: 10,
//!     slop: Duration::from_millis(50),
//!     bounds: Bounds::Limited {
//!         max_age: Duration::from_millis(150),
//!         max_delay: Duration::from_millis(20),
//!     },
//! })?;
//! let entry = Entry { stamp: Stamp::ZERO, sequence: 0, epoch: 1, received: Stamp::ZERO };
//! for pair in pairing.push(SCAN, entry).pairs() {
//!     // send a ticket
//! }
//! # Ok::<(), node::pairing::ConfigError>(())
//! ```

mod adaptive;
mod books;
mod config;
mod factor;
mod nearest;
pub mod offline;
mod outcome;
#[cfg(test)]
mod tests;
mod tickets;
mod timeline;

use std::time::Duration;

use interfaces::Stamp;

use adaptive::Adaptive;
pub use books::{Books, Reason};
pub use config::{
    Bounds, Config, ConfigError, Policy, QUEUE_SIZE_MAX, TOPICS_MAX, slop_from_seconds,
};
use nearest::Nearest;
use outcome::Ledger;
pub use outcome::{Dropped, Entry, Outcome, Pair};
pub use tickets::{ODOMETRIES, SCANS, SensorPairing, write_ticket};
use timeline::{Timeline, Verdict};

/// Pairs the samples of a fixed number of topics.
///
/// Time comes in with the entries and with [`Pairing::poll`]; it never runs backwards: a receive
/// time before an earlier one counts as that earlier one.
#[derive(Debug)]
pub struct Pairing {
    policy: Core,
    limits: Option<Limits>,
    ledger: Ledger,
    now: Stamp,
    resets: u64,
    forced: u64,
}

#[derive(Debug)]
enum Core {
    Nearest(Nearest),
    Adaptive(Adaptive),
}

/// What ROS 2 does not have.
#[derive(Debug)]
struct Limits {
    max_age: Duration,
    timeline: Timeline,
}

impl Pairing {
    /// All the memory that it will ever need.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        config.check()?;
        let policy = match config.policy {
            Policy::Nearest => Core::Nearest(Nearest::new(config)),
            Policy::Adaptive { age_penalty, period_min } => {
                Core::Adaptive(Adaptive::new(config, age_penalty, &period_min))
            }
        };
        let limits = match config.bounds {
            Bounds::Unlimited => None,
            Bounds::Limited { max_age, .. } => {
                Some(Limits { max_age, timeline: Timeline::new(config, max_age) })
            }
        };
        let ledger = Ledger::new(config);
        Ok(Self { policy, limits, ledger, now: Stamp::ZERO, resets: 0, forced: 0 })
    }

    /// From now on pairs by the slop, the age penalty, the greatest age and the greatest delay of
    /// `config`. What waits goes on waiting; what else `config` says changes nothing.
    pub fn retune(&mut self, config: &Config) -> Result<(), ConfigError> {
        config.check()?;
        match &mut self.policy {
            Core::Nearest(nearest) => nearest.retune(config),
            Core::Adaptive(adaptive) => adaptive.retune(config),
        }
        if let (Some(limits), Bounds::Limited { max_age, .. }) = (&mut self.limits, config.bounds) {
            limits.max_age = max_age;
            limits.timeline.retune(config, max_age);
        }
        Ok(())
    }

    /// Takes one sample of `topic`, at its receive time, and says what comes of it: for `nearest`
    /// one pair at most, for `adaptive` any number.
    pub fn push(&mut self, topic: usize, entry: Entry) -> Outcome<'_> {
        self.ledger.begin();
        self.advance(entry.received);
        self.ledger.receive(topic);

        let entry = Entry { received: self.now, ..entry };
        if let Some(reason) = self.refusal(topic, &entry) {
            self.ledger.drop(topic, entry, reason);
        } else {
            match &mut self.policy {
                Core::Nearest(nearest) => nearest.push(topic, entry, &mut self.ledger),
                Core::Adaptive(adaptive) => {
                    adaptive.push(topic, entry, &mut self.ledger);
                    self.forced += adaptive.force(self.now, &mut self.ledger);
                }
            }
        }
        self.ledger.outcome()
    }

    /// Gives out what cannot wait any longer and drops what has become too old.
    ///
    /// [`Pairing::push`] does the same first. Poll when [`Pairing::next_deadline`] has come, or a
    /// pair's delay exceeds `max_delay`; and before reading the books, or samples that have become
    /// too old still count as queued.
    pub fn poll(&mut self, now: Stamp) -> Outcome<'_> {
        self.ledger.begin();
        self.advance(now);
        self.ledger.outcome()
    }

    /// When to poll, if nothing arrives before; `None` where only an arrival can make a pair.
    pub fn next_deadline(&self) -> Option<Stamp> {
        match &self.policy {
            Core::Nearest(_) => None,
            Core::Adaptive(adaptive) => {
                adaptive.next_deadline(self.limits.as_ref().map(|limits| limits.max_age))
            }
        }
    }

    /// Drops everything queued and forgets every stamp, as after a change of clock that somebody
    /// else noticed; counted.
    pub fn reset(&mut self) -> Outcome<'_> {
        self.ledger.begin();
        self.resets += 1;
        for topic in 0..self.ledger.topics() {
            self.clear(topic);
        }
        if let Some(limits) = &mut self.limits {
            limits.timeline.forget();
        }
        self.ledger.outcome()
    }

    /// The account of one topic.
    pub fn books(&self, topic: usize) -> Books {
        let queued = match &self.policy {
            Core::Nearest(nearest) => nearest.queue(topic).count(),
            Core::Adaptive(adaptive) => adaptive.queue(topic).count(),
        };
        self.ledger.books(topic, queued as u64)
    }

    /// The queued samples of one topic, in the queue's own order.
    pub fn queue(&self, topic: usize) -> impl Iterator<Item = &Entry> {
        let (nearest, adaptive) = match &self.policy {
            Core::Nearest(nearest) => (Some(nearest.queue(topic)), None),
            Core::Adaptive(adaptive) => (None, Some(adaptive.queue(topic))),
        };
        nearest.into_iter().flatten().chain(adaptive.into_iter().flatten())
    }

    /// [-] Times that a clock ran backwards, or that [`Pairing::reset`] was called.
    pub fn resets(&self) -> u64 {
        self.resets
    }

    /// [-] Pairs given out because their delay was up, before they were provably the best.
    pub fn forced(&self) -> u64 {
        self.forced
    }

    fn advance(&mut self, now: Stamp) {
        self.now = self.now.max(now);
        if let Some(limits) = &self.limits {
            let oldest = self.now.nanoseconds.saturating_sub(nanoseconds(limits.max_age));
            let oldest = Stamp::from_nanoseconds(oldest);
            match &mut self.policy {
                Core::Nearest(nearest) => nearest.expire(oldest, &mut self.ledger),
                Core::Adaptive(adaptive) => adaptive.expire(oldest, &mut self.ledger),
            }
        }
        if let Core::Adaptive(adaptive) = &mut self.policy {
            self.forced += adaptive.force(self.now, &mut self.ledger);
        }
    }

    /// Why `entry` must not reach the policy, if so; where the clock ran backwards, makes room.
    fn refusal(&mut self, topic: usize, entry: &Entry) -> Option<Reason> {
        if STAMP_MAX < entry.stamp {
            return Some(Reason::NoStamp);
        }
        let limits = self.limits.as_mut()?;
        match limits.timeline.judge(topic, entry.stamp, self.now) {
            Verdict::Onward => None,
            Verdict::Refuse(reason) => Some(reason),
            Verdict::Backward { gone } => {
                self.resets += 1;
                if let Core::Adaptive(adaptive) = &mut self.policy {
                    adaptive.finish(&mut self.ledger);
                }
                for topic in (0..TOPICS_MAX).filter(|&topic| gone[topic]) {
                    self.clear(topic);
                }
                None
            }
        }
    }

    fn clear(&mut self, topic: usize) {
        match &mut self.policy {
            Core::Nearest(nearest) => nearest.clear(topic, &mut self.ledger),
            Core::Adaptive(adaptive) => adaptive.clear(topic, &mut self.ledger),
        }
    }
}

/// The last moment that ROS 2 can name; 292 years. A later one is garbage.
const STAMP_MAX: Stamp = Stamp::from_nanoseconds(i64::MAX.cast_unsigned());

/// [ns] As many as fit.
fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

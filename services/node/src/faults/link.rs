//! The way of one topic's samples, with its faults.

use std::time::Duration;

use interfaces::{Message, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::{Faults, damage, duration};

/// [-] Samples under way at once: more than a second of the fastest sensor, 50 Hz. It bounds the
/// memory that a long delay takes, which is three quarters of a megabyte where the samples are scans.
pub const QUEUE_MAX: usize = 64;

/// The way from a publisher to its readers, on which samples fare as [`Faults`] say.
///
/// A sample's fate hangs on the seed, the stream and its number alone, so that one kind of fault,
/// turned on or off, leaves those that others befall as they were. Nothing is allocated after
/// construction.
#[derive(Debug)]
pub struct FaultyLink<T: Message> {
    faults: Faults,
    is_faultless: bool,
    delay_max: Duration,
    stamp_jump_max: Duration,
    random: ChaCha8Rng,
    window: Option<(Stamp, Stamp)>,
    stalled_until: Stamp,
    held_back: Option<T>,
    queue: Vec<Queued<T>>,
    order: u64,
    counts: FaultCounts,
}

/// A sample under way.
#[derive(Debug)]
struct Queued<T> {
    due: Stamp,
    /// [-] After whom it arrives where two do at once.
    order: u64,
    sample: T,
}

/// How often each fault has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounts {
    /// [-] Samples that were given to the link.
    pub pushed: u64,
    /// [-] Samples lost by `loss`.
    pub lost: u64,
    /// [-] Samples lost in a stall, the one that began it included.
    pub stalled: u64,
    /// [-] The oldest of more than [`QUEUE_MAX`] under way, lost for that.
    pub overflowed: u64,
    /// [-] Samples that were under way when the publisher paused, lost for that.
    pub abandoned: u64,
    /// [-] Samples, or second copies, that were sent late.
    pub delayed: u64,
    /// [-] Samples that were sent twice.
    pub duplicated: u64,
    /// [-] Samples that were held back until after the next one.
    pub reordered: u64,
    /// [-] Samples that were overwritten in part.
    pub corrupted: u64,
    /// [-] Samples whose stamp was moved.
    pub stamps_moved: u64,
    /// [-] Stalls that have begun.
    pub stalls: u64,
}

impl FaultCounts {
    /// [-] Samples that never arrive, for whatever reason.
    pub const fn missing(&self) -> u64 {
        self.lost + self.stalled + self.overflowed + self.abandoned
    }
}

impl<T: Message> FaultyLink<T> {
    /// A link whose faults are drawn from `stream` of `seed`: one of its own, so that no other draw
    /// depends on it.
    pub fn new(faults: &Faults, seed: u64, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        Self {
            faults: *faults,
            is_faultless: faults.is_none(),
            delay_max: duration(faults.delay_max_s),
            stamp_jump_max: duration(faults.stamp_jump_max_s),
            random,
            window: None,
            stalled_until: Stamp::ZERO,
            held_back: None,
            queue: Vec::with_capacity(QUEUE_MAX),
            order: 0,
            counts: FaultCounts::default(),
        }
    }

    /// Sends `sample` on its way, `now`.
    pub fn push(&mut self, now: Stamp, mut sample: T) {
        self.counts.pushed += 1;
        if self.is_faultless {
            return self.enqueue(now, sample);
        }
        let fate = Fate::draw(&mut self.random);
        let Some(window_end) = self.window_end(now) else {
            return self.pass(now, sample);
        };
        if now < self.stalled_until {
            self.counts.stalled += 1;
            return;
        }
        if fate.stall < self.faults.stall {
            self.counts.stalls += 1;
            self.counts.stalled += 1;
            self.stalled_until = now.after(duration(self.faults.stall_s)).min(window_end);
            return;
        }
        if fate.loss < self.faults.loss {
            self.counts.lost += 1;
            return;
        }
        self.spoil(&mut sample, &fate);
        if fate.reorder < self.faults.reorder && self.held_back.is_none() {
            self.counts.reordered += 1;
            self.held_back = Some(sample);
            return;
        }
        let is_twice = fate.duplicate < self.faults.duplicate;
        let due = self.arrival(now, fate.delay);
        self.pass(due, sample);
        if is_twice {
            self.counts.duplicated += 1;
            let due = self.arrival(now, fate.second_delay);
            self.enqueue(due, sample);
        }
    }

    /// What has arrived at `now`, one sample after another.
    pub fn pop(&mut self, now: Stamp) -> Option<T> {
        let (index, due) = self.first()?;
        let has_arrived = due <= now && self.stalled_until <= now;
        has_arrived.then(|| self.queue.swap_remove(index).sample)
    }

    /// When [`FaultyLink::pop`] has something to give, as far as is known yet.
    pub fn due(&self) -> Option<Stamp> {
        self.first().map(|(_, due)| due.max(self.stalled_until))
    }

    /// Gives up what is under way, and counts it.
    pub fn abandon(&mut self) {
        let under_way = self.queue.len() + usize::from(self.held_back.is_some());
        self.counts.abandoned += under_way as u64;
        self.queue.clear();
        self.held_back = None;
    }

    /// What has happened so far.
    pub const fn counts(&self) -> &FaultCounts {
        &self.counts
    }

    /// Where in the queue the next one to arrive is, and when it does.
    fn first(&self) -> Option<(usize, Stamp)> {
        let queued = self.queue.iter().enumerate();
        let (index, first) = queued.min_by_key(|(_, queued)| (queued.due, queued.order))?;
        Some((index, first.due))
    }

    /// When the faults cease, where they are at work at `now`.
    fn window_end(&mut self, now: Stamp) -> Option<Stamp> {
        let (begin, end) = *self.window.get_or_insert_with(|| {
            let end = self.faults.until_s.map(|until| now.after(duration(until)));
            let end = end.unwrap_or(Stamp::from_nanoseconds(u64::MAX));
            (now.after(duration(self.faults.from_s)), end)
        });
        (begin <= now && now < end).then_some(end)
    }

    /// What the sample says that it should not.
    fn spoil(&mut self, sample: &mut T, fate: &Fate) {
        if fate.stamp_jump < self.faults.stamp_jump {
            self.counts.stamps_moved += 1;
            let stamp = &mut sample.header_mut().stamp;
            let jump = self.stamp_jump_max.mul_f64(fate.jump.abs());
            *stamp = if fate.jump < 0.0 { stamp.before(jump) } else { stamp.after(jump) };
        }
        if fate.corrupt < self.faults.corrupt {
            self.counts.corrupted += 1;
            damage::overwrite(sample, fate.damage);
        }
    }

    fn arrival(&mut self, now: Stamp, delay: f64) -> Stamp {
        let late = self.delay_max.mul_f64(delay);
        self.counts.delayed += u64::from(!late.is_zero());
        now.after(late)
    }

    /// Lets `sample` arrive, and right behind it the one that was held back for it.
    fn pass(&mut self, due: Stamp, sample: T) {
        self.enqueue(due, sample);
        if let Some(held_back) = self.held_back.take() {
            self.enqueue(due, held_back);
        }
    }

    fn enqueue(&mut self, due: Stamp, sample: T) {
        if self.queue.len() == QUEUE_MAX {
            let queued = self.queue.iter().enumerate();
            if let Some((oldest, _)) = queued.min_by_key(|(_, queued)| queued.order) {
                self.queue.swap_remove(oldest);
                self.counts.overflowed += 1;
            }
        }
        self.queue.push(Queued { due, order: self.order, sample });
        self.order += 1;
    }
}

/// What may happen to one sample: all of it is drawn, whether or not it comes to that.
struct Fate {
    loss: f64,
    delay: f64,
    duplicate: f64,
    second_delay: f64,
    reorder: f64,
    corrupt: f64,
    damage: u64,
    stamp_jump: f64,
    /// [-] In `-1..1`.
    jump: f64,
    stall: f64,
}

impl Fate {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        Self {
            loss: uniform(random),
            delay: uniform(random),
            duplicate: uniform(random),
            second_delay: uniform(random),
            reorder: uniform(random),
            corrupt: uniform(random),
            damage: random.next_u64(),
            stamp_jump: uniform(random),
            jump: 2.0 * uniform(random) - 1.0,
            stall: uniform(random),
        }
    }
}

/// [-] In `0..1`: below a probability of 1 always, of 0 never.
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / (f64::from(u32::MAX) + 1.0)
}

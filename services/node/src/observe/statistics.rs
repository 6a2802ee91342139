//! How a topic does, from the headers of its samples and the times at which they came. Pure.

use std::collections::VecDeque;
use std::time::Duration;

use interfaces::{Header, Stamp};

use crate::arrivals::{Arrival, Arrivals};

/// [-] Four seconds of a topic at 1 kHz; more would say the same of most.
const SAMPLES_MAX: usize = 4_096;

/// How one topic does: rate, age, jitter, loss and bandwidth over the newest samples.
///
/// The rate is that of the samples sent, by their numbers, whether they have come or not: one who
/// reads too slowly still learns it.
#[derive(Debug, Clone)]
pub struct Statistics {
    window: Duration,
    samples_max: usize,
    size: usize,
    epoch: u32,
    arrivals: Arrivals,
    newest: VecDeque<Came>,
    sent: u64,
    come: u64,
    lost: u64,
}

/// One sample that has come.
#[derive(Debug, Clone, Copy)]
struct Came {
    received: Stamp,
    stamp: Stamp,
    /// [-] Samples sent until this one, since the first that was seen.
    sent: u64,
}

/// How old data is when it comes: the time from its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ages {
    /// The mean.
    pub mean: Duration,
    /// As many are older as are younger.
    pub median: Duration,
    /// The greatest.
    pub max: Duration,
}

/// The time between two samples that follow each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Period {
    /// [s] The mean.
    pub mean: f64,
    /// [s] The least.
    pub min: f64,
    /// [s] The greatest.
    pub max: f64,
    /// [s] The standard deviation: the jitter.
    pub deviation: f64,
}

impl Statistics {
    /// Of a topic whose messages have `size` bytes, over what came within `window`, and no more than
    /// the newest 4096 samples.
    pub fn new(size: usize, window: Duration) -> Self {
        Self::over(size, window, SAMPLES_MAX)
    }

    /// The same over the newest `samples`, however long ago they came.
    pub fn of_last(size: usize, samples: usize) -> Self {
        Self::over(size, Duration::MAX, samples.min(SAMPLES_MAX))
    }

    fn over(size: usize, window: Duration, samples_max: usize) -> Self {
        Self {
            window,
            samples_max,
            size,
            epoch: 0,
            arrivals: Arrivals::default(),
            newest: VecDeque::new(),
            sent: 0,
            come: 0,
            lost: 0,
        }
    }

    /// A sample with this header has come at `received`.
    pub fn add(&mut self, header: &Header, received: Stamp) {
        if header.epoch < self.epoch {
            return;
        }
        if self.epoch < header.epoch || self.come == 0 {
            // Another life counts anew: nothing is known of what lies between the two.
            self.epoch = header.epoch;
            self.arrivals = Arrivals::from(header.sequence);
            self.sent += 1;
        } else {
            match self.arrivals.note(header.sequence) {
                Arrival::Newest { missing } => {
                    self.sent = self.sent.saturating_add(1).saturating_add(missing);
                    self.lost = self.lost.saturating_add(missing);
                }
                Arrival::Late => self.lost = self.lost.saturating_sub(1),
                Arrival::Again => return,
            }
        }
        self.come += 1;
        if self.newest.len() == self.samples_max {
            self.newest.pop_front();
        }
        self.newest.push_back(Came { received, stamp: header.stamp, sent: self.sent });
    }

    /// It is `now`: what came before the window is forgotten, but for the last sample.
    pub fn forget(&mut self, now: Stamp) {
        while 1 < self.newest.len() && self.window < now.since(self.newest[0].received) {
            self.newest.pop_front();
        }
    }

    /// [-] Samples that have come so far.
    pub const fn come(&self) -> u64 {
        self.come
    }

    /// [-] Samples that were sent so far and have not come: lost on their way, or by one who looked too
    /// late.
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// When the newest sample came.
    pub fn last(&self) -> Option<Stamp> {
        self.newest.back().map(|came| came.received)
    }

    /// [Hz] How many samples are sent in a second; `None` before the second one.
    pub fn rate(&self) -> Option<f64> {
        self.per_second(|came| came.received)
    }

    /// [Hz] The same by the samples' stamps: in lock-step, where stamps are simulated time, the
    /// robot's own rate.
    pub fn rate_by_stamp(&self) -> Option<f64> {
        self.per_second(|came| came.stamp)
    }

    /// [byte/s] How much is sent in a second.
    pub fn bandwidth(&self) -> Option<f64> {
        self.rate().map(|rate| rate * self.size as f64)
    }

    /// How old the data was when it came. Says something only where stamps are of the clock that the
    /// samples were received by, which they are not in lock-step.
    pub fn ages(&self) -> Option<Ages> {
        let mut ages: Vec<_> =
            self.newest.iter().map(|came| came.received.since(came.stamp)).collect();
        ages.sort_unstable();
        let count = u32::try_from(ages.len()).ok().filter(|&count| 0 < count)?;
        let mean = ages.iter().sum::<Duration>() / count;
        Some(Ages { mean, median: ages[ages.len() / 2], max: ages[ages.len() - 1] })
    }

    /// The time between samples that came and follow each other, with nothing lost in between.
    pub fn period(&self) -> Option<Period> {
        let pairs = self.newest.iter().zip(self.newest.iter().skip(1));
        let periods: Vec<_> = pairs
            .filter(|(first, second)| first.sent + 1 == second.sent)
            .map(|(first, second)| second.received.since(first.received).as_secs_f64())
            .collect();
        if periods.is_empty() {
            return None;
        }
        let count = periods.len() as f64;
        let mean = periods.iter().sum::<f64>() / count;
        let squares: f64 = periods.iter().map(|period| (period - mean) * (period - mean)).sum();
        Some(Period {
            mean,
            min: periods.iter().copied().fold(f64::INFINITY, f64::min),
            max: periods.iter().copied().fold(0.0, f64::max),
            deviation: (squares / count).sqrt(),
        })
    }

    fn per_second(&self, time: impl Fn(&Came) -> Stamp) -> Option<f64> {
        let (first, last) = (self.newest.front()?, self.newest.back()?);
        let elapsed = time(last).since(time(first)).as_secs_f64();
        (0.0 < elapsed).then(|| (last.sent - first.sent) as f64 / elapsed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: u64) -> Stamp {
        Stamp::from_nanoseconds(milliseconds * 1_000_000)
    }

    /// Samples by stamp, number, and when they came.
    fn seen(samples: &[(u64, u64, u64)]) -> Statistics {
        let mut statistics = Statistics::new(40, Duration::from_secs(5));
        for &(stamp, sequence, received) in samples {
            let header = Header { stamp: ms(stamp), sequence, epoch: 1, reserved: 0 };
            statistics.add(&header, ms(received));
        }
        statistics
    }

    fn near(value: Option<f64>, expected: f64) {
        assert!((value.unwrap() - expected).abs() < 1e-9, "{value:?} is not {expected}");
    }

    #[test]
    fn of_one_sample_nothing_but_its_age_is_known() {
        let one = seen(&[(100, 7, 103)]);

        assert_eq!((one.rate(), one.period(), one.bandwidth()), (None, None, None));
        assert_eq!(one.ages().unwrap().max, Duration::from_millis(3));
        assert_eq!(seen(&[]).ages(), None);
    }

    #[test]
    fn a_steady_topic_has_its_rate_its_bandwidth_and_no_jitter() {
        let steady = seen(&[(0, 0, 5), (50, 1, 55), (100, 2, 105)]);

        near(steady.rate(), 20.0);
        near(steady.bandwidth(), 800.0);
        near(steady.period().map(|period| period.mean), 0.05);
        near(steady.period().map(|period| period.deviation), 0.0);
        assert_eq!((steady.come(), steady.lost()), (3, 0));
    }

    #[test]
    fn jitter_is_the_deviation_of_the_periods() {
        let uneven = seen(&[(0, 0, 0), (50, 1, 40), (100, 2, 100)]);
        let period = uneven.period().unwrap();

        near(Some(period.min), 0.04);
        near(Some(period.max), 0.06);
        near(Some(period.deviation), 0.01);
    }

    #[test]
    fn what_is_lost_is_a_gap_and_changes_neither_rate_nor_jitter() {
        let gaps = seen(&[(0, 0, 0), (50, 1, 50), (250, 5, 250), (300, 6, 300)]);

        near(gaps.rate(), 20.0);
        near(gaps.period().map(|period| period.max), 0.05);
        assert_eq!((gaps.come(), gaps.lost()), (4, 3));
    }

    #[test]
    fn what_comes_late_was_not_lost_and_what_comes_twice_counts_once() {
        let mixed = seen(&[(0, 0, 0), (100, 2, 100), (50, 1, 101), (50, 1, 102)]);

        assert_eq!((mixed.come(), mixed.lost()), (3, 0));
    }

    #[test]
    fn ages_are_told_by_their_mean_median_and_maximum() {
        let ages = seen(&[(0, 0, 1), (50, 1, 52), (100, 2, 109)]).ages().unwrap();

        let expected = [4, 2, 9].map(Duration::from_millis);
        assert_eq!([ages.mean, ages.median, ages.max], expected);
    }

    #[test]
    fn a_new_life_begins_without_a_loss_and_the_old_one_is_not_believed() {
        let mut restarted = seen(&[(0, 100, 0), (50, 101, 50)]);
        let of = |epoch, sequence| Header { stamp: ms(60), sequence, epoch, reserved: 0 };
        restarted.add(&of(2, 0), ms(100));
        restarted.add(&of(1, 102), ms(110));
        restarted.add(&of(2, 1), ms(150));

        assert_eq!((restarted.come(), restarted.lost()), (4, 0));
        near(restarted.rate(), 20.0);
    }

    #[test]
    fn what_came_before_the_window_is_forgotten() {
        let mut slowed = seen(&[(0, 0, 0), (10, 1, 10), (1_000, 2, 1_000), (2_000, 3, 2_000)]);
        slowed.forget(ms(5_500));

        near(slowed.rate(), 1.0);
        slowed.forget(ms(60_000));
        assert_eq!(slowed.rate(), None, "a topic that is silent has no rate");
        assert_eq!(slowed.last(), Some(ms(2_000)));
    }

    #[test]
    fn over_so_many_samples_older_ones_do_not_count() {
        let mut last_three = Statistics::of_last(40, 3);
        for (sequence, received) in (0..).zip([0, 10, 20, 120, 220]) {
            let header = Header { stamp: ms(received), sequence, epoch: 1, reserved: 0 };
            last_three.add(&header, ms(received));
            last_three.forget(ms(received));
        }

        near(last_three.rate(), 10.0);
        assert_eq!(last_three.come(), 5);
    }

    #[test]
    fn its_memory_has_an_end() {
        let mut endless = Statistics::new(40, Duration::MAX);
        for sequence in 0..10_000 {
            let header = Header { stamp: ms(sequence), sequence, ..Header::default() };
            endless.add(&header, ms(sequence));
        }

        assert_eq!(endless.newest.len(), SAMPLES_MAX);
        near(endless.rate(), 1_000.0);
    }
}

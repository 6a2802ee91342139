//! `adaptive`: a set waits until no better one can follow, as `sync_policies::ApproximateTime` of
//! ROS 2's C++ does.
//!
//! The first set that is found fixes the *pivot*, its latest sample. Every later set with the same
//! pivot competes, and the one with the smallest span goes out as soon as it has provably won. With
//! a greatest delay it goes out when that is up, having won against all that came so far.

use std::collections::VecDeque;
use std::time::Duration;

use interfaces::Stamp;

use super::{
    Bounds, Config, Entry, Policy, Reason, TOPICS_MAX, factor::Factor, nanoseconds, outcome::Ledger,
};

/// Lanes of samples in the order of their arrival, and the search for the best set.
#[derive(Debug)]
pub(super) struct Adaptive {
    lanes: Vec<Lane>,
    search: Option<Search>,
    queue_size: usize,
    /// [ns] Stamps of a set are less than this apart.
    slop: u64,
    /// [-] One, and the age penalty.
    penalty: Factor,
    /// [ns] How long a set may wait for a better one, where that is bounded.
    max_delay: Option<u64>,
}

/// One topic's samples: first those *past*, which the search has left behind, then the *head*.
#[derive(Debug)]
struct Lane {
    samples: VecDeque<Entry>,
    /// [-] How many are past.
    past: usize,
    /// Whether a full queue has cost samples that might have been better than the head.
    lossy: bool,
    /// [ns] The least time between two stamps.
    period_min: i64,
}

/// The best set so far: the first sample of every lane.
#[derive(Debug, Clone, Copy)]
struct Search {
    span: Span,
    /// [-] The topic of the pivot.
    pivot: usize,
    /// [ns] The stamp of the pivot.
    pivot_stamp: i64,
    /// [ns] When the delay is up, in receive time.
    due: u64,
}

/// The earliest and the latest of one stamp per topic.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// [ns] The earliest stamp.
    start: i64,
    /// [-] Its topic, of several the first.
    start_topic: usize,
    /// [ns] The latest stamp.
    end: i64,
    /// [-] Its topic, of several the last.
    end_topic: usize,
}

impl Adaptive {
    pub(super) fn new(
        config: &Config,
        age_penalty: f64,
        period_min: &[Duration; TOPICS_MAX],
    ) -> Self {
        let lane = |period_min: &Duration| Lane {
            // The arriving sample comes in before another one goes.
            samples: VecDeque::with_capacity(config.queue_size + 1),
            past: 0,
            lossy: false,
            period_min: nanoseconds(*period_min).try_into().unwrap_or(i64::MAX),
        };
        Self {
            lanes: period_min[..config.topics].iter().map(lane).collect(),
            search: None,
            queue_size: config.queue_size,
            slop: nanoseconds(config.slop),
            penalty: Factor::new(1.0 + age_penalty),
            max_delay: match config.bounds {
                Bounds::Unlimited => None,
                Bounds::Limited { max_delay, .. } => Some(nanoseconds(max_delay)),
            },
        }
    }

    /// A set that was found before may still go out, as it would have.
    pub(super) fn retune(&mut self, config: &Config) {
        self.slop = nanoseconds(config.slop);
        if let Policy::Adaptive { age_penalty, .. } = config.policy {
            self.penalty = Factor::new(1.0 + age_penalty);
        }
        if let Bounds::Limited { max_delay, .. } = config.bounds {
            self.max_delay = Some(nanoseconds(max_delay));
        }
    }

    pub(super) fn push(&mut self, topic: usize, entry: Entry, ledger: &mut Ledger) {
        let lane = &mut self.lanes[topic];
        lane.samples.push_back(entry);
        if lane.samples.len() - lane.past == 1 {
            self.process(ledger);
        }
        if self.queue_size < self.lanes[topic].samples.len() {
            self.overflow(topic, ledger);
        }
    }

    /// Gives out every set whose delay is up; says how many.
    pub(super) fn force(&mut self, now: Stamp, ledger: &mut Ledger) -> u64 {
        let mut forced = 0;
        if self.max_delay.is_none() {
            return forced;
        }
        while self.search.is_some_and(|search| search.due <= now.nanoseconds) {
            self.publish(ledger);
            self.process(ledger);
            forced += 1;
        }
        forced
    }

    /// Gives out what waits for something better, since nothing better can follow any more.
    pub(super) fn finish(&mut self, ledger: &mut Ledger) {
        while self.search.is_some() {
            self.publish(ledger);
            self.process(ledger);
        }
    }

    /// Drops what was received before `oldest`.
    ///
    /// That a sample was lost this way does not make its lane lossy: whatever it might have been
    /// better than, it may be in no pair any more.
    pub(super) fn expire(&mut self, oldest: Stamp, ledger: &mut Ledger) {
        let is_too_old = |lane: &Lane| lane.samples.front().is_some_and(|it| it.received < oldest);
        if !self.lanes.iter().any(is_too_old) {
            return;
        }
        let searched = self.search.is_some();
        self.abandon();
        for (topic, lane) in self.lanes.iter_mut().enumerate() {
            while is_too_old(lane) {
                let first = lane.samples.pop_front();
                ledger.drop(topic, first.expect("it is too old"), Reason::TooOld);
            }
        }
        if searched {
            self.process(ledger);
        }
    }

    /// Drops all samples of `topic`, and ends the search.
    pub(super) fn clear(&mut self, topic: usize, ledger: &mut Ledger) {
        self.abandon();
        let lane = &mut self.lanes[topic];
        lane.lossy = false;
        for entry in lane.samples.drain(..) {
            ledger.drop(topic, entry, Reason::Reset);
        }
    }

    /// When the set that waits must go out, or one of its members becomes too old and another set
    /// takes its place.
    pub(super) fn next_deadline(&self, max_age: Option<Duration>) -> Option<Stamp> {
        let due = Stamp::from_nanoseconds(self.search?.due);
        let firsts = self.lanes.iter().filter_map(|lane| lane.samples.front());
        let received = firsts.map(|first| first.received).min()?;
        let too_old = max_age.map(|max_age| received.after(max_age).after(Duration::from_nanos(1)));
        let deadline = too_old.map_or(due, |too_old| due.min(too_old));
        (deadline.nanoseconds < u64::MAX).then_some(deadline)
    }

    pub(super) fn queue(&self, topic: usize) -> impl Iterator<Item = &Entry> {
        self.lanes[topic].samples.iter()
    }

    /// Advances the search while every lane has a head.
    fn process(&mut self, ledger: &mut Ledger) {
        while let Some(heads) = Span::of(self.lanes.iter().map(Lane::head_stamp)) {
            for (topic, lane) in self.lanes.iter_mut().enumerate() {
                // No lost sample could have been better than this head.
                lane.lossy &= topic == heads.end_topic;
            }
            let Some(search) = self.search else {
                self.start_search(heads, ledger);
                continue;
            };
            if self.is_better(heads, search.span) {
                self.keep_heads(ledger);
                self.search = Some(Search { span: heads, ..search });
            }
            self.lanes[heads.start_topic].past += 1;
            self.conclude(heads, ledger);
        }
    }

    /// Drops the first sample of `topic`, which was a member of the best set if there was one.
    fn overflow(&mut self, topic: usize, ledger: &mut Ledger) {
        let searched = self.search.is_some();
        self.abandon();
        let lane = &mut self.lanes[topic];
        lane.lossy = true;
        let first = lane.samples.pop_front();
        ledger.drop(topic, first.expect("the lane is more than full"), Reason::Overflow);
        if searched {
            self.process(ledger);
        }
    }

    /// Without a set so far: takes the heads, or drops the earliest of them.
    fn start_search(&mut self, heads: Span, ledger: &mut Ledger) {
        let partner_lost = self.lanes[heads.end_topic].lossy;
        if self.slop <= heads.length() || partner_lost {
            let head = self.lanes[heads.start_topic].samples.pop_front();
            let reason = if partner_lost { Reason::PartnerLost } else { Reason::NoPartner };
            ledger.drop(heads.start_topic, head.expect("every lane has a head"), reason);
            return;
        }
        let completed = self.lanes.iter().filter_map(|lane| lane.samples.front()?.received.into());
        let completed = completed.max().unwrap_or_default().nanoseconds;
        self.search = Some(Search {
            span: heads,
            pivot: heads.end_topic,
            pivot_stamp: heads.end,
            due: self.max_delay.map_or(u64::MAX, |delay| completed.saturating_add(delay)),
        });
        self.lanes[heads.start_topic].past += 1;
        self.conclude(heads, ledger);
    }

    /// Gives the best set out, if these heads or what can still follow them prove that it is.
    fn conclude(&mut self, heads: Span, ledger: &mut Ledger) {
        let Some(search) = self.search else { return };
        let exhausted = heads.start_topic == search.pivot;
        if exhausted || self.is_final(heads, search) || self.is_final_by_periods(search) {
            self.publish(ledger);
        }
    }

    /// Supposes the best that can still come where a lane has no head, and searches on.
    fn is_final_by_periods(&mut self, search: Search) -> bool {
        if self.lanes.iter().all(|lane| lane.head_stamp().is_some()) {
            return false;
        }
        let mut past = [0; TOPICS_MAX];
        for (past, lane) in past.iter_mut().zip(&self.lanes) {
            *past = lane.past;
        }

        let mut is_final = false;
        let pivot_stamp = search.pivot_stamp;
        while let Some(heads) =
            Span::of(self.lanes.iter().map(|lane| Some(lane.supposed_stamp(pivot_stamp))))
        {
            is_final = self.is_final(heads, search);
            if is_final || self.is_better(heads, search.span) {
                break;
            }
            // The earliest is a sample and not a supposition: else one of the two would be true.
            self.lanes[heads.start_topic].past += 1;
        }
        for (past, lane) in past.into_iter().zip(&mut self.lanes) {
            lane.past = past;
        }
        is_final
    }

    /// Whether nothing from these heads on can be better: it has to reach from the pivot to their end.
    fn is_final(&self, heads: Span, search: Search) -> bool {
        let loss = self.penalty.times(heads.end - search.span.end);
        search.pivot_stamp - search.span.start <= loss
    }

    /// Whether the heads gain more at their start than they lose, with the penalty, at their end.
    fn is_better(&self, heads: Span, best: Span) -> bool {
        self.penalty.times(heads.end - best.end) < heads.start - best.start
    }

    /// Makes the heads the first samples of their lanes.
    fn keep_heads(&mut self, ledger: &mut Ledger) {
        for (topic, lane) in self.lanes.iter_mut().enumerate() {
            for entry in lane.samples.drain(..std::mem::take(&mut lane.past)) {
                ledger.drop(topic, entry, Reason::Superseded);
            }
        }
    }

    /// Gives out the first sample of every lane.
    fn publish(&mut self, ledger: &mut Ledger) {
        self.abandon();
        for (topic, lane) in self.lanes.iter_mut().enumerate() {
            let first = lane.samples.pop_front();
            ledger.pair(topic, first.expect("every lane begins with a member of the set"));
        }
    }

    /// Ends the search; nothing is past any more.
    fn abandon(&mut self) {
        self.search = None;
        for lane in &mut self.lanes {
            lane.past = 0;
        }
    }
}

impl Lane {
    fn head_stamp(&self) -> Option<i64> {
        self.samples.get(self.past).map(signed_stamp)
    }

    /// [ns] The head's stamp, or the earliest that the next sample can have and matter.
    fn supposed_stamp(&self, pivot_stamp: i64) -> i64 {
        let last = self.samples.back().map_or(pivot_stamp, signed_stamp);
        self.head_stamp().unwrap_or_else(|| pivot_stamp.max(last.saturating_add(self.period_min)))
    }
}

impl Span {
    /// Of one stamp per topic, unless one is missing.
    fn of(stamps: impl Iterator<Item = Option<i64>>) -> Option<Self> {
        let mut span = Self { start: i64::MAX, start_topic: 0, end: i64::MIN, end_topic: 0 };
        for (topic, stamp) in stamps.enumerate() {
            let stamp = stamp?;
            if stamp < span.start {
                (span.start, span.start_topic) = (stamp, topic);
            }
            if span.end <= stamp {
                (span.end, span.end_topic) = (stamp, topic);
            }
        }
        Some(span)
    }

    /// [ns] From start to end.
    fn length(self) -> u64 {
        self.start.abs_diff(self.end)
    }
}

/// [ns] No later stamp than fits gets this far.
fn signed_stamp(entry: &Entry) -> i64 {
    entry.stamp.nanoseconds.cast_signed()
}

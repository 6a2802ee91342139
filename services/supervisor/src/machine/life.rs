//! One node as the machine sees it: where it is, where it shall be, and what has gone wrong.

use std::collections::VecDeque;
use std::time::Duration;

use interfaces::{Stamp, State};

use super::{Kill, NodePlan, Rank};

/// However its launch file has it, a node is not started more often than this.
const LIFE_MIN: Duration = Duration::from_millis(50);

/// A node that has been active for so long starts anew with its delays.
const HEALTHY: Duration = Duration::from_secs(10);

/// One node.
#[derive(Debug)]
pub(super) struct Life {
    pub(super) phase: Phase,
    pub(super) want: Want,
    /// Where it says that it is.
    pub(super) state: State,
    /// The primary state that it was last in.
    pub(super) rest: State,
    /// Which life it is, from 1; 0 before the first.
    pub(super) epoch: u32,
    /// When this life began.
    pub(super) since: Stamp,
    pub(super) active_since: Stamp,
    /// When its loop last turned.
    pub(super) pinged: Stamp,
    pub(super) flows: bool,
    pub(super) has_flowed: bool,
    /// Why it cannot go on, in its own words; the first of this life.
    pub(super) reason: Option<String>,
    /// Who took it down and comes up before it: an earlier one.
    pub(super) because: Option<usize>,
    /// It is not started before this.
    pub(super) not_before: Stamp,
    /// Within the start limit's interval.
    pub(super) failures: VecDeque<Stamp>,
    /// [-] One after another, without a healthy time between them.
    pub(super) failures_in_a_row: u32,
    pub(super) restarts: u32,
}

/// Where somebody wants it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Want {
    Up,
    /// Down, and then up.
    Again,
    Down,
}

/// Where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// It has no process.
    Down,
    Starting(Deadline),
    Unconfigured,
    Configuring(Deadline),
    Inactive,
    Activating(Deadline),
    Active,
    Deactivating(Deadline),
    /// It has said why it cannot go on, and is about to end.
    Failing(Deadline),
    /// It was asked to end.
    ShuttingDown(Stopping),
    /// It was killed, and is not reaped yet.
    Dying(Stopping),
    /// It has ended by itself, as it may.
    Ended,
    /// It was killed and is there all the same.
    Lost,
}

/// Until when something has to have happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Deadline {
    pub(super) until: Stamp,
    /// How long it was given.
    pub(super) limit: Duration,
    /// Whether it is past, and the node was asked where it is.
    pub(super) is_asked: bool,
}

/// How a node is brought to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stopping {
    pub(super) until: Stamp,
    /// The last signal that it was sent.
    pub(super) told: Option<Kill>,
}

impl Life {
    pub(super) fn new(now: Stamp) -> Self {
        Self {
            phase: Phase::Down,
            want: Want::Up,
            state: State::Unknown,
            rest: State::Unknown,
            epoch: 0,
            since: now,
            active_since: now,
            pinged: now,
            flows: false,
            has_flowed: false,
            reason: None,
            because: None,
            not_before: now,
            failures: VecDeque::new(),
            failures_in_a_row: 0,
            restarts: 0,
        }
    }

    /// A new life, of which nothing is known yet.
    pub(super) fn begin(&mut self, now: Stamp, phase: Phase) {
        self.phase = phase;
        self.state = State::Unknown;
        self.rest = State::Unknown;
        self.epoch += 1;
        self.since = now;
        self.flows = false;
        self.has_flowed = false;
        self.reason = None;
        self.because = None;
    }

    pub(super) fn has_process(&self) -> bool {
        !matches!(self.phase, Phase::Down | Phase::Ended | Phase::Lost)
    }

    /// Whether whoever requires it may begin.
    pub(super) fn is_there(&self) -> bool {
        self.want == Want::Up
            && match self.phase {
                Phase::Starting(_)
                | Phase::Unconfigured
                | Phase::Configuring(_)
                | Phase::Inactive
                | Phase::Activating(_)
                | Phase::Active
                | Phase::Ended => true,
                Phase::Down
                | Phase::Deactivating(_)
                | Phase::Failing(_)
                | Phase::ShuttingDown(_)
                | Phase::Dying(_)
                | Phase::Lost => false,
            }
    }

    /// Whether it is taken down with another, or is down already and comes up after it.
    pub(super) fn goes_with_others(&self) -> bool {
        self.want != Want::Down && !matches!(self.phase, Phase::Ended | Phase::Lost)
    }

    pub(super) fn is_ready(&self) -> bool {
        match self.phase {
            Phase::Active => self.want == Want::Up && self.flows,
            Phase::Ended => true,
            Phase::Down
            | Phase::Starting(_)
            | Phase::Unconfigured
            | Phase::Configuring(_)
            | Phase::Inactive
            | Phase::Activating(_)
            | Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_)
            | Phase::Lost => false,
        }
    }

    pub(super) fn flow(&mut self) {
        self.flows = true;
        self.has_flowed = true;
    }

    pub(super) fn note_failure(&mut self, plan: &NodePlan, now: Stamp) {
        let was_healthy = self.phase == Phase::Active && HEALTHY <= now.since(self.active_since);
        self.failures_in_a_row = if was_healthy { 1 } else { self.failures_in_a_row + 1 };
        let is_old = |failure: &Stamp| plan.start_limit.interval < now.since(*failure);
        while self.failures.front().is_some_and(is_old) {
            self.failures.pop_front();
        }
        self.failures.push_back(now);
    }

    pub(super) fn forget_failures(&mut self, now: Stamp) {
        self.failures.clear();
        self.failures_in_a_row = 0;
        self.not_before = now;
    }

    /// Before its next life: the first comes at once, the others after more and more time.
    pub(super) fn delay(&self, plan: &NodePlan, now: Stamp) -> Duration {
        let backoff = plan.backoff;
        let delay = match self.failures_in_a_row {
            0 | 1 => Duration::ZERO,
            row => {
                let first = backoff.first.as_secs_f64().max(1e-3);
                let growth = (backoff.max.as_secs_f64() / first).max(1.0);
                let share = f64::from(row - 2) / f64::from(backoff.steps);
                Duration::from_secs_f64(first * growth.powf(share)).min(backoff.max)
            }
        };
        delay.max(LIFE_MIN.saturating_sub(now.since(self.since)))
    }
}

impl Deadline {
    pub(super) fn new(now: Stamp, limit: Duration) -> Self {
        Self { until: now.after(limit), limit, is_asked: false }
    }

    fn extend(&mut self, now: Stamp, more: Duration) {
        let until = self.until.max(now.after(more));
        self.limit += until.since(self.until);
        self.until = until;
    }
}

impl Phase {
    /// Where its transition leads.
    pub(super) fn goal(self) -> State {
        match self {
            Self::Starting(_) => State::Unconfigured,
            Self::Configuring(_) | Self::Deactivating(_) => State::Inactive,
            Self::Activating(_) => State::Active,
            Self::Down
            | Self::Unconfigured
            | Self::Inactive
            | Self::Active
            | Self::Failing(_)
            | Self::ShuttingDown(_)
            | Self::Dying(_)
            | Self::Ended
            | Self::Lost => State::Unknown,
        }
    }

    /// It asks for more time for what it is doing.
    pub(super) fn extend(&mut self, now: Stamp, more: Duration) {
        if let Self::ShuttingDown(stopping) = self {
            stopping.until = stopping.until.max(now.after(more));
        } else if let Some(deadline) = self.transition_deadline() {
            deadline.extend(now, more);
        }
    }

    /// Its way up has lost its point; its way down has not.
    pub(super) fn shorten(&mut self, now: Stamp, limit: Duration) {
        let is_on_its_way_up = !matches!(self, Self::Deactivating(_));
        if let Some(deadline) = self.transition_deadline()
            && is_on_its_way_up
            && now.after(limit) < deadline.until
        {
            *deadline = Deadline::new(now, limit);
        }
    }

    /// It is late; until `until` somebody has to say where it is.
    pub(super) fn ask(&mut self, until: Stamp) {
        if let Some(deadline) = self.transition_deadline() {
            deadline.until = until;
            deadline.is_asked = true;
        }
    }

    /// Until when its transition has to be done, while it is in one.
    fn transition_deadline(&mut self) -> Option<&mut Deadline> {
        match self {
            Self::Starting(deadline)
            | Self::Configuring(deadline)
            | Self::Activating(deadline)
            | Self::Deactivating(deadline) => Some(deadline),
            Self::Down
            | Self::Unconfigured
            | Self::Inactive
            | Self::Active
            | Self::Failing(_)
            | Self::ShuttingDown(_)
            | Self::Dying(_)
            | Self::Ended
            | Self::Lost => None,
        }
    }

    /// Whether it was asked to end by this signal.
    pub(super) fn was_told(self, signal: Kill) -> bool {
        matches!(self, Self::ShuttingDown(stopping) if stopping.told == Some(signal))
    }

    /// Whether its code does nothing any more.
    pub(super) fn is_paused(self) -> bool {
        !matches!(self, Self::Active | Self::Activating(_) | Self::Deactivating(_))
    }

    /// On the way to be configured.
    pub(super) fn rank_unconfigured(self) -> Rank {
        match self {
            Self::Unconfigured | Self::Configuring(_) => Rank::There,
            Self::Inactive | Self::Activating(_) | Self::Active | Self::Ended => Rank::Beyond,
            Self::Down
            | Self::Starting(_)
            | Self::Deactivating(_)
            | Self::Failing(_)
            | Self::ShuttingDown(_)
            | Self::Dying(_)
            | Self::Lost => Rank::Behind,
        }
    }

    /// On the way to be activated.
    pub(super) fn rank_inactive(self) -> Rank {
        match self {
            Self::Inactive | Self::Activating(_) => Rank::There,
            Self::Active | Self::Ended => Rank::Beyond,
            Self::Down
            | Self::Starting(_)
            | Self::Unconfigured
            | Self::Configuring(_)
            | Self::Deactivating(_)
            | Self::Failing(_)
            | Self::ShuttingDown(_)
            | Self::Dying(_)
            | Self::Lost => Rank::Behind,
        }
    }
}

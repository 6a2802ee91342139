//! When a node's turns are due.

use std::time::Duration;

use interfaces::Stamp;

use crate::figures::Figures;
use crate::{Gauge, Latency};

/// When a node's turns are due: once every period, and by an alarm.
#[derive(Debug, Default)]
pub(super) struct Rhythm {
    period: Option<Duration>,
    due: Stamp,
    overruns: Gauge,
    lateness: Option<Latency>,
    alarm: Option<Stamp>,
}

impl Rhythm {
    pub(super) fn set_period(&mut self, period: Duration, figures: &mut Figures) {
        self.period = Some(period);
        self.overruns = figures.gauge("overruns");
        self.lateness = Some(figures.latency("late"));
    }

    pub(super) const fn set_alarm(&mut self, moment: Option<Stamp>) {
        self.alarm = moment;
    }

    /// The first period begins at once.
    pub(super) const fn start(&mut self, now: Stamp) {
        self.due = now;
    }

    pub(super) fn is_due(&self, now: Stamp) -> bool {
        self.period.is_some() && self.due <= now
    }

    /// When the next turn comes, whatever happens.
    pub(super) fn next(&self) -> Option<Stamp> {
        let periodic = self.period.map(|_| self.due);
        [periodic, self.alarm].into_iter().flatten().min()
    }

    /// A turn that is due is taken at `now`: without a drift, but no period is made up for.
    pub(super) fn advance(&mut self, now: Stamp) {
        let Some(period) = self.period.filter(|_| self.is_due(now)) else { return };
        if let Some(lateness) = &self.lateness {
            lateness.record(now.since(self.due));
        }
        self.due = self.due.after(period);
        if self.due <= now {
            self.overruns.count();
            self.due = now.after(period);
        }
    }
}

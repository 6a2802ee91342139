//! What whoever started a node is told by it, beside its topics.

use std::time::Duration;

use interfaces::{Stamp, State};

use crate::{Notifier, Settings, watchdog_period};

/// What whoever started a node is told by it: `sd_notify`'s words.
#[derive(Debug)]
pub(super) struct Telling {
    notifier: Notifier,
    ping_period: Option<Duration>,
    ping_due: Stamp,
    is_ready: bool,
    flows: bool,
}

impl Telling {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            notifier: settings.notifier(),
            // The watchdog of a node in its supervisor's process is the supervisor's.
            ping_period: watchdog_period().filter(|_| settings.heeds_signals()),
            ping_due: Stamp::ZERO,
            is_ready: false,
            flows: false,
        }
    }

    /// That its loop turns: from here, and from no other thread.
    pub(super) fn ping(&mut self, now: Stamp) {
        if let Some(period) = self.ping_period
            && self.ping_due <= now
        {
            self.ping_due = now.after(period);
            self.notifier.watchdog();
        }
    }

    pub(super) fn state(&mut self, state: State) {
        self.notifier.hint("LIFECYCLE", state.label());
        match state {
            State::Active if !std::mem::replace(&mut self.is_ready, true) => self.notifier.ready(),
            State::ShuttingDown => self.notifier.stopping(),
            _ => {}
        }
    }

    /// Whether nobody has been told yet that all topics have carried something.
    pub(super) const fn awaits_flow(&self) -> bool {
        !self.flows
    }

    pub(super) fn flow(&mut self) {
        self.flows = true;
        self.notifier.hint("FLOWS", "1");
    }

    /// That there is something on a topic that it reads.
    pub(super) fn hint(&self, name: &str) {
        self.notifier.hint(name, "1");
    }

    pub(super) fn status(&self, text: &str) {
        self.notifier.status(text);
    }

    pub(super) fn extend_timeout(&self, more: Duration) {
        self.notifier.extend_timeout(more);
    }
}

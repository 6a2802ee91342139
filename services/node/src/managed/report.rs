//! How a node is, told to whoever asks its topic.

use std::time::Duration;

use interfaces::topics::STATUS;
use interfaces::{NodeStatus, Outcome, Stamp, State, Text};

use super::ports::Ports;
use crate::figures::Figures;
use crate::{Publisher, Result, Session};

/// While active, a node says this often how it is.
const PERIOD: Duration = Duration::from_millis(100);

/// How a node is, and when it says so next.
#[derive(Debug)]
pub(super) struct Report {
    publisher: Publisher<NodeStatus>,
    due: Stamp,
    status: Box<NodeStatus>,
}

impl Report {
    pub(super) fn open(session: &Session) -> Result<Self> {
        let mut status = Box::<NodeStatus>::default();
        status.process = std::process::id();
        Ok(Self { publisher: session.publisher(&STATUS)?, due: Stamp::ZERO, status })
    }

    /// What it is doing, in one line.
    pub(super) fn set_text(&mut self, text: &str) {
        self.status.text = Text::new(text);
    }

    pub(super) const fn set_outcome(&mut self, outcome: Outcome) {
        self.status.outcome = outcome as u8;
    }

    pub(super) fn is_due(&self, now: Stamp) -> bool {
        self.due <= now
    }

    /// Tells those who have come late how it is.
    pub(super) fn greet(&self) -> Result {
        self.publisher.greet()
    }

    pub(super) fn send(
        &mut self,
        now: Stamp,
        state: State,
        ports: &Ports,
        figures: &Figures,
    ) -> Result {
        self.due = now.after(PERIOD);
        ports.update_figures();
        let report = &mut *self.status;
        report.header.stamp = now;
        report.state = state as u8;
        if state != State::Unconfigured && state != State::Finalized {
            report.port_count = ports.write(&mut report.port);
            report.value_count = figures.write(&mut report.value);
        }
        self.publisher.send_with(|status| *status = *report)
    }
}

//! What people are told about one of the ports: each thing once.

use std::time::Duration;

use node::{Gauge, Node};

use crate::serial::Refusal;

/// Longer than between two tries to open a port.
const PATIENCE: Duration = Duration::from_secs(5);

/// What was said last about a port.
#[derive(Debug)]
pub(super) struct Told {
    name: &'static str,
    trouble: Option<String>,
    losses: Gauge,
}

impl Told {
    /// About the port of `name`, whose losses are counted as `key`.
    pub(super) fn new(node: &mut Node<'_>, name: &'static str, key: &str) -> Self {
        Self { name, trouble: None, losses: node.gauge(key) }
    }

    /// It was lost, because of `why`.
    pub(super) fn lost(&mut self, node: &mut Node<'_>, why: &str) {
        self.losses.count();
        self.trouble(node, why);
    }

    /// It cannot be opened, because of `refusal`: a robot that is started waits for whom to plug it in.
    pub(super) fn closed(&mut self, node: &mut Node<'_>, refusal: &Refusal) {
        self.trouble(node, &refusal.to_string());
        node.extend_timeout(PATIENCE);
    }

    /// It cannot be used, because of `why`.
    pub(super) fn trouble(&mut self, node: &mut Node<'_>, why: &str) {
        if self.trouble.as_deref() != Some(why) {
            let text = format!("{}: {why}", self.name);
            tracing::warn!("{text}");
            node.say(&text);
            self.trouble = Some(why.to_owned());
        }
    }

    /// It works, `how`.
    pub(super) fn well(&mut self, node: &mut Node<'_>, how: &str) {
        if self.trouble.take().is_some() {
            let text = format!("{}: back, {how}", self.name);
            tracing::info!("{text}");
            node.say(&text);
        }
    }
}

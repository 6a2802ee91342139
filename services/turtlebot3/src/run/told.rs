//! What people are told about one of the ports: each thing once.

use node::{Gauge, Node};

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

    /// It cannot be used, because of `why`.
    pub(super) fn trouble(&mut self, node: &mut Node<'_>, why: &str) {
        if self.trouble.as_deref() != Some(why) {
            tracing::warn!(why, "lost the {}", self.name);
            node.say(&format!("{}: {why}", self.name));
            self.trouble = Some(why.to_owned());
        }
    }

    /// It works, `how`.
    pub(super) fn well(&mut self, node: &mut Node<'_>, how: &str) {
        if self.trouble.take().is_some() {
            tracing::info!(how, "the {} is back", self.name);
            node.say(&format!("{}: back, {how}", self.name));
        }
    }
}

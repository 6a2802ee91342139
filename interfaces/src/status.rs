//! What a node says about itself while it lives: counters, figures and one line of text.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::{Header, Text, UnknownNumber};

/// [-] Ports that fit in a [`NodeStatus`].
pub const PORTS_MAX: usize = 16;

/// [-] Figures that fit in a [`NodeStatus`].
pub const VALUES_MAX: usize = 48;

/// The counters of one port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("PortStatus/2")]
#[repr(C)]
pub struct PortStatus {
    /// [-] The topic's full name.
    pub topic: Text,
    /// [-] 1 for a publisher, 0 for a subscriber.
    pub publishes: u8,
    /// [-] 1 for a publisher that may be silent for as long as nothing happens, else 0.
    pub on_event: u8,
    /// [-] Zero.
    pub reserved: [u8; 6],
    /// [-] Samples sent, or taken from the queue while active; one that came twice counts once.
    pub samples: u64,
    /// [-] Samples overwritten before they were received, or never sent: gaps in the sequence.
    pub lost: u64,
    /// [-] Samples that were still queued, and dropped, when the node was deactivated.
    pub unread: u64,
    /// [-] Samples of an older life of the publisher, refused.
    pub stale: u64,
    /// [-] XXH3 over the bytes of every sample sent, in order; 0 for a subscriber,
    /// and where the clock is not lock-step.
    pub digest: u64,
}

/// One figure that a node reports.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("Value/1")]
#[repr(C)]
pub struct Value {
    /// [-] Its name, with the unit at the end (`distance_m`).
    pub key: Text,
    /// [as the key says] Its value.
    pub value: f64,
}

/// Whether a node has come to the end of what it was to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Outcome {
    /// Not yet, or it has no end.
    Working = 0,
    /// It has, and asks for the end of the run.
    Done = 1,
    /// It has failed, and asks for the end of the run.
    Failed = 2,
}

impl Outcome {
    /// In a word for people.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Working => "working",
            Self::Done => "done",
            Self::Failed => "failed",
        }
    }
}

impl TryFrom<u8> for Outcome {
    type Error = UnknownNumber;

    fn try_from(number: u8) -> Result<Self, UnknownNumber> {
        [Self::Working, Self::Done, Self::Failed]
            .into_iter()
            .find(|&outcome| outcome as u8 == number)
            .ok_or(UnknownNumber(number))
    }
}

/// What a node says about itself: at every transition, and while active at the topic's rate.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("NodeStatus/3")]
#[repr(C)]
pub struct NodeStatus {
    /// Stamp of the report, sequence, epoch.
    pub header: Header,
    /// [-] Its [`State`](crate::State), by number.
    pub state: u8,
    /// [-] An [`Outcome`], by number.
    pub outcome: u8,
    /// [-] Zero.
    pub reserved: [u8; 2],
    /// [-] Process id.
    pub process: u32,
    /// [-] How many of `port` are in use, at most [`PORTS_MAX`].
    pub port_count: u32,
    /// [-] How many of `value` are in use, at most [`VALUES_MAX`].
    pub value_count: u32,
    /// [-] One line for people: what it is doing, or why it finished.
    pub text: Text,
    /// By port, in the order of opening.
    pub port: [PortStatus; PORTS_MAX],
    /// By figure, in the node's own order.
    pub value: [Value; VALUES_MAX],
}

impl NodeStatus {
    /// The ports in use.
    pub fn ports(&self) -> &[PortStatus] {
        &self.port[..(self.port_count as usize).min(PORTS_MAX)]
    }

    /// The figures in use.
    pub fn values(&self) -> &[Value] {
        &self.value[..(self.value_count as usize).min(VALUES_MAX)]
    }

    /// The figure called `key`, if the node reports one.
    pub fn value(&self, key: &str) -> Option<f64> {
        self.values().iter().find(|value| value.key.as_str() == key).map(|value| value.value)
    }
}

impl Default for NodeStatus {
    fn default() -> Self {
        Self::zeroed()
    }
}

const _: () = {
    assert!(size_of::<PortStatus>() == Text::CAPACITY + 48);
    assert!(size_of::<Value>() == Text::CAPACITY + 8);
    assert!(
        size_of::<NodeStatus>()
            == 40
                + Text::CAPACITY
                + PORTS_MAX * size_of::<PortStatus>()
                + VALUES_MAX * size_of::<Value>()
    );
};

//! Everything that can be measured.

use node::{Namespace, Result};

use crate::bridge::{self, Bridge};
use crate::chain::{self, Chain};
use crate::cost::{self, Cost};
use crate::hop::{self, Hop};
use crate::lockstep::{self, Alone, Lockstep};
use crate::measured::{Collected, Unit, Values};
use crate::pairing::{self, Core};
use crate::ticket::Payload;
use crate::{Drive, Effort, Row};

/// One thing to measure; it yields one figure or more.
#[derive(Debug)]
pub(crate) enum Work {
    /// One hop.
    Hop(Hop),
    /// What a sample costs the pairing.
    Core(Core),
    /// A pair by ticket.
    Ticket(Payload),
    /// The whole loop in real time.
    Chain(Chain),
    /// The bridge to a TurtleBot3.
    Bridge(Bridge),
    /// A robot in lock-step.
    Lockstep(Lockstep),
    /// The same loop in one process.
    Alone(Alone),
    /// What a robot costs.
    Cost(Cost),
}

/// All of `rows`, or of every row where there are none, and what is left out, with the reason.
pub(crate) fn configurations(rows: &[Row], cores: usize, drive: Drive) -> (Vec<Work>, Vec<String>) {
    let (mut works, mut absent) = (Vec::new(), Vec::new());
    let is_asked = |row| rows.is_empty() || rows.contains(&row);
    if is_asked(Row::Hop) {
        let (hops, left_out) = hop::configurations(cores);
        works.extend(hops.into_iter().map(Work::Hop));
        absent.extend(left_out);
    }
    if is_asked(Row::Pair) {
        works.extend(pairing::configurations().into_iter().map(Work::Core));
        works.extend(Payload::ALL.map(Work::Ticket));
    }
    if is_asked(Row::Loop) {
        if !is_asked(Row::Hop) && 1 < cores {
            // What the machine itself takes at that pace.
            works.extend(hop::floors().map(Work::Hop));
        }
        works.extend(chain::configurations().into_iter().map(Work::Chain));
    }
    if is_asked(Row::Bridge) {
        works.extend(bridge::configurations().map(Work::Bridge));
    }
    if is_asked(Row::Lockstep) {
        if !is_asked(Row::Hop) && 1 < cores {
            // A virtual machine's cores may share a cache at one time and none at another.
            works.push(Work::Hop(hop::FLAG));
        }
        works.extend(lockstep::configurations().into_iter().map(Work::Lockstep));
        works.extend(lockstep::alone(drive).into_iter().map(Work::Alone));
        absent.push(
            "lock-step in processes with several robots in one world: a process is in one robot's \
             namespace, so each has a world; in one process they share it"
                .to_owned(),
        );
    }
    if is_asked(Row::Cost) {
        works.extend(cost::configurations().into_iter().map(Work::Cost));
    }
    (works, absent)
}

impl Work {
    /// A place for each figure that [`Work::measure`] yields.
    pub(crate) fn collected(&self) -> Vec<Collected> {
        let new = |row, name| Collected::new(row, name, Unit::Nanoseconds);
        let told = |row, names: Vec<(String, Unit)>| {
            names.into_iter().map(|(name, unit)| Collected::new(row, name, unit)).collect()
        };
        match self {
            Self::Hop(hop) => vec![new("hop", hop.name())],
            Self::Core(core) => vec![new("pair", core.name())],
            Self::Ticket(payload) => payload.names().map(|name| new("pair", name)).into(),
            Self::Chain(chain) => chain.names().into_iter().map(|name| new("loop", name)).collect(),
            Self::Bridge(bridge) => told("bridge", bridge.names()),
            Self::Lockstep(lockstep) => told("lockstep", lockstep.names().into()),
            Self::Alone(alone) => {
                vec![Collected::new("lockstep", alone.name(), Unit::PerSecond)]
            }
            Self::Cost(cost) => told("cost", cost.names()),
        }
    }

    /// One round.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        match self {
            Self::Hop(hop) => Ok(vec![hop.measure(namespace, effort)?]),
            Self::Core(core) => Ok(vec![core.measure()]),
            Self::Ticket(payload) => Ok(payload.measure(namespace, effort)?.into()),
            Self::Chain(chain) => chain.measure(namespace, effort),
            Self::Bridge(bridge) => bridge.measure(namespace, effort),
            Self::Lockstep(lockstep) => lockstep.measure(namespace, effort),
            Self::Alone(alone) => Ok(vec![alone.measure(effort)?]),
            Self::Cost(cost) => cost.measure(namespace, effort),
        }
    }
}

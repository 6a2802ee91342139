//! The ports of one node: what they count, what waits at them, and what goes wrong there on purpose.

use std::fmt;
use std::rc::Rc;

use interfaces::{PORTS_MAX, PortStatus, Stamp};

use crate::faults::{Faults, Figure};
use crate::figures::Figures;
use crate::port::Port;
use crate::{Gauge, Result};

/// The ports of one node, from one `configure` to its `cleanup`.
#[derive(Debug, Default)]
pub(super) struct Ports {
    all: Vec<Counted>,
    faulty: Vec<Faulty>,
}

/// What a port owes those who wait for the robot to be ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Promise {
    /// A steady flow.
    Flow,
    /// Nothing: it is silent until something happens.
    Nothing,
}

/// A port whose counters and queue the node looks after.
struct Counted {
    port: Rc<dyn Port>,
    promise: Promise,
}

/// A port on whose topic something goes wrong on purpose, and what it says of that.
struct Faulty {
    topic: &'static str,
    faults: Faults,
    port: Rc<dyn Port>,
    gauges: Vec<(Gauge, &'static Figure)>,
}

impl Ports {
    pub(super) fn add(&mut self, port: Rc<dyn Port>, promise: Promise) {
        self.all.push(Counted { port, promise });
    }

    /// From now on the faults of `topic`, which `port` publishes, are told.
    pub(super) fn add_faulty(&mut self, topic: &'static str, faults: Faults, port: Rc<dyn Port>) {
        self.faulty.push(Faulty { topic, faults, port, gauges: Vec::new() });
    }

    pub(super) fn clear(&mut self) {
        self.all.clear();
        self.faulty.clear();
    }

    /// The topics that can have faults here.
    pub(super) fn faulty_topics(&self) -> Vec<&'static str> {
        self.faulty.iter().map(|faulty| faulty.topic).collect()
    }

    /// The topics that are published here.
    pub(super) fn published_topics(&self) -> Vec<String> {
        let ports = self.all.iter().map(|counted| counted.port.status());
        ports.filter(|port| port.publishes == 1).map(|port| port.topic.to_string()).collect()
    }

    /// Makes room in the status for what goes wrong.
    pub(super) fn prepare_figures(&mut self, figures: &mut Figures) {
        for Faulty { topic, faults, gauges, .. } in &mut self.faulty {
            for figure in faults.figures() {
                let key = format!("faults_{topic}_{}", figure.name);
                if let Some(gauge) = figures.gauge_if_fits(&key) {
                    gauges.push((gauge, figure));
                } else {
                    tracing::warn!(key, "no room in the status");
                }
            }
        }
    }

    /// Counts what has gone wrong so far.
    pub(super) fn update_figures(&self) {
        for faulty in &self.faulty {
            let counts = faulty.port.faults();
            for (gauge, figure) in &faulty.gauges {
                gauge.set((figure.count)(&counts) as f64);
            }
        }
    }

    /// Writes the ports' counters; returns how many ports there are.
    pub(super) fn write(&self, slots: &mut [PortStatus; PORTS_MAX]) -> u32 {
        let ports = self.all.iter().take(PORTS_MAX);
        let count = u32::try_from(ports.len()).unwrap_or_default();
        for (slot, counted) in slots.iter_mut().zip(ports) {
            *slot = counted.status();
        }
        count
    }

    /// Sends what faults have made late.
    pub(super) fn flush(&self, now: Stamp) -> Result {
        self.faulty.iter().try_for_each(|faulty| faulty.port.flush(now))
    }

    /// When something will have to be sent.
    pub(super) fn due(&self) -> Option<Stamp> {
        self.faulty.iter().filter_map(|faulty| faulty.port.due()).min()
    }

    /// Whether there is something that the node would have been woken for.
    pub(super) fn has_samples(&self) -> Result<bool> {
        for counted in &self.all {
            if counted.port.has_samples()? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Whether every topic that has to has carried something.
    pub(super) fn have_flowed(&self) -> bool {
        self.all
            .iter()
            .all(|counted| counted.promise == Promise::Nothing || counted.port.has_flowed())
    }

    pub(super) fn drain(&self) -> Result {
        self.all.iter().try_for_each(|counted| counted.port.drain())
    }
}

impl Counted {
    fn status(&self) -> PortStatus {
        let on_event = self.promise == Promise::Nothing;
        PortStatus { on_event: on_event.into(), ..self.port.status() }
    }
}

impl fmt::Debug for Counted {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.port.status().topic.as_str())
    }
}

impl fmt::Debug for Faulty {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.topic)
    }
}

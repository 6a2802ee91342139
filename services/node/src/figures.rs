//! Figures that a node reports about itself: set at no cost, read whenever its status is sent.

use std::cell::{Cell, RefCell};
use std::fmt::Write as _;
use std::rc::Rc;
use std::time::Duration;

use hdrhistogram::Histogram;
use interfaces::{Text, VALUES_MAX, Value};

/// [us] Anything longer counts as this: a minute.
const LATENCY_MAX: u64 = 60_000_000;

/// One figure that goes up and down.
#[derive(Debug, Clone, Default)]
pub struct Gauge(Rc<Cell<f64>>);

impl Gauge {
    /// It is `value` now.
    pub fn set(&self, value: f64) {
        self.0.set(value);
    }

    /// What it is.
    pub fn get(&self) -> f64 {
        self.0.get()
    }

    /// One more.
    pub fn count(&self) {
        self.0.set(self.0.get() + 1.0);
    }
}

/// How long something took, over the whole run, to three digits.
#[derive(Debug, Clone)]
pub struct Latency(Rc<RefCell<Histogram<u64>>>);

impl Latency {
    fn new() -> Self {
        let bounded = Histogram::new_with_max(LATENCY_MAX * 10, 3);
        Self(Rc::new(RefCell::new(
            bounded.unwrap_or_else(|_| unreachable!("constant bounds are valid")),
        )))
    }

    /// One more.
    pub fn record(&self, duration: Duration) {
        let tenths = u64::try_from(duration.as_nanos() / 100).unwrap_or(u64::MAX);
        self.0.borrow_mut().saturating_record(tenths);
    }
}

/// A node's figures, by name.
#[derive(Debug, Default)]
pub(crate) struct Figures {
    gauges: Vec<(Text, Gauge)>,
    latencies: Vec<([Text; 3], Latency)>,
}

impl Figures {
    pub(crate) fn gauge(&mut self, key: &str) -> Gauge {
        let gauge = Gauge::default();
        self.gauges.push((Text::new(key), gauge.clone()));
        self.assert_room();
        gauge
    }

    pub(crate) fn latency(&mut self, name: &str) -> Latency {
        let latency = Latency::new();
        let keys = ["p50", "p99", "max"].map(|figure| Text::new(&format!("{name}_{figure}_us")));
        self.latencies.push((keys, latency.clone()));
        self.assert_room();
        latency
    }

    /// A gauge for which there may be no room: of what no node reckons with.
    pub(crate) fn gauge_if_fits(&mut self, key: &str) -> Option<Gauge> {
        (self.count() < VALUES_MAX).then(|| self.gauge(key))
    }

    pub(crate) fn clear(&mut self) {
        self.gauges.clear();
        self.latencies.clear();
    }

    /// Writes all of them, and says how many they are.
    pub(crate) fn write(&self, values: &mut [Value; VALUES_MAX]) -> u32 {
        let gauges = self.gauges.iter().map(|(key, gauge)| Value { key: *key, value: gauge.get() });
        let latencies = self.latencies.iter().flat_map(|(keys, latency)| {
            let tenths = latency.0.borrow();
            let figures =
                [tenths.value_at_quantile(0.5), tenths.value_at_quantile(0.99), tenths.max()];
            keys.iter().zip(figures)
        });
        let latencies = latencies.map(|(&key, tenths)| Value { key, value: tenths as f64 / 10.0 });
        let mut count = 0;
        for (slot, value) in values.iter_mut().zip(gauges.chain(latencies)) {
            *slot = value;
            count += 1;
        }
        count
    }

    /// Every latency's histogram: its name, a bucket's value [us], and how many fell into it.
    pub(crate) fn latency_csv(&self) -> String {
        let mut text = "name,us,count\n".to_owned();
        for (keys, latency) in &self.latencies {
            let name = keys[0].to_string();
            let name = name.trim_end_matches("_p50_us");
            for bucket in latency.0.borrow().iter_recorded() {
                let us = bucket.value_iterated_to() as f64 / 10.0;
                let _ = writeln!(text, "{name},{us},{}", bucket.count_at_value());
            }
        }
        text
    }

    fn count(&self) -> usize {
        self.gauges.len() + 3 * self.latencies.len()
    }

    fn assert_room(&self) {
        assert!(self.count() <= VALUES_MAX, "a node reports at most {VALUES_MAX} figures");
    }
}

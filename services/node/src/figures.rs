//! Figures that a node reports about itself: set at no cost, read whenever its status is sent.

use std::cell::{Cell, RefCell};
use std::fmt::Write as _;
use std::rc::Rc;
use std::time::Duration;

use hdrhistogram::Histogram;
use interfaces::{Text, VALUES_MAX, Value};

/// [us] Anything longer counts as this: a minute.
const LATENCY_MAX: u64 = 60_000_000;

/// [us] Up to which a duration counts for which step, where they are counted by steps.
const STEPS: [u64; 11] =
    [100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000];

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
pub struct Latency(Rc<RefCell<Durations>>);

/// All that were recorded.
#[derive(Debug)]
struct Durations {
    /// [100 ns]
    tenths: Histogram<u64>,
    /// [-] By step; the last is for what is longer than all.
    steps: [u64; STEPS.len() + 1],
}

impl Latency {
    fn new() -> Self {
        let bounded = Histogram::new_with_max(LATENCY_MAX * 10, 3);
        let tenths = bounded.unwrap_or_else(|_| unreachable!("constant bounds are valid"));
        Self(Rc::new(RefCell::new(Durations { tenths, steps: [0; STEPS.len() + 1] })))
    }

    /// One more.
    pub fn record(&self, duration: Duration) {
        let tenths = u64::try_from(duration.as_nanos() / 100).unwrap_or(u64::MAX);
        let mut durations = self.0.borrow_mut();
        durations.tenths.saturating_record(tenths);
        let step = STEPS.partition_point(|step| step * 10 < tenths);
        durations.steps[step] += 1;
    }
}

/// A node's figures, by name.
#[derive(Debug, Default)]
pub(crate) struct Figures {
    gauges: Vec<(Text, Gauge)>,
    latencies: Vec<(Vec<Text>, Latency)>,
}

impl Figures {
    pub(crate) fn gauge(&mut self, key: &str) -> Gauge {
        let gauge = Gauge::default();
        self.gauges.push((Text::new(key), gauge.clone()));
        self.assert_room();
        gauge
    }

    pub(crate) fn latency(&mut self, name: &str) -> Latency {
        let keys = ["p50", "p99", "max"].map(|figure| Text::new(&format!("{name}_{figure}_us")));
        self.add(keys.to_vec())
    }

    /// The same, and how many there were in each step.
    pub(crate) fn latency_by_steps(&mut self, name: &str) -> Latency {
        let quantiles = ["p50", "p99", "max"].map(|figure| format!("{name}_{figure}_us"));
        let steps = STEPS.map(|step| format!("{name}_up_to_{step}_us"));
        let over = format!("{name}_over_{}_us", STEPS[STEPS.len() - 1]);
        let keys = quantiles.into_iter().chain(steps).chain([over]);
        self.add(keys.map(|key| Text::new(&key)).collect())
    }

    fn add(&mut self, keys: Vec<Text>) -> Latency {
        let latency = Latency::new();
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
            let durations = latency.0.borrow();
            let tenths = &durations.tenths;
            let quantiles =
                [tenths.value_at_quantile(0.5), tenths.value_at_quantile(0.99), tenths.max()];
            let figures = quantiles.map(|tenths| tenths as f64 / 10.0).into_iter();
            keys.iter().zip(figures.chain(durations.steps.map(|count| count as f64)))
        });
        let latencies = latencies.map(|(&key, value)| Value { key, value });
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
            for bucket in latency.0.borrow().tenths.iter_recorded() {
                let us = bucket.value_iterated_to() as f64 / 10.0;
                let _ = writeln!(text, "{name},{us},{}", bucket.count_at_value());
            }
        }
        text
    }

    fn count(&self) -> usize {
        self.gauges.len() + self.latencies.iter().map(|(keys, _)| keys.len()).sum::<usize>()
    }

    fn assert_room(&self) {
        assert!(self.count() <= VALUES_MAX, "a node reports at most {VALUES_MAX} figures");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_told_by_quantiles_and_by_steps() {
        let mut figures = Figures::default();
        let latency = figures.latency_by_steps("way");
        for us in [10, 100, 101, 4_000, 900_000] {
            latency.record(Duration::from_micros(us));
        }
        let mut values = [Value::default(); VALUES_MAX];
        let count = figures.write(&mut values) as usize;
        let told = |key: &str| {
            let value = values[..count].iter().find(|value| value.key.as_str() == key);
            value.map(|value| value.value)
        };

        assert_eq!(count, 15);
        assert_eq!(told("way_p50_us"), Some(101.0));
        assert_eq!(told("way_up_to_100_us"), Some(2.0));
        assert_eq!(told("way_up_to_200_us"), Some(1.0));
        assert_eq!(told("way_up_to_5000_us"), Some(1.0));
        assert_eq!(told("way_over_200000_us"), Some(1.0));
    }
}

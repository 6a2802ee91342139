//! What was measured: every value counted, none dropped.

use hdrhistogram::Histogram;
use node::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::busy::Others;
use crate::card::Card;
use crate::headline::Headline;

/// Everything that one run of the bench has found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Book {
    /// [-] Of this layout.
    pub version: u32,
    /// On which machine.
    pub card: Card,
    /// The figures.
    pub figures: Vec<Figure>,
    /// What was not measured, and why.
    pub absent: Vec<String>,
    /// Ratios within this run, against their goals.
    pub headline: Headline,
}

/// The layout of [`Book`].
pub(crate) const VERSION: u32 = 1;

/// One thing that was measured, in several rounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Figure {
    /// Which part of the bench it belongs to.
    pub row: String,
    /// What it is, within its row.
    pub name: String,
    /// Of every value.
    pub unit: Unit,
    /// [-] Values, over all rounds.
    pub count: u64,
    /// The median of all values, or of the rounds where a round has one value.
    pub p50: f64,
    /// The ninth decile, where a round has many values that we see ourselves.
    pub p90: Option<f64>,
    /// One in a hundred is larger.
    pub p99: Option<f64>,
    /// One in a thousand is larger.
    pub p999: Option<f64>,
    /// The largest.
    pub max: f64,
    /// Round by round.
    pub rounds: Vec<Round>,
}

/// What one round found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Round {
    /// The median of the round, or its one value.
    pub value: f64,
    /// [-] Values in this round.
    pub count: u64,
    /// What others did meanwhile.
    pub others: Others,
}

/// What a value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Unit {
    /// [ns]
    Nanoseconds,
    /// [1/s]
    PerSecond,
    /// [-] Multiples of real time.
    TimesRealTime,
    /// [%] Of one processor.
    PercentOfACore,
    /// [KiB]
    Kibibytes,
}

impl Unit {
    /// Whether a larger value is a better one.
    pub(crate) const fn is_more_better(self) -> bool {
        matches!(self, Self::PerSecond | Self::TimesRealTime)
    }

    /// The value as people read it.
    pub(crate) fn text(self, value: f64) -> String {
        match self {
            Self::Nanoseconds => microseconds(value / 1e3),
            Self::PerSecond | Self::TimesRealTime => format!("{value:.0}"),
            Self::PercentOfACore => format!("{value:.2}"),
            Self::Kibibytes => format!("{:.1}", value / 1024.0),
        }
    }

    /// What [`Unit::text`] is told in.
    pub(crate) const fn label(self) -> &'static str {
        match self {
            Self::Nanoseconds => "us",
            Self::PerSecond => "1/s",
            Self::TimesRealTime => "x",
            Self::PercentOfACore => "%",
            Self::Kibibytes => "MiB",
        }
    }
}

fn microseconds(value: f64) -> String {
    let digits = if value < 10.0 { 3 } else { usize::from(value < 1000.0) };
    format!("{value:.digits$}")
}

/// What one round of one figure has seen: [ns] each, or one value in whatever unit.
#[derive(Debug)]
pub(crate) enum Values {
    /// Many, all of them.
    Many(Histogram<u64>),
    /// Many that another process has summed up: how many, median, 99th percentile, maximum.
    Summed(u64, [f64; 3]),
    /// One.
    One(f64),
}

/// A figure that is being measured.
#[derive(Debug)]
pub(crate) struct Collected {
    row: &'static str,
    name: String,
    unit: Unit,
    all: Option<Histogram<u64>>,
    summed: Vec<[f64; 3]>,
    rounds: Vec<Round>,
}

impl Collected {
    pub(crate) fn new(row: &'static str, name: String, unit: Unit) -> Self {
        Self { row, name, unit, all: None, summed: Vec::new(), rounds: Vec::new() }
    }

    /// Whether its name contains `text`.
    pub(crate) fn is_called(&self, text: &str) -> bool {
        self.name.contains(text)
    }

    pub(crate) fn add(&mut self, values: Values, others: Others) -> Result {
        let (value, count) = match values {
            Values::Many(histogram) => {
                let found = (histogram.value_at_quantile(0.5) as f64, histogram.len());
                match &mut self.all {
                    Some(all) => all.add(histogram).map_err(|cause| fault(&cause))?,
                    None => self.all = Some(histogram),
                }
                found
            }
            Values::Summed(count, figures) => {
                self.summed.push(figures);
                (figures[0], count)
            }
            Values::One(value) => (value, 1),
        };
        self.rounds.push(Round { value, count, others });
        Ok(())
    }

    /// What came of it; nothing where no round was measured.
    pub(crate) fn figure(self) -> Option<Figure> {
        let values: Vec<_> = self.rounds.iter().map(|round| round.value).collect();
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::MIN, f64::max);
        let (mut p50, mut p90, mut p99, mut p999) = (median(&values)?, None, None, None);
        let mut max = largest(&mut values.iter().copied());
        if let Some(all) = self.all.filter(|all| !all.is_empty()) {
            let at = |quantile| all.value_at_quantile(quantile) as f64;
            p50 = at(0.5);
            (p90, p99, p999) = (Some(at(0.9)), Some(at(0.99)), Some(at(0.999)));
            max = all.max() as f64;
        } else if !self.summed.is_empty() {
            p99 = median(&self.summed.iter().map(|figures| figures[1]).collect::<Vec<_>>());
            max = largest(&mut self.summed.iter().map(|figures| figures[2]));
        }
        Some(Figure {
            row: self.row.to_owned(),
            name: self.name,
            unit: self.unit,
            count: self.rounds.iter().map(|round| round.count).sum(),
            p50,
            p90,
            p99,
            p999,
            max,
            rounds: self.rounds,
        })
    }
}

impl Figure {
    /// [-] Rounds in which others were too busy.
    pub(crate) fn contaminated(&self) -> usize {
        self.rounds.iter().filter(|round| round.others.contaminated).count()
    }

    /// The least and the greatest value of a round.
    pub(crate) fn spread(&self) -> (f64, f64) {
        let values = self.rounds.iter().map(|round| round.value);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), value| {
            (least.min(value), greatest.max(value))
        })
    }
}

/// The one in the middle, or between the two there.
pub(crate) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    let lower = sorted[(sorted.len() - 1) / 2];
    Some(f64::midpoint(lower, upper))
}

/// [ns] Anything longer counts as this: a minute.
const LONGEST: u64 = 60_000_000_000;

/// An empty history of durations, to three digits.
pub(crate) fn history() -> Result<Histogram<u64>> {
    Histogram::new_with_max(LONGEST, 3).map_err(|cause| fault(&cause))
}

fn fault(cause: &impl std::fmt::Display) -> Error {
    Error::Fault(format!("cannot count: {cause}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_counted_and_the_largest_is_not_dropped() {
        let mut collected = Collected::new("hop", "x".to_owned(), Unit::Nanoseconds);
        for round in 0..3 {
            let mut values = history().unwrap();
            (1..=100).for_each(|value| values.record(value * 10).unwrap());
            values.record(1_000_000 + round).unwrap();
            collected.add(Values::Many(values), Others::default()).unwrap();
        }
        let figure = collected.figure().unwrap();
        assert_eq!(figure.count, 303);
        assert!(1_000_000.0 <= figure.max && figure.p999 == Some(figure.max), "{figure:?}");
        assert_eq!(figure.rounds.iter().map(|round| round.count).sum::<u64>(), figure.count);
    }

    #[test]
    fn the_median_lies_in_the_middle() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }
}

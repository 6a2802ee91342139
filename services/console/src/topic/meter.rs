//! `teseo topic hz`, `bw` and `delay`: how a topic does, once a second.

use std::time::Duration;

use clap::Args;
use interfaces::Stamp;
use node::control::Failure;
use node::observe::{Observer, Row, Statistics};
use node::say::say;
use node::{Clock, clock, signal};
use serde_json::{Value, json};

use super::{check_presence, join, open, row};
use crate::robot::Robot;
use crate::table::hertz;
use crate::{Which, refused};

/// Between two looks at what has come, and so how exact times are.
const POLL: Duration = Duration::from_micros(500);

/// Between two lines.
const PERIOD: Duration = Duration::from_secs(1);

/// Over which a figure is told, unless somebody says over how many samples.
const WINDOW: Duration = Duration::from_secs(10);

/// What to measure, and for how long.
#[derive(Debug, Args)]
pub(crate) struct Options {
    #[command(flatten)]
    robot: Which,
    /// The topic
    topic: String,
    /// Over the last so many samples [default: those of the last 10 seconds]
    #[arg(short, long, value_name = "SAMPLES", value_parser = clap::value_parser!(u64).range(2..))]
    window: Option<u64>,
    /// End after so many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    for_s: Option<u64>,
    /// End after one line
    #[arg(long, conflicts_with = "for_s")]
    once: bool,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

/// What is told about a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Figure {
    /// How often a sample comes, and how evenly.
    Rate,
    /// How many bytes.
    Bandwidth,
    /// How old they are.
    Delay,
}

/// Measures until it is to end, Ctrl-C, or the robot goes away.
pub(super) fn measure(options: &Options, figure: Figure) -> Result<u8, Failure> {
    let robot = options.robot.find()?;
    let row = row(&robot, &options.topic)?;
    if figure == Figure::Delay && robot.clock == Clock::Lockstep {
        let why = "in lock-step stamps are simulated time, which says nothing about how long data \
                   was under way; run the robot with --clock realtime";
        return Err(Failure::Refused(why.to_owned()));
    }
    signal::listen();
    let session = join(&robot)?;
    let mut observer = open(&session, &robot, &row)?;
    let mut statistics = match options.window {
        Some(samples) => Statistics::of_last(row.size, samples.try_into().unwrap_or(usize::MAX)),
        None => Statistics::new(row.size, WINDOW),
    };
    let seconds = if options.once { Some(1) } else { options.for_s };
    let begun = clock::now();
    let end = seconds.map(|seconds| begun.after(Duration::from_secs(seconds)));
    let mut due = begun.after(PERIOD);
    loop {
        let now = listen(&mut *observer, &mut statistics)?;
        if due <= now {
            due = due.after(PERIOD);
            statistics.forget(now);
            let told = Told { robot: &robot, row: &row, statistics: &statistics };
            say(&if options.json { told.json().to_string() } else { told.line(figure) })?;
        }
        if end.is_some_and(|end| end <= now) {
            return Ok(0);
        }
        check_presence(&robot)?;
        clock::nap(POLL);
    }
}

/// Takes in all that has come; returns when that was.
fn listen(observer: &mut dyn Observer, statistics: &mut Statistics) -> Result<Stamp, Failure> {
    loop {
        let sample = observer.receive().map_err(|error| refused(&error))?;
        let now = clock::now();
        let Some(sample) = sample else { return Ok(now) };
        statistics.add(&sample.header(), now);
    }
}

/// What is known by now.
struct Told<'a> {
    robot: &'a Robot,
    row: &'a Row,
    statistics: &'a Statistics,
}

impl Told<'_> {
    fn line(&self, figure: Figure) -> String {
        let (statistics, topic) = (self.statistics, &self.row.name);
        let line = match figure {
            Figure::Rate => self.rate(),
            Figure::Bandwidth => {
                statistics.bandwidth().zip(statistics.rate()).map(|(bytes, rate)| {
                    format!(
                        "{}, {} bytes a sample at {}",
                        amount(bytes),
                        self.row.size,
                        hertz(rate)
                    )
                })
            }
            Figure::Delay => statistics.ages().map(|ages| {
                let ms = |age: Duration| age.as_secs_f64() * 1e3;
                let (mean, median, max) = (ms(ages.mean), ms(ages.median), ms(ages.max));
                format!("mean {mean:.2} ms, median {median:.2} ms, at the most {max:.2} ms")
            }),
        };
        let counts = self.counts();
        line.map_or_else(
            || format!("{topic}: too few samples yet; {counts}"),
            |line| format!("{topic}: {line}; {counts}"),
        )
    }

    fn rate(&self) -> Option<String> {
        let rate = hertz(self.statistics.rate()?);
        if self.robot.clock == Clock::Lockstep {
            let own = self.statistics.rate_by_stamp().map_or_else(|| "-".to_owned(), hertz);
            return Some(format!("{rate}, {own} of the robot's own time"));
        }
        let Some(period) = self.statistics.period() else { return Some(rate) };
        let [mean, min, max, jitter] =
            [period.mean, period.min, period.max, period.deviation].map(|seconds| seconds * 1e3);
        Some(format!("{rate}; period {mean:.2} ms ({min:.2} to {max:.2}), jitter {jitter:.2} ms"))
    }

    /// In lock-step nothing is lost: what has not come was sent faster than this process reads.
    fn counts(&self) -> String {
        let (come, lost) = (self.statistics.come(), self.statistics.lost());
        let missed = if self.robot.clock == Clock::Lockstep { "not looked at" } else { "missed" };
        format!("{come} samples, {lost} {missed}")
    }

    fn json(&self) -> Value {
        let statistics = self.statistics;
        let ages = statistics.ages().filter(|_| self.robot.clock == Clock::Realtime);
        let age = |age: fn(&node::observe::Ages) -> Duration| {
            ages.as_ref().map(|ages| age(ages).as_secs_f64())
        };
        let period = statistics.period();
        json!({
            "topic": self.row.name,
            "hz": statistics.rate(),
            "hz_by_stamp": statistics.rate_by_stamp(),
            "period_mean_s": period.map(|period| period.mean),
            "period_min_s": period.map(|period| period.min),
            "period_max_s": period.map(|period| period.max),
            "jitter_s": period.map(|period| period.deviation),
            "bytes_per_s": statistics.bandwidth(),
            "age_mean_s": age(|ages| ages.mean),
            "age_p50_s": age(|ages| ages.median),
            "age_max_s": age(|ages| ages.max),
            "samples": statistics.come(),
            "missed": statistics.lost(),
        })
    }
}

/// Bytes in a second, as people read them.
fn amount(bytes: f64) -> String {
    match bytes {
        0.0..1e3 => format!("{bytes:.0} B/s"),
        1e3..1e6 => format!("{:.2} kB/s", bytes / 1e3),
        _ => format!("{:.2} MB/s", bytes / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_have_the_unit_that_fits() {
        for (bytes, text) in [(800.0, "800 B/s"), (77_920.0, "77.92 kB/s"), (2e7, "20.00 MB/s")] {
            assert_eq!(amount(bytes), text);
        }
    }
}

//! How the processes of a robot should wait on this machine, by what was measured on it.

use std::fmt::Write;

use crate::measured::Figure;

/// What the age of a scan at the wheel is called, before how the robot waits, where, and how often.
const AGE: &str = "scan to wheel, ";

/// The default, which whatever else is recommended has to beat.
const DEFAULT: &str = "block, any core";

/// [-] By so much less, or it is noise.
const GAIN: f64 = 0.9;

/// [-] One time in a hundred a scan may be so much older than by default.
const LATER: f64 = 1.5;

/// Ways to wait that leave a core to others while nothing comes.
const SLEEPING: [&str; 2] = ["block", "hybrid"];

/// The age of a scan at the wheel, with one way to wait in one place.
#[derive(Clone, Copy)]
struct Age<'a> {
    setting: &'a str,
    /// [ns] At the median.
    p50: f64,
    /// [ns] One in a hundred is older.
    p99: f64,
}

/// For each rate that was measured, what is recommended: among the ways that sleep, and whatever it
/// costs. Nothing where the default was not measured.
pub(crate) fn write(figures: &[Figure], text: &mut String) {
    let mut rates: Vec<&str> = Vec::new();
    for figure in figures.iter().filter(|figure| figure.name.starts_with(AGE)) {
        let rate = figure.name.rsplit(", ").next().unwrap_or_default();
        if !rates.contains(&rate) {
            rates.push(rate);
        }
    }
    let advice: Vec<_> = rates.iter().filter_map(|rate| for_rate(figures, rate)).collect();
    if !advice.is_empty() {
        text.push_str("\nrecommended here: `wait` and `cpu_affinity` of the launch file\n");
    }
    for line in &advice {
        let _ = writeln!(text, "  {line}");
    }
    if advice.iter().any(|line| line.contains("two cores")) {
        text.push_str(
            "  two cores: simulator and pairing on one, odometry and controller on another\n",
        );
    }
}

fn for_rate(figures: &[Figure], rate: &str) -> Option<String> {
    let ending = format!(", {rate}");
    let ages: Vec<_> = figures
        .iter()
        .filter_map(|figure| {
            let setting = figure.name.strip_prefix(AGE)?.strip_suffix(&ending)?;
            Some(Age { setting, p50: figure.p50, p99: figure.p99? })
        })
        .collect();
    let default = *ages.iter().find(|age| age.setting == DEFAULT)?;
    let sleeps = |age: &Age<'_>| SLEEPING.iter().any(|way| age.setting.starts_with(way));
    let p99_max = LATER * default.p99;
    let quiet = best(ages.iter().copied().filter(sleeps), default, p99_max);
    let any = best(ages.iter().copied(), quiet, p99_max);
    let mut line = format!("{rate:<8} {}", told(quiet));
    if any.setting != quiet.setting {
        let _ = write!(line, "; where cores are to spare: {}", told(any));
    }
    Some(line)
}

/// The youngest of those that are old one time in a hundred at most, unless it is no younger than
/// `known`.
fn best<'a>(ages: impl Iterator<Item = Age<'a>>, known: Age<'a>, p99_max: f64) -> Age<'a> {
    ages.filter(|age| age.p50 < GAIN * known.p50 && age.p99 <= p99_max)
        .min_by(|one, other| one.p50.total_cmp(&other.p50))
        .unwrap_or(known)
}

fn told(age: Age<'_>) -> String {
    let [p50, p99] = [age.p50, age.p99].map(|nanoseconds| nanoseconds / 1e3);
    format!("{} ({p50:.0} us, p99 {p99:.0})", age.setting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::Unit;

    fn age(setting: &str, p50_us: f64, p99_us: f64) -> Figure {
        Figure {
            row: "loop".to_owned(),
            name: format!("{AGE}{setting}, 20 Hz"),
            unit: Unit::Nanoseconds,
            count: 100,
            p50: 1e3 * p50_us,
            p90: None,
            p99: Some(1e3 * p99_us),
            p999: None,
            max: 1e3 * p99_us,
            rounds: Vec::new(),
        }
    }

    fn advice(figures: &[Figure]) -> String {
        let mut text = String::new();
        write(figures, &mut text);
        text
    }

    #[test]
    fn what_is_younger_is_recommended_and_said_apart_where_it_costs_a_core() {
        let text = advice(&[
            age("block, any core", 100.0, 300.0),
            age("block, one core", 80.0, 200.0),
            age("yield, any core", 20.0, 400.0),
        ]);
        assert!(text.contains("20 Hz    block, one core (80 us, p99 200)"), "{text}");
        assert!(text.contains("to spare: yield, any core (20 us, p99 400)"), "{text}");
    }

    #[test]
    fn noise_and_a_long_tail_recommend_nothing() {
        let text = advice(&[
            age("block, any core", 100.0, 300.0),
            age("hybrid, any core", 95.0, 250.0),
            age("poll, any core", 20.0, 9_000.0),
        ]);
        assert!(text.ends_with("20 Hz    block, any core (100 us, p99 300)\n"), "{text}");
    }

    #[test]
    fn without_the_default_there_is_nothing_to_compare_with() {
        assert_eq!(advice(&[age("yield, any core", 20.0, 400.0)]), "");
    }
}

//! Two runs, figure by figure: faster, slower, or no difference that can be told from noise.

use std::fmt::Write;

use crate::headline::CONTAMINATED_MAX;
use crate::measured::{Book, Figure};

/// [-] How likely rounds of equal processes may lie as far apart as these.
const CHANCE_MAX: f64 = 0.02;

/// [-] A smaller difference interests nobody.
const CHANGE_MIN: f64 = 0.03;

/// What can be said of two figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Better,
    Worse,
    /// The noise is as large as the difference, or there is none.
    Same,
    /// Too many rounds of one of them were contaminated.
    TooBusy,
}

/// The verdicts in words, one line each where there is a difference, and how many there are.
pub(crate) fn write(new: &Book, old: &Book, text: &mut String) {
    let _ = writeln!(text, "\ncompared with the older run (load {:.2})", old.card.load_before);
    if !new.card.is_same_machine(&old.card) {
        let _ = writeln!(text, "  another machine ({}): nothing can be told", old.card.cpu);
        return;
    }
    let mut counts = [0; 4];
    for figure in &new.figures {
        let is_it = |old: &&Figure| {
            old.row == figure.row && old.name == figure.name && old.unit == figure.unit
        };
        let Some(old) = old.figures.iter().find(is_it) else { continue };
        let verdict = verdict(figure, old);
        counts[verdict as usize] += 1;
        let word = match verdict {
            Verdict::Better => "faster",
            Verdict::Worse => "slower",
            Verdict::Same | Verdict::TooBusy => continue,
        };
        let word = if figure.unit.is_more_better() || figure.unit.label() == "us" {
            word
        } else if verdict == Verdict::Better {
            "less"
        } else {
            "more"
        };
        let change = ratio(figure, old);
        let name = format!("{}: {}", figure.row, figure.name);
        let _ = writeln!(
            text,
            "  {name:<66}{:>10} to {:>9} {:<4} x {change:.2}  {word}",
            figure.unit.text(old.p50),
            figure.unit.text(figure.p50),
            figure.unit.label()
        );
    }
    let [better, worse, same, busy] = counts;
    let _ = writeln!(
        text,
        "  {better} better, {worse} worse; of {same} no difference can be told; of {busy} nothing, \
         since others were busy"
    );
    if 0 == better + worse {
        let _ = writeln!(text, "  no difference can be told");
    }
}

/// A rank test over the rounds, and a difference worth telling.
pub(crate) fn verdict(new: &Figure, old: &Figure) -> Verdict {
    let is_busy = |figure: &Figure| {
        CONTAMINATED_MAX * (figure.rounds.len() as f64) < figure.contaminated() as f64
    };
    if is_busy(new) || is_busy(old) {
        return Verdict::TooBusy;
    }
    let values =
        |figure: &Figure| figure.rounds.iter().map(|round| round.value).collect::<Vec<_>>();
    let change = ratio(new, old);
    if CHANCE_MAX < chance(&values(new), &values(old)) || (change - 1.0).abs() < CHANGE_MIN {
        return Verdict::Same;
    }
    if (1.0 < change) == new.unit.is_more_better() { Verdict::Better } else { Verdict::Worse }
}

/// [-] The median of all quotients of a round of one and a round of the other.
fn ratio(new: &Figure, old: &Figure) -> f64 {
    let quotients = new
        .rounds
        .iter()
        .flat_map(|new| old.rounds.iter().map(|old| new.value / old.value).collect::<Vec<_>>());
    crate::measured::median(&quotients.collect::<Vec<_>>()).unwrap_or(1.0)
}

/// [-] How likely two samples of one distribution lie at least as far apart as these: Mann and
/// Whitney's U, exact, two-sided. Equals are counted for neither.
fn chance(one: &[f64], other: &[f64]) -> f64 {
    let pairs = one.len() * other.len();
    let below =
        one.iter().map(|one| other.iter().filter(|other| one < *other).count()).sum::<usize>();
    let above =
        one.iter().map(|one| other.iter().filter(|other| *other < one).count()).sum::<usize>();
    // Half of the equals on either side; the half that is left makes it less extreme.
    let extreme = below.min(above) + (pairs - below - above).div_ceil(2);
    let ways = ways(one.len(), other.len());
    let all: f64 = ways.iter().sum();
    let tail: f64 = ways.iter().take(extreme + 1).sum();
    (2.0 * tail / all).min(1.0)
}

/// [-] In how many orders of `one` and `other` values U is 0, 1, and so on.
fn ways(one: usize, other: usize) -> Vec<f64> {
    // By the largest of all: it is one of the first, and lies above all of the second, or not.
    let mut table = vec![vec![vec![1.0]; other + 1]; one + 1];
    for first in 1..=one {
        for second in 1..=other {
            let mut ways = vec![0.0; first * second + 1];
            for (u, count) in table[first - 1][second].iter().enumerate() {
                ways[u + second] += count;
            }
            for (u, count) in table[first][second - 1].iter().enumerate() {
                ways[u] += count;
            }
            table[first][second] = ways;
        }
    }
    table[one][other].clone()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::busy::Others;
    use crate::measured::{Round, Unit};

    fn figure(unit: Unit, values: &[f64], contaminated: bool) -> Figure {
        let others = Others { contaminated, ..Others::default() };
        Figure {
            row: "hop".to_owned(),
            name: "x".to_owned(),
            unit,
            count: 5,
            p50: values[0],
            p90: None,
            p99: None,
            p999: None,
            max: values[0],
            rounds: values.iter().map(|&value| Round { value, count: 1, others }).collect(),
        }
    }

    const QUIET: [f64; 5] = [100.0, 101.0, 99.0, 102.0, 98.0];

    fn times(factor: f64) -> Vec<f64> {
        QUIET.iter().map(|value| value * factor).collect()
    }

    fn of(unit: Unit, new: &[f64], old: &[f64]) -> Verdict {
        verdict(&figure(unit, new, false), &figure(unit, old, false))
    }

    #[test]
    fn orders_are_counted_as_in_the_tables() {
        assert_eq!(ways(2, 2), [1.0, 1.0, 2.0, 1.0, 1.0]);
        assert!((ways(5, 5).iter().sum::<f64>() - 252.0).abs() < 1e-9);
        assert!(
            (chance(&[1.0, 2.0, 3.0, 4.0, 5.0], &[6.0, 7.0, 8.0, 9.0, 10.0]) - 2.0 / 252.0).abs()
                < 1e-9
        );
    }

    #[test]
    fn a_run_does_not_differ_from_itself() {
        assert_eq!(of(Unit::Nanoseconds, &QUIET, &QUIET), Verdict::Same);
        assert_eq!(of(Unit::Nanoseconds, &[7.0; 5], &[7.0; 5]), Verdict::Same);
    }

    #[test]
    fn what_takes_twice_as_long_is_worse_and_what_does_twice_as_much_is_better() {
        assert_eq!(of(Unit::Nanoseconds, &times(2.0), &QUIET), Verdict::Worse);
        assert_eq!(of(Unit::Nanoseconds, &times(0.5), &QUIET), Verdict::Better);
        assert_eq!(of(Unit::PerSecond, &times(2.0), &QUIET), Verdict::Better);
        assert_eq!(of(Unit::PerSecond, &times(0.5), &QUIET), Verdict::Worse);
    }

    #[test]
    fn what_the_noise_covers_and_what_is_small_is_no_difference() {
        assert_eq!(of(Unit::Nanoseconds, &[90.0, 140.0, 95.0, 180.0, 99.0], &QUIET), Verdict::Same);
        assert_eq!(of(Unit::Nanoseconds, &[101.0; 5], &[100.0; 5]), Verdict::Same);
        assert_eq!(of(Unit::Nanoseconds, &times(2.0)[..2], &QUIET[..2]), Verdict::Same);
    }

    #[test]
    fn a_busy_machine_gives_no_verdict() {
        let old = figure(Unit::Nanoseconds, &QUIET, true);
        assert_eq!(verdict(&figure(Unit::Nanoseconds, &times(2.0), false), &old), Verdict::TooBusy);
    }
}

//! The headline: ratios within one run, each against its goal, or the words that refuse it.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::busy::{FOREIGN_MAX, STEAL_MAX};
use crate::measured::{Figure, median};

/// [-] Of the rounds that the headline is made of; where more are contaminated, there is none.
pub(crate) const CONTAMINATED_MAX: f64 = 0.25;

/// What a reader remembers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Headline {
    /// Why none of the ratios is to be believed, where that is so.
    pub refused: Option<String>,
    /// [-] The ratios.
    pub ratios: Vec<Ratio>,
}

/// One figure over another of the same run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ratio {
    /// What over what.
    pub name: String,
    /// [-] It shall be no more than this.
    pub goal: f64,
    /// [-] The median over the rounds, each compared with its neighbour in time.
    pub value: f64,
    /// [-] The least of a round.
    pub least: f64,
    /// [-] The greatest of a round.
    pub greatest: f64,
}

/// One row of the table of goals.
#[derive(Clone)]
struct Goal {
    row: &'static str,
    name: String,
    of: String,
    over: String,
    /// [-] Of what it is compared with.
    times: f64,
    most: f64,
}

impl Headline {
    /// Of whatever was measured.
    pub(crate) fn of(figures: &[Figure], contaminated_max: f64) -> Self {
        let find = |row: &str, name: &str| {
            figures.iter().find(|figure| figure.row == row && figure.name == name)
        };
        let (mut rounds, mut contaminated) = (0, 0);
        let mut ratios = Vec::new();
        for goal in goals() {
            let Some((of, over)) = find(goal.row, &goal.of).zip(find("hop", &goal.over)) else {
                continue;
            };
            for figure in [of, over] {
                rounds += figure.rounds.len();
                contaminated += figure.contaminated();
            }
            ratios.extend(goal.ratio(of, over));
        }
        let share = if rounds == 0 { 0.0 } else { contaminated as f64 / rounds as f64 };
        let refused = (contaminated_max < share).then(|| {
            format!(
                "too busy to say: others had more than {:.0} % of the processors, or the host more \
                 than {:.0} %, in {contaminated} of the {rounds} rounds that count, and {:.0} % of \
                 them is the limit",
                FOREIGN_MAX * 100.0,
                STEAL_MAX * 100.0,
                contaminated_max * 100.0
            )
        });
        Self { refused, ratios }
    }

    /// For a person.
    pub(crate) fn write(&self, text: &mut String) {
        if self.ratios.is_empty() {
            return;
        }
        let _ = writeln!(
            text,
            "\n{:<68}{:>7}{:>15}{:>7}",
            "headline: ratios in this run", "goal", "of rounds", "ratio"
        );
        for ratio in &self.ratios {
            let rounds = format!("{:.2}..{:.2}", ratio.least, ratio.greatest);
            let (value, verdict) = match (&self.refused, ratio.value <= ratio.goal) {
                (Some(_), _) => ("?".to_owned(), ""),
                (None, true) => (format!("{:.2}", ratio.value), "  reached"),
                (None, false) => (format!("{:.2}", ratio.value), "  missed"),
            };
            let _ = writeln!(
                text,
                "  {:<66}{:>7}{rounds:>15}{value:>7}{verdict}",
                ratio.name, ratio.goal
            );
        }
        if let Some(refused) = &self.refused {
            let _ = writeln!(text, "  {refused}");
        }
    }
}

impl Goal {
    /// Round by round, since neighbours in time met the same machine.
    fn ratio(&self, of: &Figure, over: &Figure) -> Option<Ratio> {
        let rounds = of.rounds.iter().zip(&over.rounds);
        let ratios: Vec<_> =
            rounds.map(|(of, over)| of.value / (self.times * over.value)).collect();
        Some(Ratio {
            name: self.name.clone(),
            goal: self.most,
            value: median(&ratios)?,
            least: ratios.iter().copied().fold(f64::INFINITY, f64::min),
            greatest: ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

fn goals() -> Vec<Goal> {
    [polled(), woken(), untouched(), whole_loop()].concat()
}

const NEAR: &str = "across cores, back to back";

/// `who` over `whom`, both with `size` as `place` has it.
fn hop(who: &str, whom: &str, size: &str, place: &str, most: f64) -> Goal {
    Goal {
        row: "hop",
        name: format!("{who} over {whom}, {size}, {place}"),
        of: format!("{who}, {size}, {place}"),
        over: format!("{whom}, {size}, {place}"),
        times: 1.0,
        most,
    }
}

fn polled() -> Vec<Goal> {
    let plain = ["64 B", "a scan"].map(|size| hop("teseo poll", "iceoryx2 poll", size, NEAR, 1.05));
    let flag = ["64 B", "a scan", "64 KiB", "1 MiB"]
        .map(|size| hop("teseo poll", "flag", size, NEAR, 2.0));
    plain.into_iter().chain(flag).collect()
}

fn woken() -> Vec<Goal> {
    let goal = |who, place, most| hop(who, "futex", "64 B", place, most);
    vec![
        goal("teseo block", NEAR, 1.1),
        goal("teseo block", "across cores, 1 kHz", 1.3),
        goal("teseo block", "across cores, 40 Hz", 1.6),
        goal("teseo yield", "one core, back to back", 1.2),
        goal("teseo block", "one core, back to back", 3.0),
    ]
}

/// From 64 bytes to a mebibyte nothing may change where nobody touches the payload.
fn untouched() -> Vec<Goal> {
    let goal = |who: &str| Goal {
        row: "hop",
        name: format!("{who} not touched, 1 MiB over 64 B"),
        of: format!("{who}, 1 MiB, {NEAR}, not touched"),
        over: format!("{who}, 64 B, {NEAR}, not touched"),
        times: 1.0,
        most: 1.1,
    };
    vec![goal("iceoryx2 bare"), goal("teseo poll")]
}

/// [-] Odometry, pairing, controller and simulator wake one after another.
const WAKE_UPS: f64 = 4.0;

/// Against as many wake-ups as the loop has, each at the pace of the loop.
fn whole_loop() -> Vec<Goal> {
    let goal = |setting: &str, rate: &str, pace: &str, most| Goal {
        row: "loop",
        name: format!("scan to wheel over 4 futexes, {setting}, {rate}"),
        of: format!("scan to wheel, {setting}, {rate}"),
        over: format!("futex, 64 B, across cores, {pace}"),
        times: WAKE_UPS,
        most,
    };
    vec![
        goal("block, any core", "20 Hz", "40 Hz", 1.3),
        goal("block, any core", "1000 Hz", "1 kHz", 1.3),
        // Whichever placement is the best one here.
        goal("yield, any core", "20 Hz", "40 Hz", 0.3),
        goal("yield, one core", "20 Hz", "40 Hz", 0.3),
        goal("yield, two cores", "20 Hz", "40 Hz", 0.3),
        goal("yield, any core", "1000 Hz", "1 kHz", 0.3),
        goal("yield, one core", "1000 Hz", "1 kHz", 0.3),
        goal("yield, two cores", "1000 Hz", "1 kHz", 0.3),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::busy::Others;
    use crate::measured::{Round, Unit};

    fn figure(name: &str, values: &[f64], contaminated: usize) -> Figure {
        let round = |(index, &value): (usize, &f64)| {
            let others = Others { contaminated: index < contaminated, ..Others::default() };
            Round { value, count: 1, others }
        };
        Figure {
            row: "hop".to_owned(),
            name: name.to_owned(),
            unit: Unit::Nanoseconds,
            count: values.len() as u64,
            p50: values[0],
            p90: None,
            p99: None,
            p999: None,
            max: values[0],
            rounds: values.iter().enumerate().map(round).collect(),
        }
    }

    fn figures(contaminated: usize) -> [Figure; 2] {
        [
            figure(
                "teseo poll, 64 B, across cores, back to back",
                &[2.0, 40.0, 3.0, 2.0],
                contaminated,
            ),
            figure("flag, 64 B, across cores, back to back", &[1.0, 20.0, 1.0, 1.0], 0),
        ]
    }

    #[test]
    fn a_ratio_compares_neighbours_in_time() {
        let headline = Headline::of(&figures(0), CONTAMINATED_MAX);
        let [ratio] = &headline.ratios[..] else { panic!("{headline:?}") };
        assert!(
            (ratio.value - 2.0).abs() < 1e-9 && (ratio.greatest - 3.0).abs() < 1e-9,
            "{ratio:?}"
        );
        assert_eq!(headline.refused, None);
    }

    #[test]
    fn a_busy_machine_is_refused_in_words() {
        let headline = Headline::of(&figures(3), CONTAMINATED_MAX);
        assert!(headline.refused.as_ref().unwrap().starts_with("too busy to say"), "{headline:?}");
        let mut text = String::new();
        headline.write(&mut text);
        assert!(!text.contains("reached") && text.contains('?'), "{text}");
    }

    #[test]
    fn every_goal_is_of_something_that_is_measured() {
        let (hops, _) = crate::hop::configurations(2);
        let names: Vec<_> = hops.iter().map(crate::hop::Hop::name).collect();
        let loops: Vec<_> =
            crate::chain::configurations().iter().flat_map(crate::chain::Chain::names).collect();
        for goal in goals() {
            assert!(names.contains(&goal.over), "{}", goal.over);
            assert!(names.contains(&goal.of) || loops.contains(&goal.of), "{}", goal.of);
        }
    }
}

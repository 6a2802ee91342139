//! What came of the runs, by cell.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::Figures;
use super::cell::{Cell, Phase};

/// [ms] Within this after the last valid command the stop is commanded: the time-out, and 20 ms.
const GOAL_SILENCE: f64 = 220.0;

/// [ms] Within this after the loss of the supervisor.
const GOAL_SUPERVISOR: f64 = 50.0;

/// What came of all runs, by cell and figure.
#[derive(Default)]
pub(super) struct Table(BTreeMap<Cell, BTreeMap<String, Vec<f64>>>);

impl Table {
    pub(super) fn add(&mut self, cell: Cell, figures: Figures) {
        let all = self.0.entry(cell).or_default();
        for (name, figure) in figures {
            let of_name = all.entry(name).or_default();
            let place = of_name.partition_point(|other| *other < figure);
            of_name.insert(place, figure);
        }
    }

    /// The cells in which the stop came later than it shall.
    pub(super) fn missed(&self) -> Vec<String> {
        let goals = [("silent", GOAL_SILENCE), ("lost", GOAL_SUPERVISOR)];
        let cells = self.0.iter().flat_map(|(cell, figures)| {
            goals.iter().filter_map(move |(name, goal)| {
                let worst = *figures.get(*name)?.last()?;
                (*goal < worst).then(|| format!("{cell}: {worst:.1} ms of {goal:.0} ms"))
            })
        });
        cells.collect()
    }

    /// The median and the worst of each figure, as Markdown; the moving robot's cells first.
    pub(super) fn print(&self) -> String {
        let mut text = String::new();
        let (at_rest, moving): (Vec<_>, Vec<_>) =
            self.0.iter().partition(|(cell, _)| cell.is_at_rest());
        text.push_str(
            "| fault | phase | n | stop commanded | standstill | way, mm | moves again \
             | nothing left | files |\n|---|---|--:|--:|--:|--:|--:|--:|--:|\n",
        );
        for (cell, figures) in moving {
            // On the way down, the stop has mostly been commanded before the fault.
            let count = |name: &&str| figures.get(*name).map_or(0, Vec::len);
            let stop = ["lost", "silent"].into_iter().max_by_key(count).unwrap();
            let stop = [stop, "standstill", "way"].map(|name| summary(figures, name)).join(" | ");
            let _ = writeln!(text, "{} | {stop} | {}", head(*cell, figures), tail(*cell, figures));
        }
        text.push_str(
            "\n| fault | phase | n | moves | nothing left | files |\n|---|---|--:|--:|--:|--:|\n",
        );
        for (cell, figures) in at_rest {
            let _ = writeln!(text, "{} | {}", head(*cell, figures), tail(*cell, figures));
        }
        text
    }
}

/// The first columns of its row.
fn head(cell: Cell, figures: &BTreeMap<String, Vec<f64>>) -> String {
    let [fault, victim, phase] = cell.labels();
    format!("| {fault} {victim} | {phase} | {}", figures["files"].len())
}

/// The last ones: how the robot came back or was gone, and the most that was left: at once, and
/// after the next run.
fn tail(cell: Cell, figures: &BTreeMap<String, Vec<f64>>) -> String {
    let back = summary(figures, "back");
    let none = "–".to_owned();
    let is_over = cell.ends_the_run() || cell.phase == Phase::Stopping;
    let (again, gone) = if is_over { (none, back) } else { (back, none) };
    let worst = |name: &str| figures.get(name).map_or(0.0, |all| all[all.len() - 1]);
    let (before, after) = (worst("before"), worst("files"));
    let files = if after < before { format!("{before}, {after}") } else { format!("{after}") };
    format!("{again} | {gone} | {files} |")
}

fn summary(figures: &BTreeMap<String, Vec<f64>>, name: &str) -> String {
    figures.get(name).map_or_else(
        || "–".to_owned(),
        |all| format!("{:.0} / {:.0}", all[(all.len() - 1) / 2], all[all.len() - 1]),
    )
}

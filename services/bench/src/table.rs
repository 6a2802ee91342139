//! The figures as people and spreadsheets read them.

use std::fmt::Write;

use crate::advice;
use crate::measured::{Book, Figure};

/// What each row is, in the order in which they are told.
const ROWS: [(&str, &str); 6] = [
    (
        "hop",
        "one hop: payload written in full, sent, received, read in full; back to back it is half a \
         round trip, else the time from before writing until after reading",
    ),
    ("pair", "pairing, and a pair by ticket: from receiving until both samples are found, or read"),
    (
        "loop",
        "the whole loop in real time, as its nodes tell it: the age of a scan, where the median is that \
         of the rounds' medians",
    ),
    (
        "bridge",
        "the bridge before an emulated TurtleBot3, by the turn of its loop that hears or reads; the median \
         is that of the rounds' medians",
    ),
    (
        "lockstep",
        "lock-step in the lab's maze, no noise: four processes and the supervisor, or all in one process; of \
         several robots, the steps of all together",
    ),
    ("cost", "what a robot takes"),
];

/// For a person.
pub(crate) fn text(book: &Book) -> String {
    let mut text = String::new();
    book.card.write(&mut text);
    for (row, what) in ROWS {
        let figures: Vec<_> = book.figures.iter().filter(|figure| figure.row == row).collect();
        if figures.is_empty() {
            continue;
        }
        let width = figures.iter().map(|figure| figure.name.len()).max().unwrap_or_default();
        let _ = write!(text, "\n{what}\n  {:<width$}", "");
        for column in ["p50", "p90", "p99", "p99.9", "max", "count"] {
            let _ = write!(text, "{column:>9}");
        }
        let _ = writeln!(text, "  {:<18}busy", "p50 of rounds");
        for figure in figures {
            line(figure, width, &mut text);
        }
    }
    if !book.absent.is_empty() {
        let _ = writeln!(text, "\nnot measured");
    }
    for absent in &book.absent {
        let _ = writeln!(text, "  {absent}");
    }
    book.headline.write(&mut text);
    if book.headline.refused.is_none() {
        advice::write(&book.figures, &mut text);
    }
    text
}

fn line(figure: &Figure, width: usize, text: &mut String) {
    let unit = figure.unit;
    let _ = write!(text, "  {:<width$}", figure.name);
    // A quantile of fewer values than it needs is but the greatest of them.
    let of = |quantile: Option<f64>, least: u64| quantile.filter(|_| least <= figure.count);
    let (p99, p999) = (of(figure.p99, 100), of(figure.p999, 1000));
    for value in [Some(figure.p50), figure.p90, p99, p999, Some(figure.max)] {
        let _ =
            write!(text, "{:>9}", value.map_or_else(|| "-".to_owned(), |value| unit.text(value)));
    }
    let (least, greatest) = figure.spread();
    let spread = format!("{}..{} {}", unit.text(least), unit.text(greatest), unit.label());
    let _ = write!(text, "{:>9}  ", figure.count);
    let contaminated = figure.contaminated();
    let _ = if contaminated == 0 {
        writeln!(text, "{spread}")
    } else {
        writeln!(text, "{spread:<18}{contaminated}/{}", figure.rounds.len())
    };
}

/// For a spreadsheet: a line for each round of each figure.
pub(crate) fn csv(book: &Book) -> String {
    let mut text =
        "row,name,unit,round,value,count,foreign_share,steal_share,contaminated\n".to_owned();
    for figure in &book.figures {
        for (number, round) in (1..).zip(&figure.rounds) {
            let others = round.others;
            let unit = serde_json::to_value(figure.unit).unwrap_or_default();
            let _ = writeln!(
                text,
                "{},\"{}\",{},{number},{},{},{},{},{}",
                figure.row,
                figure.name,
                unit.as_str().unwrap_or_default(),
                round.value,
                round.count,
                others.foreign,
                others.steal,
                others.contaminated
            );
        }
    }
    text
}

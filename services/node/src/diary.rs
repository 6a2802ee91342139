//! What a node notes about itself over time, for the report of a run: kept in memory while it drives,
//! written to a file when it is taken down. A node that is killed takes its notes along.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::rc::Rc;

use interfaces::Stamp;

use crate::figures::Figures;
use crate::{Settings, arguments};

/// The environment variable that names the directory of a run's records; without it nobody notes.
pub const RECORDS: &str = "TESEO_RECORDS";

/// [-] Rows that a diary has room for. When they are full, every second one goes, and from then on
/// only half as many are taken down: a run may last as long as it likes.
const ROWS_MAX: usize = 4096;

/// A node's notes: rows of numbers, each with the moment that it is about. At no cost where nobody
/// wants them.
#[derive(Debug, Clone, Default)]
pub struct Diary(Option<Rc<RefCell<Rows>>>);

#[derive(Debug)]
struct Rows {
    keys: Vec<String>,
    /// Row by row, each with its stamp [s] first.
    numbers: Vec<f64>,
    /// [-] Of so many rows one is taken down.
    every: usize,
    /// [-] Rows since the last one that was.
    skipped: usize,
}

impl Diary {
    fn new(keys: &[&str]) -> Self {
        let numbers = Vec::with_capacity(ROWS_MAX * (1 + keys.len()));
        let keys = keys.iter().map(|&key| key.to_owned()).collect();
        Self(Some(Rc::new(RefCell::new(Rows { keys, numbers, every: 1, skipped: 0 }))))
    }

    /// Whether somebody wants it.
    pub const fn is_kept(&self) -> bool {
        self.0.is_some()
    }

    /// Takes down one row, a value for each key, about the moment `stamp` of the robot's own time.
    pub fn note<const N: usize>(&self, stamp: Stamp, values: [f64; N]) {
        if let Some(rows) = &self.0 {
            rows.borrow_mut().push(stamp, &values);
        }
    }
}

impl Rows {
    fn push(&mut self, stamp: Stamp, values: &[f64]) {
        debug_assert_eq!(values.len(), self.keys.len(), "a value for each of {:?}", self.keys);
        self.skipped += 1;
        if self.skipped < self.every {
            return;
        }
        self.skipped = 0;
        let width = 1 + self.keys.len();
        if self.numbers.len() == ROWS_MAX * width {
            for row in 1..ROWS_MAX / 2 {
                self.numbers.copy_within(2 * row * width..(2 * row + 1) * width, row * width);
            }
            self.numbers.truncate(ROWS_MAX / 2 * width);
            self.every *= 2;
        }
        self.numbers.push(stamp.seconds());
        self.numbers.extend_from_slice(values);
    }

    fn csv(&self) -> String {
        let mut text = format!("stamp_s,{}\n", self.keys.join(","));
        for row in self.numbers.chunks(1 + self.keys.len()) {
            let row: Vec<_> = row.iter().map(|number| format!("{number:?}")).collect();
            let _ = writeln!(text, "{}", row.join(","));
        }
        text
    }
}

/// Where a node's records go, and what is in them.
#[derive(Debug, Default)]
pub(crate) struct Records {
    /// All its files' names begin so.
    place: Option<PathBuf>,
    diary: Diary,
}

impl Records {
    pub(crate) fn new(settings: &Settings) -> Self {
        let name = format!("{}.{}", settings.name(), settings.epoch());
        let directory = arguments::given(RECORDS);
        Self { place: directory.map(|directory| directory.join(name)), ..Self::default() }
    }

    pub(crate) fn diary(&mut self, keys: &[&str]) -> Diary {
        if self.place.is_some() {
            self.diary = Diary::new(keys);
        }
        self.diary.clone()
    }

    /// Writes all that was noted and measured; the robot stands. What cannot be written is lost, and
    /// that is said.
    pub(crate) fn write(&self, figures: &Figures) {
        let Some(place) = &self.place else { return };
        let write = |kind: &str, text: String| {
            let path = PathBuf::from(format!("{}.{kind}", place.display()));
            if let Err(cause) = fs::write(&path, text) {
                tracing::warn!(%cause, path = %path.display(), "cannot write a record");
            }
        };
        if let Some(rows) = &self.diary.0 {
            write("diary.csv", rows.borrow().csv());
        }
        write("latency.csv", figures.latency_csv());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(seconds: usize) -> Stamp {
        Stamp::ZERO.after(std::time::Duration::from_secs(seconds as u64))
    }

    #[test]
    fn a_row_has_its_stamp_and_a_value_for_each_key() {
        let diary = Diary::new(&["x_m", "y_m"]);
        diary.note(stamp(1), [0.5, f64::INFINITY]);
        let text = diary.0.unwrap().borrow().csv();
        assert_eq!(text, "stamp_s,x_m,y_m\n1.0,0.5,inf\n");
    }

    // Broken on purpose: kept without thinning, the diary of a long run grew without end.
    #[test]
    fn however_long_the_run_the_diary_is_evenly_spaced_and_no_longer() {
        let diary = Diary::new(&["x_m"]);
        let room = diary.0.as_ref().unwrap().borrow().numbers.capacity();
        let last = 10 * ROWS_MAX;
        for second in 0..=last {
            diary.note(stamp(second), [second as f64]);
        }
        let rows = diary.0.as_ref().unwrap().borrow();
        assert_eq!(rows.numbers.capacity(), room);
        let stamps: Vec<_> = rows.numbers.iter().step_by(2).collect();
        let steps: Vec<_> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(ROWS_MAX / 2 <= stamps.len(), "{}", stamps.len());
        assert!(steps.iter().all(|step| (*step - 16.0).abs() < 1e-9), "{steps:?}");
        assert!(stamps[0].abs() < 1e-9, "{stamps:?}");
    }
}

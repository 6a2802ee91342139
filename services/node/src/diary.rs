//! What a node notes about itself over time, for the report of a run: kept in memory while it drives,
//! written to a file when it is taken down. A copy lies in shared memory, where a node that is killed
//! leaves it to its supervisor.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use interfaces::Stamp;

use crate::figures::Figures;
use crate::{Error, Namespace, Result, Settings, arguments};

/// The environment variable that names the directory of a run's records; without it nobody notes.
pub const RECORDS: &str = "TESEO_RECORDS";

/// What the name of a copy has after its robot's prefix; node and life follow, with full stops between.
const COPY: &str = "diary.";

/// What a copy's name ends in while it is made.
const FRESH: &str = "new";

/// What a diary is called after its node and life.
const KIND: &str = "diary.csv";

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
    copy: Option<Copy>,
}

/// The rows of a diary in shared memory: a line of keys, then the numbers as they lie in memory. A write
/// there touches no disk and holds nobody up.
#[derive(Debug)]
struct Copy {
    path: PathBuf,
    file: File,
}

impl Diary {
    fn new(keys: &[&str], copy: Option<PathBuf>) -> Self {
        let numbers = Vec::with_capacity(ROWS_MAX * (1 + keys.len()));
        let keys: Vec<_> = keys.iter().map(|&key| key.to_owned()).collect();
        let copy = copy.and_then(|path| kept(Copy::new(path, &head(&keys), &[])));
        Self(Some(Rc::new(RefCell::new(Rows { keys, numbers, every: 1, skipped: 0, copy }))))
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
            let path = self.copy.take().map(|copy| copy.path);
            self.copy =
                path.and_then(|path| kept(Copy::new(path, &head(&self.keys), &self.numbers)));
        }
        let begin = self.numbers.len();
        self.numbers.push(stamp.seconds());
        self.numbers.extend_from_slice(values);
        self.copy = self.copy.take().and_then(|copy| kept(copy.push(&self.numbers[begin..])));
    }

    fn csv(&self) -> String {
        csv(&head(&self.keys), &self.numbers)
    }
}

fn head(keys: &[String]) -> String {
    format!("stamp_s,{}", keys.join(","))
}

fn csv(head: &str, numbers: &[f64]) -> String {
    let mut text = format!("{head}\n");
    for row in numbers.chunks(head.split(',').count()) {
        let row: Vec<_> = row.iter().map(|number| format!("{number:?}")).collect();
        let _ = writeln!(text, "{}", row.join(","));
    }
    text
}

impl Copy {
    /// Through a rename: whoever is killed meanwhile leaves the former copy whole.
    fn new(path: PathBuf, head: &str, numbers: &[f64]) -> io::Result<Self> {
        let fresh = PathBuf::from(format!("{}.{FRESH}", path.display()));
        let mut file = File::create(&fresh)?;
        writeln!(file, "{head}")?;
        file.write_all(bytemuck::cast_slice(numbers))?;
        fs::rename(&fresh, &path)?;
        Ok(Self { path, file })
    }

    fn push(mut self, row: &[f64]) -> io::Result<Self> {
        self.file.write_all(bytemuck::cast_slice(row))?;
        Ok(self)
    }
}

impl Drop for Rows {
    /// A node that ends in order has written its notes down.
    fn drop(&mut self) {
        if let Some(copy) = self.copy.as_ref().filter(|_| !std::thread::panicking()) {
            let _ = fs::remove_file(&copy.path);
        }
    }
}

/// Where there is no room for a copy there is none.
fn kept(copy: io::Result<Copy>) -> Option<Copy> {
    copy.inspect_err(|cause| tracing::warn!(%cause, "notes are lost if this node is killed")).ok()
}

/// Writes down in `directory` what the killed nodes of `robot` had noted.
pub fn save_diaries_of_the_dead(robot: &Namespace, directory: &Path) -> Result {
    let prefix = format!("{}{COPY}", robot.prefix());
    for path in robot.segments() {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let Some(life) = name.strip_prefix(&prefix) else { continue };
        if path.extension().is_some_and(|end| end == FRESH) {
            continue;
        }
        let place = directory.join(format!("{life}.{KIND}"));
        let read = fs::read(&path).map_err(|cause| Error::File { path: path.clone(), cause })?;
        let written = fs::write(&place, rows_of(&read));
        written.map_err(|cause| Error::File { path: place, cause })?;
    }
    Ok(())
}

/// The table that lies in a copy. Its last row may be cut off.
fn rows_of(copy: &[u8]) -> String {
    let end = copy.iter().position(|&byte| byte == b'\n').unwrap_or(copy.len());
    let head = String::from_utf8_lossy(&copy[..end]);
    let bytes = copy.get(end + 1..).unwrap_or_default();
    let row = head.split(',').count() * size_of::<f64>();
    let whole = &bytes[..bytes.len() - bytes.len() % row];
    let number = |bytes: &[u8]| f64::from_ne_bytes(bytes.try_into().unwrap_or_default());
    let numbers: Vec<_> = whole.chunks_exact(size_of::<f64>()).map(number).collect();
    csv(&head, &numbers)
}

/// Where a node's records go, and what is in them.
#[derive(Debug, Default)]
pub(crate) struct Records {
    /// All its files' names begin so.
    place: Option<PathBuf>,
    copy: Option<PathBuf>,
    diary: Diary,
}

impl Records {
    pub(crate) fn new(settings: &Settings) -> Self {
        let name = format!("{}.{}", settings.name(), settings.epoch());
        let Some(directory) = arguments::given(RECORDS) else { return Self::default() };
        let robot = settings.namespace().ok();
        Self {
            copy: robot.map(|robot| robot.segment(&format!("{COPY}{name}"))),
            place: Some(directory.join(name)),
            diary: Diary::default(),
        }
    }

    pub(crate) fn diary(&mut self, keys: &[&str]) -> Diary {
        if self.place.is_some() {
            self.diary = Diary::new(keys, self.copy.clone());
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
            write(KIND, rows.borrow().csv());
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
        let diary = Diary::new(&["x_m", "y_m"], None);
        diary.note(stamp(1), [0.5, f64::INFINITY]);
        let text = diary.0.unwrap().borrow().csv();
        assert_eq!(text, "stamp_s,x_m,y_m\n1.0,0.5,inf\n");
    }

    #[test]
    fn the_copy_is_whole_at_every_moment_and_gone_when_the_node_ends_in_order() {
        let path = std::env::temp_dir().join(format!("teseo-diary-{}", std::process::id()));
        let diary = Diary::new(&["x_m", "y_m"], Some(path.clone()));
        for second in 0..2 * ROWS_MAX + 3 {
            diary.note(stamp(second), [second as f64, f64::NAN]);
            if second.is_multiple_of(509) || second.abs_diff(ROWS_MAX) < 3 {
                let expected = diary.0.as_ref().unwrap().borrow().csv();
                assert_eq!(rows_of(&fs::read(&path).unwrap()), expected, "{second}");
            }
        }
        let mut cut = fs::read(&path).unwrap();
        let whole = rows_of(&cut);
        cut.truncate(cut.len() - 5);
        assert_eq!(rows_of(&cut).lines().count() + 1, whole.lines().count());
        drop(diary);
        assert!(!path.exists());
    }

    // Broken on purpose: kept without thinning, the diary of a long run grew without end.
    #[test]
    fn however_long_the_run_the_diary_is_evenly_spaced_and_no_longer() {
        let diary = Diary::new(&["x_m"], None);
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

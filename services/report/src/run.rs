//! What a run has left in its directory.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use node::{Error, Result};
use serde_json::Value;

/// All that is known of a run.
pub(crate) struct Run {
    /// `report.json`.
    pub(crate) receipt: Value,
    /// `events.jsonl`, in order.
    pub(crate) events: Vec<Value>,
    /// What each node has noted.
    diaries: BTreeMap<String, Diary>,
    /// How long things took, by node and name: values [us] and how often each was met.
    pub(crate) latencies: BTreeMap<(String, String), Vec<(f64, u64)>>,
    /// The launch file as it was.
    pub(crate) launch: String,
}

/// What one node has noted over all its lives.
#[derive(Default)]
struct Diary {
    keys: Vec<String>,
    /// Each with its stamp [s] first.
    rows: Vec<Vec<f64>>,
}

impl Run {
    /// Reads what is there: only the receipt has to be.
    pub(crate) fn read(directory: &Path) -> Result<Self> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |cause| Error::File { path, cause }
        };
        let path = directory.join("report.json");
        let text = fs::read_to_string(&path).map_err(failed(&path))?;
        let receipt = serde_json::from_str(&text).map_err(|cause| {
            Error::Fault(format!("{} is no report: {cause}; make a new run", path.display()))
        })?;
        let events = fs::read_to_string(directory.join("events.jsonl")).unwrap_or_default();
        let mut run = Self {
            receipt,
            events: events.lines().filter_map(|line| serde_json::from_str(line).ok()).collect(),
            diaries: BTreeMap::new(),
            latencies: BTreeMap::new(),
            launch: fs::read_to_string(directory.join("launch.toml")).unwrap_or_default(),
        };
        let mut files: Vec<_> = fs::read_dir(directory)
            .map_err(failed(directory))?
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .collect();
        // A node's lives in their order.
        files.sort_by_key(|name| (name.len(), name.clone()));
        for name in files {
            let (mut parts, path) = (name.splitn(3, '.'), directory.join(&name));
            let node = parts.next().unwrap_or_default();
            let take_in = match parts.nth(1) {
                Some("diary.csv") => Self::add_diary,
                Some("latency.csv") => Self::add_latencies,
                _ => continue,
            };
            take_in(&mut run, node, &fs::read_to_string(&path).map_err(failed(&path))?);
        }
        run.begin_at_zero();
        Ok(run)
    }

    fn add_diary(&mut self, node: &str, text: &str) {
        let mut lines = text.lines();
        let Some(head) = lines.next() else { return };
        let diary = self.diaries.entry(node.to_owned()).or_default();
        diary.keys = head.split(',').map(str::to_owned).collect();
        let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
        let rows = lines.map(|line| line.split(',').map(number).collect::<Vec<_>>());
        diary.rows.extend(rows.filter(|row| row.len() == diary.keys.len()));
    }

    fn add_latencies(&mut self, node: &str, text: &str) {
        for line in text.lines().skip(1) {
            let cells: Vec<_> = line.split(',').collect();
            if let [name, value, count] = cells[..]
                && let (Ok(value), Ok(count)) = (value.parse(), count.parse())
            {
                let key = (node.to_owned(), name.to_owned());
                self.latencies.entry(key).or_default().push((value, count));
            }
        }
    }

    /// In real time stamps count from the machine's start.
    fn begin_at_zero(&mut self) {
        let rows = || self.diaries.values().flat_map(|diary| &diary.rows);
        let first = rows().map(|row| row[0]).fold(f64::INFINITY, f64::min);
        for row in self.diaries.values_mut().flat_map(|diary| &mut diary.rows) {
            row[0] -= first;
        }
    }

    /// Where the world was.
    pub(crate) fn world(&self) -> Option<&Path> {
        self.receipt["world"].as_str().map(Path::new)
    }

    /// What `node` noted as the key that begins so: moments [s] and values.
    pub(crate) fn series(&self, node: &str, key: &str) -> Vec<(f64, f64)> {
        let Some(diary) = self.diaries.get(node) else { return Vec::new() };
        let Some(column) = diary.keys.iter().position(|other| other.starts_with(key)) else {
            return Vec::new();
        };
        diary.rows.iter().map(|row| (row[0], row[column])).collect()
    }

    /// The names of the states that `node` noted as `key`.
    pub(crate) fn states(&self, node: &str, key: &str) -> Vec<&str> {
        let mut keys = self.diaries.get(node).into_iter().flat_map(|diary| &diary.keys);
        let names = keys.find_map(|other| other.strip_prefix(key)?.strip_prefix(':'));
        names.map(|names| names.split('/').collect()).unwrap_or_default()
    }

    /// Where the robot was by `node`, in the order of time: x and y [m].
    pub(crate) fn track(&self, node: &str) -> Vec<(f64, f64)> {
        let (x, y) = (self.series(node, "x_m"), self.series(node, "y_m"));
        x.into_iter().zip(y).map(|((_, x), (_, y))| (x, y)).collect()
    }

    /// What odometry believes, drawn where the robot began: x and y [m] in the frame `map`.
    pub(crate) fn believed(&self) -> Vec<(f64, f64)> {
        let first = |key| self.series("simulator", key).first().map(|(_, value)| *value);
        let start = [first("x_m"), first("y_m"), first("yaw_rad")].map(Option::unwrap_or_default);
        let (sin, cos) = libm::sincos(start[2]);
        let place = |(x, y)| (start[0] + cos * x - sin * y, start[1] + sin * x + cos * y);
        self.track("odometry").into_iter().map(place).collect()
    }
}

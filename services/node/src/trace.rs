//! What a node did when, for one who wants to see how a robot's processes work together: its turns, and
//! what came and went in them. Kept in memory for as long as the node drives, the newest of it; written
//! to a file when it is taken down.
//!
//! A node has a thread, and its ports stay on it, so the trace is the thread's: no port has to carry it.

use std::cell::{Cell, RefCell};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use interfaces::{Header, Stamp};

use crate::{Settings, clock};

/// The environment variable that names the timeline that a node's own part belongs to.
pub const TRACE: &str = "TESEO_TRACE";

/// [-] The newest so many are kept: the last half minute of a robot at a kilohertz, and two megabytes.
const HAPPENINGS_MAX: usize = 65_536;

thread_local! {
    /// Whether anybody wants to know: all that it costs where nobody does.
    static IS_ON: Cell<bool> = const { Cell::new(false) };
    static TRACE_OF_THREAD: RefCell<Trace> = const { RefCell::new(Trace::NONE) };
}

/// What can happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Begin,
    End,
    Sent,
    Received,
}

#[derive(Debug, Clone, Copy)]
struct Happening {
    at: Stamp,
    kind: Kind,
    /// [-] Of the topics, by the order in which they were met.
    topic: usize,
    epoch: u32,
    sequence: u64,
}

struct Trace {
    path: Option<PathBuf>,
    topics: Vec<String>,
    happenings: Vec<Happening>,
    /// [-] Where the next one goes, once there is room no more.
    next: usize,
}

impl Trace {
    const NONE: Self = Self { path: None, topics: Vec::new(), happenings: Vec::new(), next: 0 };

    fn push(&mut self, happening: Happening) {
        if self.happenings.len() < HAPPENINGS_MAX {
            self.happenings.push(happening);
        } else {
            self.happenings[self.next] = happening;
            self.next = (self.next + 1) % HAPPENINGS_MAX;
        }
    }

    fn topic(&mut self, name: &str) -> usize {
        self.topics.iter().position(|other| other == name).unwrap_or_else(|| {
            self.topics.push(name.to_owned());
            self.topics.len() - 1
        })
    }

    /// One happening a line, the oldest first: moment [ns], what, topic, epoch, sequence number.
    fn text(&self) -> String {
        let mut text = String::new();
        let (newer, older) = self.happenings.split_at(self.next);
        for happening in older.iter().chain(newer) {
            let kind = match happening.kind {
                Kind::Begin => "begin",
                Kind::End => "end",
                Kind::Sent => "sent",
                Kind::Received => "received",
            };
            let topic = self.topics.get(happening.topic).map_or("", String::as_str);
            let Happening { at, epoch, sequence, .. } = happening;
            let _ = writeln!(text, "{},{kind},{topic},{epoch},{sequence}", at.nanoseconds);
        }
        text
    }
}

/// The name of the part of the timeline at `path` that this node's life makes.
pub fn part(path: &Path, node: &str, epoch: u32) -> PathBuf {
    PathBuf::from(format!("{}.{node}.{epoch}", path.display()))
}

/// From now on what this thread's node does is kept, where the settings say so.
pub(crate) fn start(settings: &Settings) {
    let path = settings.trace().map(|path| part(path, settings.name(), settings.epoch()));
    IS_ON.set(path.is_some());
    let room = if path.is_some() { HAPPENINGS_MAX } else { 0 };
    TRACE_OF_THREAD.set(Trace { path, happenings: Vec::with_capacity(room), ..Trace::NONE });
}

/// A turn of the node's loop begins.
pub(crate) fn turn_begins() {
    happened(Kind::Begin, "", &Header::default());
}

/// It ends.
pub(crate) fn turn_ends() {
    happened(Kind::End, "", &Header::default());
}

/// A sample was sent.
pub(crate) fn sent(topic: &str, header: &Header) {
    happened(Kind::Sent, topic, header);
}

/// A sample was received.
pub(crate) fn received(topic: &str, header: &Header) {
    happened(Kind::Received, topic, header);
}

#[inline]
fn happened(kind: Kind, topic: &str, header: &Header) {
    if IS_ON.get() {
        keep(kind, topic, header);
    }
}

/// Each node's own topics have a slash in their names, and are no way of a scan.
#[cold]
fn keep(kind: Kind, topic: &str, header: &Header) {
    if topic.contains('/') {
        return;
    }
    TRACE_OF_THREAD.with_borrow_mut(|trace| {
        let topic = if topic.is_empty() { usize::MAX } else { trace.topic(topic) };
        let (epoch, sequence) = (header.epoch, header.sequence);
        trace.push(Happening { at: clock::now(), kind, topic, epoch, sequence });
    });
}

/// Writes what was kept; the robot stands. What cannot be written is lost, and that is said.
pub(crate) fn write() {
    TRACE_OF_THREAD.with_borrow(|trace| {
        if let Some(path) = &trace.path
            && let Err(cause) = std::fs::write(path, trace.text())
        {
            tracing::warn!(%cause, path = %path.display(), "cannot write the trace");
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(sequence: u64) -> Header {
        Header { sequence, ..Header::default() }
    }

    #[test]
    fn of_a_long_run_the_newest_is_kept_in_order() {
        IS_ON.set(true);
        let count = HAPPENINGS_MAX as u64 + 10;
        for sequence in 0..count {
            sent("scan", &header(sequence));
        }
        received("controller/status", &header(1));
        let text = TRACE_OF_THREAD.with_borrow(Trace::text);
        let sequences: Vec<u64> =
            text.lines().map(|line| line.rsplit(',').next().unwrap().parse().unwrap()).collect();
        assert_eq!(sequences, (10..count).collect::<Vec<_>>());
        assert!(text.lines().all(|line| line.contains(",sent,scan,")));
    }
}

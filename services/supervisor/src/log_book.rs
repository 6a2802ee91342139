//! What nodes write: kept, told, and never in anybody's way.
//!
//! A node writes into memory of its own (`memfd_create(2)`) instead of a pipe: a pipe that nobody
//! reads holds its writer up, and one whose reader is gone ends it. The supervisor reads behind the
//! node and gives the memory back.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::SystemTime;

use interfaces::Stamp;
use node::{Error, Result};
use rustix::fs::{FallocateFlags, MemfdFlags};

/// [-] Lines kept of each node, over all its lives.
const LINES_MAX: usize = 1_000;

/// [byte] A longer line is told in pieces.
const LINE_MAX: usize = 4_096;

/// [byte] Read at once from one node: whoever writes more than that at every turn loses lines, and
/// holds nobody up.
const PIECE_MAX: usize = 256 * 1024;

/// One line of a node.
#[derive(Debug, Clone)]
pub(crate) struct Line {
    pub(crate) node: usize,
    pub(crate) epoch: u32,
    pub(crate) at: Stamp,
    pub(crate) wall: SystemTime,
    pub(crate) text: String,
}

/// All that nodes have written lately.
#[derive(Debug)]
pub(crate) struct LogBook {
    pages: Vec<Page>,
    dropped: u64,
    disk: Option<Disk>,
}

/// One node's part.
#[derive(Debug, Default)]
struct Page {
    name: String,
    written: Option<Written>,
    lines: VecDeque<Line>,
}

/// What one life of a node writes.
#[derive(Debug)]
struct Written {
    memory: File,
    epoch: u32,
    /// [byte] Read so far.
    read: u64,
    /// The beginning of a line whose end has not been written yet.
    begun: Vec<u8>,
}

/// Files on a disk, which may be full: then lines are lost there, and only there.
#[derive(Debug)]
struct Disk {
    directory: PathBuf,
    lost: u64,
    why: String,
}

impl LogBook {
    /// A book for the nodes `names`, also kept in files in `directory` where there is one.
    pub(crate) fn new(names: Vec<String>, directory: Option<&Path>) -> Result<Self> {
        if let Some(directory) = directory {
            fs::create_dir_all(directory)
                .map_err(|cause| Error::File { path: directory.to_owned(), cause })?;
        }
        let page = |name| Page { name, ..Page::default() };
        let disk = |directory: &Path| Disk {
            directory: directory.to_owned(),
            lost: 0,
            why: String::new(),
        };
        Ok(Self {
            pages: names.into_iter().map(page).collect(),
            dropped: 0,
            disk: directory.map(disk),
        })
    }

    /// Where a new life of a node writes: standard output and standard error.
    pub(crate) fn open(&mut self, node: usize, epoch: u32) -> std::io::Result<(Stdio, Stdio)> {
        let page = &mut self.pages[node];
        let memory = rustix::fs::memfd_create(page.name.as_str(), MemfdFlags::CLOEXEC)?;
        let (out, err): (OwnedFd, OwnedFd) = (memory.try_clone()?, memory.try_clone()?);
        let memory = File::from(memory);
        page.written = Some(Written { memory, epoch, read: 0, begun: Vec::new() });
        Ok((out.into(), err.into()))
    }

    /// A life has ended: the last that it wrote.
    pub(crate) fn close(&mut self, node: usize, at: Stamp, wall: SystemTime) -> Vec<Line> {
        let mut lines = self.read_page(node, at, wall, true);
        if let Some(mut written) = self.pages[node].written.take()
            && !written.begun.is_empty()
        {
            let text = text(&std::mem::take(&mut written.begun));
            lines.push(Line { node, epoch: written.epoch, at, wall, text });
        }
        self.keep(node, &lines);
        lines
    }

    /// What nodes have written since the last time.
    pub(crate) fn read(&mut self, at: Stamp, wall: SystemTime) -> Vec<Line> {
        let mut all = Vec::new();
        for node in 0..self.pages.len() {
            let lines = self.read_page(node, at, wall, false);
            self.keep(node, &lines);
            all.extend(lines);
        }
        all
    }

    /// The newest lines of one node or of all, the older first.
    pub(crate) fn last(&self, node: Option<usize>, count: usize) -> Vec<Line> {
        let pages = self.pages.iter().enumerate();
        let pages = pages.filter(|(index, _)| node.is_none_or(|node| node == *index));
        let mut lines: Vec<_> = pages.flat_map(|(_, page)| page.lines.iter().cloned()).collect();
        lines.sort_by_key(|line| line.at);
        lines.split_off(lines.len().saturating_sub(count))
    }

    /// [-] Bytes that a node wrote faster than they could be read.
    pub(crate) const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// [-] Lines that could not be written to the disk, and why not.
    pub(crate) fn disk_errors(&self) -> Option<(u64, &str)> {
        self.disk.as_ref().filter(|disk| 0 < disk.lost).map(|disk| (disk.lost, disk.why.as_str()))
    }

    fn read_page(&mut self, node: usize, at: Stamp, wall: SystemTime, is_last: bool) -> Vec<Line> {
        let Some(written) = &mut self.pages[node].written else { return Vec::new() };
        let size = written.memory.metadata().map_or(0, |file| file.len());
        if size <= written.read {
            return Vec::new();
        }
        // What is newest is worth most.
        let begin = written.read.max(size.saturating_sub(PIECE_MAX as u64));
        self.dropped += begin - written.read;
        let mut bytes = vec![0; usize::try_from(size - begin).unwrap_or_default()];
        let count = written.memory.read_at(&mut bytes, begin).unwrap_or_default();
        bytes.truncate(count);
        written.read = begin + count as u64;
        if !is_last {
            // Given back in whole pages; the file keeps its length, and the node its place in it.
            let flags = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
            let _ = rustix::fs::fallocate(&written.memory, flags, 0, written.read);
        }
        let line = |text| Line { node, epoch: written.epoch, at, wall, text };
        split(&mut written.begun, &bytes).into_iter().map(line).collect()
    }

    fn keep(&mut self, node: usize, lines: &[Line]) {
        let page = &mut self.pages[node];
        for line in lines {
            if page.lines.len() == LINES_MAX {
                page.lines.pop_front();
            }
            page.lines.push_back(line.clone());
        }
        if let Some(disk) = &mut self.disk {
            disk.append(&page.name, lines);
        }
    }
}

impl Disk {
    fn append(&mut self, name: &str, lines: &[Line]) {
        if lines.is_empty() {
            return;
        }
        let mut text = String::new();
        for line in lines {
            let wall = humantime::format_rfc3339_millis(line.wall);
            let (seconds, epoch) = (line.at.seconds(), line.epoch);
            let _ = writeln!(text, "{wall} {seconds:.6} {epoch} {}", line.text);
        }
        let path = self.directory.join(format!("{name}.log"));
        let file = OpenOptions::new().create(true).append(true).open(path);
        if let Err(cause) = file.and_then(|mut file| file.write_all(text.as_bytes())) {
            self.lost += lines.len() as u64;
            self.why = cause.to_string();
        }
    }
}

/// The lines that `bytes` complete, of which `begun` is the beginning; what is left is in `begun`.
fn split(begun: &mut Vec<u8>, bytes: &[u8]) -> Vec<String> {
    let mut lines = Vec::new();
    for piece in bytes.split_inclusive(|&byte| byte == b'\n') {
        begun.extend_from_slice(piece);
        let is_whole = begun.ends_with(b"\n");
        if is_whole || LINE_MAX <= begun.len() {
            lines.push(text(begun));
            begun.clear();
        }
    }
    lines
}

/// What a terminal can be shown, whatever a process has written; colours are for terminals, and a
/// node does not write to one.
fn text(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let shown = |c: char| if c.is_control() && c != '\t' { '\u{fffd}' } else { c };
    text.trim_end_matches(['\n', '\r']).chars().map(shown).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::process::Command;

    use super::*;

    #[test]
    fn lines_are_told_whole_and_the_last_without_its_end_at_the_end() {
        let mut book = LogBook::new(vec!["node".to_owned()], None).unwrap();
        let (out, err) = book.open(0, 1).unwrap();
        let script = "printf 'one\\ntw'; printf 'o\\nthree' >&2";
        Command::new("sh").args(["-c", script]).stdout(out).stderr(err).status().unwrap();

        assert_eq!(texts(&book.read(Stamp::ZERO, SystemTime::UNIX_EPOCH)), ["one", "two"]);
        assert_eq!(texts(&book.close(0, Stamp::ZERO, SystemTime::UNIX_EPOCH)), ["three"]);
        assert_eq!(texts(&book.last(None, 2)), ["two", "three"]);
    }

    #[test]
    fn a_flood_is_neither_kept_nor_waited_for() {
        let mut book = LogBook::new(vec!["node".to_owned()], None).unwrap();
        let (out, err) = book.open(0, 1).unwrap();
        let flood = "head -c 3000000 /dev/zero | tr '\\0' '\\n'; echo last";
        Command::new("sh").args(["-c", flood]).stdout(out).stderr(err).status().unwrap();
        let lines = book.read(Stamp::ZERO, SystemTime::UNIX_EPOCH);

        assert_eq!(texts(&lines).last(), Some(&"last"));
        assert!(2_000_000 < book.dropped(), "{}", book.dropped());
        assert_eq!(book.last(None, usize::MAX).len(), LINES_MAX);
    }

    #[test]
    fn a_full_disk_costs_lines_on_the_disk_and_nothing_else() {
        let mut disk = Disk { directory: PathBuf::from("/dev"), lost: 0, why: String::new() };
        let line = Line {
            node: 0,
            epoch: 1,
            at: Stamp::ZERO,
            wall: SystemTime::UNIX_EPOCH,
            text: "text".to_owned(),
        };
        // `/dev/full/x.log` cannot be made, as on a full or read-only disk.
        disk.directory.push("full");
        disk.append("x", &[line]);

        assert_eq!(disk.lost, 1);
        assert!(!disk.why.is_empty());
    }

    #[test]
    fn no_escape_code_reaches_a_terminal() {
        let mut begun = Vec::new();
        begun.write_all(b"\x1b[31mred").unwrap();

        assert_eq!(split(&mut begun, b"\x07\n"), ["\u{fffd}[31mred\u{fffd}"]);
    }

    fn texts(lines: &[Line]) -> Vec<&str> {
        lines.iter().map(|line| line.text.as_str()).collect()
    }
}

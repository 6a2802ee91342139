//! What runs leave, and processes that are killed, and how it is removed.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, ipc};
use interfaces::Stamp;

use super::{LOCK, Namespace};
use crate::{EmergencyStop, Error, Result, clock};

/// How a service says what it is, and when it is whole: nobody may write it any more.
const STATIC_FILES: [&str; 5] =
    [".service", ".service_tag", ".port_tag", ".details", ".type_definition"];

/// [-] A node's files that say whether it lives: monitor, context and the owner's lock.
const MONITOR_FILES: usize = 3;

/// A file that its maker has not yet opened to others.
const UNFINISHED_MODE: u32 = 0o200;

/// How long another process that clears after the same dead one is waited for.
const OTHER_CLEANER_MAX: Duration = Duration::from_secs(1);

/// Between two looks whether all is finished.
const FINISH_POLL: Duration = Duration::from_millis(5);

/// What a look for unfinished files came to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Swept {
    /// [-] Files that were removed.
    pub removed: usize,
    /// [-] Files that may be unfinished because somebody is at work on them.
    pub unfinished: usize,
}

/// What was unfinished at the last look, and since when it has been as it was then: by looking, and
/// not by the files' own times, which are those of a clock that people may set.
#[derive(Debug, Default)]
pub struct Unfinished(BTreeMap<PathBuf, Seen>);

/// A file as it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seen {
    /// [s, ns] On whatever clock: what counts is whether it is another.
    changed: (i64, i64),
    since: Stamp,
}

/// One look at everything.
struct Look {
    now: Stamp,
    age_min: Duration,
    before: BTreeMap<PathBuf, Seen>,
    after: BTreeMap<PathBuf, Seen>,
    swept: Swept,
}

impl Namespace {
    /// Removes what a former run left, but not the lock and no emergency stop. Only for one who holds
    /// it while nothing of the run lives.
    pub fn clear(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.directory).into_iter().flatten().flatten();
        let mut left = self.remove_segments();
        left.extend(
            entries
                .filter(|entry| {
                    ![LOCK, EmergencyStop::FILE].iter().any(|kept| entry.file_name() == *kept)
                })
                .map(|entry| entry.path())
                .filter(|path| fs::remove_dir_all(path).is_err() && fs::remove_file(path).is_err()),
        );
        left
    }

    /// Removes every file of the robot. Only for one who holds the lock while nothing of the run
    /// lives. Returns what could not be removed.
    pub fn remove(&self) -> Vec<PathBuf> {
        let left = self.clear();
        let _ = fs::remove_file(self.lock());
        // It stays with an emergency stop, which outlives the run, or where the next run has begun.
        Self::unmake(&self.directory);
        left
    }

    fn remove_segments(&self) -> Vec<PathBuf> {
        self.segments().filter(|path| fs::remove_file(path).is_err()).collect()
    }

    /// Removes what a process that was killed while it made it left unfinished, if it has been so for
    /// `age_min`, by what is `known`: iceoryx2 0.10.0 waits for such files for ever, or never removes
    /// them. While others live this is safe with an `age_min` that no living maker needs. Only for the
    /// supervisor.
    pub fn sweep_unfinished(&self, known: &mut Unfinished, age_min: Duration) -> Swept {
        let mut look = Look {
            now: clock::now(),
            age_min,
            before: std::mem::take(&mut known.0),
            after: BTreeMap::new(),
            swept: Swept::default(),
        };
        for path in self.segments() {
            look.at(&path, is_unfinished);
        }
        self.sweep_tree(&self.directory, &mut look);
        known.0 = look.after;
        look.swept
    }

    /// Waits until no shared memory is unfinished, because its maker has finished it or the supervisor
    /// has swept it, but not for longer than `patience`.
    pub(crate) fn await_finished(&self, patience: Duration) {
        let until = clock::now().after(patience);
        let is_unfinished =
            |path: PathBuf| fs::metadata(path).is_ok_and(|file| is_unfinished(&file));
        while self.segments().any(is_unfinished) && clock::now() < until {
            clock::nap(FINISH_POLL);
        }
    }

    /// Takes from the dead what they held: their ports' places on topics, and their files. For whoever
    /// starts a process, before it joins, so for the supervisor: this may wait for ever for a file that
    /// was never finished, and is then to be killed. A robot without one has its processes do it for
    /// themselves.
    pub fn clear_dead(&self) -> Result {
        let config = self.enter()?;
        Node::<ipc::Service>::list(&config, |state| {
            if let NodeState::Dead(dead) = state
                && let Err(cause) = dead.blocking_remove_stale_resources(OTHER_CLEANER_MAX)
            {
                // What is in the way is told by whoever cannot open it.
                tracing::debug!(%cause, "a dead process keeps what it held");
            }
            CallbackProgression::Continue
        })
        .map_err(|cause| Error::shared_memory("look for dead processes", cause))
    }

    /// The transport's own files: what describes services and ports, and the nodes' monitors.
    fn sweep_tree(&self, directory: &Path, look: &mut Look) {
        let entries: Vec<_> = fs::read_dir(directory).into_iter().flatten().flatten().collect();
        for entry in &entries {
            let path = entry.path();
            let is_static = STATIC_FILES
                .iter()
                .any(|end| entry.file_name().as_encoded_bytes().ends_with(end.as_bytes()));
            if path.is_dir() {
                self.sweep_tree(&path, look);
            } else if is_static {
                look.at(&path, |file| file.mode() & 0o200 != 0);
            }
        }
        if directory.file_name().is_some_and(|name| name == "nodes") {
            self.sweep_monitors(&entries, look);
        }
    }

    /// A node whose monitor is incomplete is neither alive nor dead to the transport.
    fn sweep_monitors(&self, entries: &[fs::DirEntry], look: &mut Look) {
        // `PREFIX_NUMBER.node_monitor` and its like lie beside the directory `NUMBER`.
        let mut nodes: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
        for entry in entries {
            let name = entry.file_name().to_string_lossy().into_owned();
            let stem = name.split('.').next().unwrap_or_default();
            let number = stem.strip_prefix(&self.prefix).unwrap_or(stem);
            nodes.entry(number.to_owned()).or_default().push(entry.path());
        }
        for paths in nodes.values() {
            let monitors: Vec<_> = paths.iter().filter(|path| path.is_file()).collect();
            let is_closed = |path: &&&PathBuf| {
                fs::metadata(path).is_ok_and(|file| file.mode() & 0o777 == UNFINISHED_MODE)
            };
            let is_whole =
                MONITOR_FILES <= monitors.len() && monitors.iter().filter(is_closed).count() == 0;
            if !is_whole {
                for path in paths {
                    look.at(path, |_| true);
                }
            }
        }
    }
}

/// Whether shared memory is not yet what it shall be.
fn is_unfinished(file: &fs::Metadata) -> bool {
    file.len() == 0 || file.mode() & 0o777 == UNFINISHED_MODE
}

impl Look {
    /// Removes `path` if it is unfinished and nobody can be at work on it any more.
    fn at(&mut self, path: &Path, is_unfinished: impl FnOnce(&fs::Metadata) -> bool) {
        let Ok(file) = fs::metadata(path) else { return };
        if !is_unfinished(&file) {
            return;
        }
        let changed = (file.ctime(), file.ctime_nsec());
        let before = self.before.get(path).filter(|seen| seen.changed == changed);
        let since = before.map_or(self.now, |seen| seen.since);
        if self.now.since(since) < self.age_min {
            self.swept.unfinished += 1;
            self.after.insert(path.to_owned(), Seen { changed, since });
        } else if fs::remove_file(path).is_ok() || fs::remove_dir_all(path).is_ok() {
            self.swept.removed += 1;
        }
    }
}

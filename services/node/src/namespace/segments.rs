//! A robot's files in shared memory, and whether there is room for them.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

use rustix::fs::FallocateFlags;

use super::Namespace;
use crate::launch::Launch;
use crate::{Error, Result, memory};

/// Where the transport keeps what it shares.
const SHARED_MEMORY: &str = "/dev/shm";

/// What a robot holds in shared memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SharedMemory {
    /// [-] How many files.
    pub files: usize,
    /// [byte] How large they are together, touched or not.
    pub bytes: u64,
}

impl Namespace {
    /// What this user's robots hold in shared memory now, by prefix, whether they run or not.
    pub fn shared_memory_of_all() -> BTreeMap<String, SharedMemory> {
        let own = rustix::process::getuid().as_raw();
        let mut all = BTreeMap::<String, SharedMemory>::new();
        for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let Some(prefix) = Self::prefix_of(&name) else { continue };
            let Ok(file) = entry.metadata() else { continue };
            if file.uid() == own {
                let held = all.entry(prefix.to_owned()).or_default();
                held.files += 1;
                held.bytes += file.len();
            }
        }
        all
    }

    /// What the robot holds in shared memory now.
    pub fn shared_memory(&self) -> SharedMemory {
        let sizes = self.segments().filter_map(|path| Some(fs::metadata(path).ok()?.len()));
        sizes.fold(SharedMemory::default(), |all, size| SharedMemory {
            files: all.files + 1,
            bytes: all.bytes + size,
        })
    }

    /// [byte] What the robot of `launch` needs of shared memory, at the most.
    pub fn need(launch: &Launch) -> u64 {
        memory::need(launch)
    }

    /// [byte] What is free of the machine's shared memory.
    pub fn free() -> Result<u64> {
        let stat = stat_shared_memory()?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }

    /// [byte] How large the machine's shared memory is, free or not.
    pub fn size() -> Result<u64> {
        let stat = stat_shared_memory()?;
        Ok(stat.f_blocks.saturating_mul(stat.f_frsize))
    }

    /// Has the system set aside what the robot's files are large: they are made sparse, and one that
    /// found no room when it was first written would kill its process in motion.
    pub fn reserve(&self) -> Result {
        for path in self.segments() {
            let Ok(file) = fs::File::options().read(true).write(true).open(&path) else { continue };
            let size = file.metadata().map_or(0, |file| file.len());
            if 0 < size
                && let Err(cause) = rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, size)
            {
                let free = Self::free()? / 1024;
                let what = format!("reserve shared memory, of which {free} KiB are free");
                return Err(Error::SharedMemory { action: what, cause: cause.to_string() });
            }
        }
        Ok(())
    }

    /// A file of the robot's in shared memory.
    pub(crate) fn segment(&self, name: &str) -> PathBuf {
        PathBuf::from(SHARED_MEMORY).join(format!("{}{name}", self.prefix))
    }

    /// [s, ns] When a file last came into shared memory or went: on whatever clock, what counts is
    /// whether it is another.
    pub fn memory_changed() -> Option<(i64, i64)> {
        let directory = fs::metadata(SHARED_MEMORY).ok()?;
        Some((directory.mtime(), directory.mtime_nsec()))
    }

    /// The robot's files in shared memory.
    pub(crate) fn segments(&self) -> impl Iterator<Item = PathBuf> {
        let prefix = self.prefix.clone().into_bytes();
        let all = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        all.filter(move |entry| entry.file_name().as_encoded_bytes().starts_with(&prefix))
            .map(|entry| entry.path())
    }
}

fn stat_shared_memory() -> Result<rustix::fs::StatVfs> {
    let failed = |cause: rustix::io::Errno| Error::File {
        path: PathBuf::from(SHARED_MEMORY),
        cause: cause.into(),
    };
    rustix::fs::statvfs(SHARED_MEMORY).map_err(failed)
}

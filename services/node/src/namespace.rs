//! Where a robot's shared memory lies, apart from every other robot's.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{Config, FilePath, SemanticString};
use rustix::fs::{FallocateFlags, FlockOperation};

use crate::launch::Launch;
use crate::{EmergencyStop, Error, Result, clock, memory};

/// The transport's version, part of every name: two versions must never meet.
const TRANSPORT: &str = "0100";

/// Where the transport keeps what it shares.
const SHARED_MEMORY: &str = "/dev/shm";

/// The name of the lock's file.
const LOCK: &str = "lock";

/// What follows a robot's name, which has no full stop, in the name of the file with its last words.
const LAST_WORDS: &str = "last";

/// The name of the transport's configuration.
const TRANSPORT_CONFIG: &str = "iceoryx2.toml";

/// [-] Attempts to share the lock with whoever has it for a moment, to look or to sweep.
const SHARE_ATTEMPTS: u32 = 10;

/// Between two of them.
const SHARE_PAUSE: Duration = Duration::from_millis(5);

/// [byte] What a robot's names in shared memory have in common: `teseo0100_`, a hash and `_`.
const PREFIX_LENGTH: usize = "teseo".len() + TRANSPORT.len() + 10;

/// How a service says what it is, and when it is whole: nobody may write it any more.
const STATIC_FILES: [&str; 5] =
    [".service", ".service_tag", ".port_tag", ".details", ".type_definition"];

/// [-] A node's files that say whether it lives: monitor, context and the owner's lock.
const MONITOR_FILES: usize = 3;

/// A file that its maker has not yet opened to others.
const UNFINISHED_MODE: u32 = 0o200;

/// What a robot holds in shared memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SharedMemory {
    /// [-] How many files.
    pub files: usize,
    /// [byte] How large they are together, touched or not.
    pub bytes: u64,
}

/// What a look for unfinished files came to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Swept {
    /// [-] Files that were removed.
    pub removed: usize,
    /// [-] Files that may be unfinished because somebody is at work on them.
    pub unfinished: usize,
}

/// One robot's directory and prefix.
#[derive(Debug, Clone)]
pub struct Namespace {
    robot: String,
    directory: PathBuf,
    prefix: String,
}

impl Namespace {
    /// [byte] What is left of a socket's 108-byte address after iceoryx2's own names.
    pub const DIRECTORY_LENGTH_MAX: usize = 44;

    /// Where the robots of this process's user have their directories: `TESEO_RUNTIME_DIR`, or a
    /// place in the user's runtime directory.
    pub fn runtime_directory() -> PathBuf {
        runtime_directory()
    }

    /// The robots with a directory under `runtime`, whether they run or not, by name.
    pub fn all_under(runtime: &Path) -> Vec<Self> {
        let entries = fs::read_dir(runtime).into_iter().flatten().flatten();
        let is_robot = |directory: &PathBuf| {
            [LOCK, TRANSPORT_CONFIG, EmergencyStop::FILE]
                .iter()
                .any(|name| directory.join(name).is_file())
        };
        let mut directories: Vec<_> = entries.map(|entry| entry.path()).filter(is_robot).collect();
        directories.sort();
        directories.iter().filter_map(|directory| Self::at(directory)).collect()
    }

    /// The namespace of the robot whose own directory this is; `None` where it is none's.
    pub fn at(directory: &Path) -> Option<Self> {
        Self::under(directory.parent()?, directory.file_name()?.to_str()?).ok()
    }

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

    /// The prefix in the name of a file in shared memory, where it is a robot's.
    pub fn prefix_of(name: &str) -> Option<&str> {
        let prefix = name.get(..PREFIX_LENGTH)?;
        let hash = prefix.strip_prefix("teseo")?.strip_prefix(TRANSPORT)?.strip_prefix('_')?;
        let hash = hash.strip_suffix('_')?;
        hash.bytes().all(|byte| byte.is_ascii_hexdigit()).then_some(prefix)
    }

    /// The namespace of `robot` under `TESEO_RUNTIME_DIR`, or the user's runtime directory.
    pub fn new(robot: &str) -> Result<Self> {
        Self::under(&runtime_directory(), robot)
    }

    /// The namespace of `robot` under `runtime`.
    pub fn under(runtime: &Path, robot: &str) -> Result<Self> {
        check_name(robot)?;
        let directory = runtime.join(robot);
        if Self::DIRECTORY_LENGTH_MAX < directory.as_os_str().len() {
            return Err(Error::PathTooLong { path: directory });
        }
        let hash = xxhash_rust::xxh3::xxh3_64(directory.as_os_str().as_encoded_bytes());
        let prefix = format!("teseo{TRANSPORT}_{:08x}_", hash >> 32);
        Ok(Self { robot: robot.to_owned(), directory, prefix })
    }

    /// The robot's name.
    pub fn robot(&self) -> &str {
        &self.robot
    }

    /// What the name of each of the robot's files in shared memory begins with.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The robot's own directory, mode 0700: sockets, lock, transport configuration.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Makes the directory and makes this namespace the process's own, before its first port.
    pub(crate) fn enter(&self) -> Result<Config> {
        self.create_directory()?;
        let path = self.directory.join(TRANSPORT_CONFIG);
        // The global configuration, not one of each node: iceoryx2 cleans up after the dead in
        // the global one's place.
        let text = format!(
            "[global]\nroot-path = \"{}\"\nprefix = \"{}\"\n",
            self.directory.display(),
            self.prefix
        );
        write_if_other(&path, &text)?;
        let name = FilePath::new(path.as_os_str().as_encoded_bytes())
            .map_err(|cause| Error::shared_memory("name the transport's configuration", cause))?;
        Config::setup_global_config_from_file(&name)
            .cloned()
            .map_err(|cause| Error::shared_memory("read the transport's configuration", cause))
    }

    /// Makes the directory, for the robot's user alone.
    pub fn create_directory(&self) -> Result<()> {
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&self.directory)
            .map_err(|cause| Error::File { path: self.directory.clone(), cause })
    }

    /// Removes what a former run left, but not the lock. Only for one who holds it while nothing
    /// of the run lives.
    pub fn clear(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.directory).into_iter().flatten().flatten();
        let mut left = self.remove_segments();
        left.extend(
            entries
                .filter(|entry| entry.file_name() != LOCK && !is_latch(entry))
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
        let _ = fs::remove_dir(&self.directory);
        // The directory above goes too, unless another robot lives there.
        if let Some(runtime) = self.directory.parent() {
            let _ = fs::remove_dir(runtime);
        }
        left
    }

    /// The file whose lock is the right to run the robot.
    pub fn lock(&self) -> PathBuf {
        self.directory.join(LOCK)
    }

    /// Keeps off whoever would remove the robot's files, until what is returned is dropped: for a node
    /// that no supervisor looks after. `None` where a supervisor holds the robot, and keeps them off.
    pub(crate) fn share(&self) -> Result<Option<fs::File>> {
        let path = self.lock();
        let failed = |cause| Error::File { path: path.clone(), cause };
        for _ in 0..SHARE_ATTEMPTS {
            self.create_directory()?;
            let mut options = fs::File::options();
            options.read(true).write(true).create(true).truncate(false);
            let file = options.open(&path).map_err(failed)?;
            if rustix::fs::flock(&file, FlockOperation::NonBlockingLockShared).is_err() {
                clock::nap(SHARE_PAUSE);
                continue;
            }
            let own = file.metadata().map_err(failed)?.ino();
            // Whoever held it may have removed it between our opening and locking it.
            if fs::metadata(&path).is_ok_and(|present| present.ino() == own) {
                // The number in it is that of a supervisor, and there is none.
                file.set_len(0).map_err(failed)?;
                return Ok(Some(file));
            }
        }
        Ok(None)
    }

    /// Beside the directory, which is gone by then: how a run ended that nobody watched.
    pub fn last_words(&self) -> PathBuf {
        self.directory.with_extension(LAST_WORDS)
    }

    /// Whether this is some robot's [`Namespace::last_words`].
    pub fn is_last_words(path: &Path) -> bool {
        path.extension().is_some_and(|extension| extension == LAST_WORDS)
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

    /// Removes what a process that was killed while it made it left unfinished, if it is older than
    /// `age_min`: iceoryx2 0.10.0 waits for such files for ever, or never removes them. While others
    /// live this is safe with an `age_min` that no living maker needs. Only for the supervisor.
    pub fn sweep_unfinished(&self, age_min: Duration) -> Swept {
        let mut swept = Swept::default();
        let now = clock::wall();
        for path in self.segments() {
            let is_unfinished =
                |file: &fs::Metadata| file.len() == 0 || file.mode() & 0o777 == UNFINISHED_MODE;
            swept.look_at(&path, now, age_min, is_unfinished);
        }
        self.sweep_tree(&self.directory, now, age_min, &mut swept);
        swept
    }

    /// The transport's own files: what describes services and ports, and the nodes' monitors.
    fn sweep_tree(&self, directory: &Path, now: SystemTime, age_min: Duration, swept: &mut Swept) {
        let entries: Vec<_> = fs::read_dir(directory).into_iter().flatten().flatten().collect();
        for entry in &entries {
            let path = entry.path();
            let is_static = STATIC_FILES
                .iter()
                .any(|end| entry.file_name().as_encoded_bytes().ends_with(end.as_bytes()));
            if path.is_dir() {
                self.sweep_tree(&path, now, age_min, swept);
            } else if is_static {
                swept.look_at(&path, now, age_min, |file| file.mode() & 0o200 != 0);
            }
        }
        if directory.file_name().is_some_and(|name| name == "nodes") {
            self.sweep_monitors(&entries, now, age_min, swept);
        }
    }

    /// A node whose monitor is incomplete is neither alive nor dead to the transport.
    fn sweep_monitors(
        &self,
        entries: &[fs::DirEntry],
        now: SystemTime,
        age_min: Duration,
        swept: &mut Swept,
    ) {
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
                    swept.look_at(path, now, age_min, |_| true);
                }
            }
        }
    }

    fn segments(&self) -> impl Iterator<Item = PathBuf> {
        let prefix = self.prefix.clone().into_bytes();
        let all = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        all.filter(move |entry| entry.file_name().as_encoded_bytes().starts_with(&prefix))
            .map(|entry| entry.path())
    }

    fn remove_segments(&self) -> Vec<PathBuf> {
        self.segments().filter(|path| fs::remove_file(path).is_err()).collect()
    }
}

/// Of the robot's files, the one that outlives the run.
fn is_latch(entry: &fs::DirEntry) -> bool {
    entry.file_name() == EmergencyStop::FILE
}

impl Swept {
    /// Removes `path` if it is unfinished and nobody can be at work on it any more.
    fn look_at(
        &mut self,
        path: &Path,
        now: SystemTime,
        age_min: Duration,
        is_unfinished: impl FnOnce(&fs::Metadata) -> bool,
    ) {
        let Ok(file) = fs::metadata(path) else { return };
        if !is_unfinished(&file) {
            return;
        }
        let seconds = u64::try_from(file.ctime()).unwrap_or_default();
        let nanoseconds = u32::try_from(file.ctime_nsec()).unwrap_or_default();
        let changed = SystemTime::UNIX_EPOCH + Duration::new(seconds, nanoseconds);
        if now.duration_since(changed).unwrap_or_default() < age_min {
            self.unfinished += 1;
        } else if fs::remove_file(path).is_ok() || fs::remove_dir_all(path).is_ok() {
            self.removed += 1;
        }
    }
}

/// Refuses what cannot be part of a file name, a topic and a command line alike.
pub(crate) fn check_name(name: &str) -> Result<()> {
    let allowed = |byte: u8| {
        byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-' || byte == b'_'
    };
    if (1..=32).contains(&name.len()) && name.bytes().all(allowed) {
        Ok(())
    } else {
        Err(Error::Name { name: name.to_owned() })
    }
}

fn stat_shared_memory() -> Result<rustix::fs::StatVfs> {
    let failed = |cause: rustix::io::Errno| Error::File {
        path: PathBuf::from(SHARED_MEMORY),
        cause: cause.into(),
    };
    rustix::fs::statvfs(SHARED_MEMORY).map_err(failed)
}

fn runtime_directory() -> PathBuf {
    let given = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    if let Some(directory) = given("TESEO_RUNTIME_DIR") {
        return PathBuf::from(directory);
    }
    if let Some(directory) = given("XDG_RUNTIME_DIR") {
        return PathBuf::from(directory).join("teseo");
    }
    std::env::temp_dir().join(format!("teseo-{}", rustix::process::getuid().as_raw()))
}

/// Writes through a rename, so that a process which reads meanwhile sees all or nothing.
fn write_if_other(path: &Path, text: &str) -> Result<()> {
    if fs::read_to_string(path).is_ok_and(|present| present == text) {
        return Ok(());
    }
    let fresh = path.with_extension(format!("{}.new", std::process::id()));
    let write = || {
        fs::File::create(&fresh)?.write_all(text.as_bytes())?;
        fs::rename(&fresh, path)
    };
    write().map_err(|cause| Error::File { path: path.to_owned(), cause })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_robots_share_nothing() {
        let one = Namespace::under(Path::new("/tmp/a"), "burger").unwrap();
        let other = Namespace::under(Path::new("/tmp/b"), "burger").unwrap();
        let third = Namespace::under(Path::new("/tmp/a"), "waffle").unwrap();

        assert_ne!(one.prefix, other.prefix);
        assert_ne!(one.prefix, third.prefix);
        assert_ne!(one.directory, third.directory);
    }

    #[test]
    fn a_robot_is_known_by_its_directory_and_by_its_prefix() {
        let robot = Namespace::under(Path::new("/tmp/a"), "burger").unwrap();
        let again = Namespace::at(robot.directory()).unwrap();
        let file = format!("{}node.global_mgmt", robot.prefix());

        assert_eq!(again.prefix(), robot.prefix());
        assert_eq!(Namespace::prefix_of(&file), Some(robot.prefix()));
        for stranger in ["teseo", "teseo0100_", "teseo0099_0123abcd_x", "teseo0100_0123abcx_y"] {
            assert_eq!(Namespace::prefix_of(stranger), None, "{stranger}");
        }
    }

    #[test]
    fn a_name_that_could_leave_its_directory_is_refused() {
        for name in ["", "../x", "a b", "Ä", "a/b", "x".repeat(33).as_str()] {
            assert!(Namespace::under(Path::new("/tmp"), name).is_err(), "{name:?} was accepted");
        }
    }

    #[test]
    fn a_directory_too_long_for_a_socket_is_refused() {
        let long = PathBuf::from(format!("/tmp/{}", "x".repeat(60)));

        assert!(matches!(Namespace::under(&long, "burger"), Err(Error::PathTooLong { .. })));
    }
}

//! Where a robot's shared memory lies, apart from every other robot's.

mod segments;
mod sweep;

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::prelude::{Config, FilePath, SemanticString};
use rustix::fs::FlockOperation;

use crate::arguments::given;
use crate::{EmergencyStop, Error, Result, clock};

pub use segments::SharedMemory;
pub use sweep::{Swept, Unfinished};

/// The transport's version, part of every name: two versions must never meet.
const TRANSPORT: &str = "0100";

/// [-] Dead publishers of whose samples a reader still holds some. The transport raises it to what a
/// reader may hold; its own 128 take 460 KiB of every reader's memory, touched at once.
const EXPIRED_CONNECTIONS: usize = 8;

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

/// Directories are for their user alone. The sticky bit, which means nothing where nobody else may write,
/// marks those that were made here, and that go again with the last thing in them.
const MADE: u32 = 0o1700;

/// The same without what a directory inherits from the one above.
const MADE_MASK: u32 = 0o1777;

/// [byte] What a robot's names in shared memory have in common: `teseo0100_`, a hash and `_`.
const PREFIX_LENGTH: usize = "teseo".len() + TRANSPORT.len() + 10;

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
        // the global one's place. It does so by order alone (`clear_dead`): looking for the dead at
        // each topic that is opened took half of a node's configuration.
        let text = format!(
            "[global]\nroot-path = \"{}\"\nprefix = \"{}\"\n\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\n\
             cleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n\n\
             [defaults.publish-subscribe]\nsubscriber-expired-connection-buffer = {EXPIRED_CONNECTIONS}\n",
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
        Self::make(&self.directory)
            .map_err(|cause| Error::File { path: self.directory.clone(), cause })
    }

    /// Makes a directory where robots have theirs, and those above that are not there.
    pub fn make(directory: &Path) -> io::Result<()> {
        fs::DirBuilder::new().recursive(true).mode(MADE).create(directory)
    }

    /// Removes a directory and those above, as far as they were made by [`Namespace::make`] and nothing
    /// is in them: what somebody has made himself stays.
    pub fn unmake(directory: &Path) {
        let was_made = |path: &&Path| {
            let found = fs::symlink_metadata(path);
            found.is_ok_and(|found| found.is_dir() && found.mode() & MADE_MASK == MADE)
        };
        for path in directory.ancestors().take_while(was_made) {
            if fs::remove_dir(path).is_err() {
                return;
            }
        }
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

fn runtime_directory() -> PathBuf {
    if let Some(directory) = given("TESEO_RUNTIME_DIR") {
        return directory;
    }
    if let Some(directory) = given("XDG_RUNTIME_DIR") {
        return directory.join("teseo");
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
    fn directories_go_that_were_made_here_and_stay_where_somebody_else_made_them() {
        let own = std::env::temp_dir().join(format!("teseo-n{}", std::process::id()));
        let runtime = own.join("a/b");
        fs::create_dir(&own).unwrap();
        let robots = ["burger", "waffle"].map(|name| Namespace::under(&runtime, name).unwrap());
        for robot in &robots {
            robot.create_directory().unwrap();
            assert_eq!(fs::metadata(robot.directory()).unwrap().mode() & 0o777, 0o700);
        }

        assert!(robots[0].remove().is_empty());
        assert!(robots[1].directory().exists() && !robots[0].directory().exists());
        assert!(robots[1].remove().is_empty());
        assert_eq!(fs::read_dir(&own).unwrap().count(), 0);
        fs::remove_dir(&own).unwrap();
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

//! Where a robot's shared memory lies, apart from every other robot's.

use std::fs;
use std::io::Write;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, FilePath, SemanticString};

use crate::{Error, Result};

/// [byte] What is left of a socket's 108-byte address after iceoryx2's own names.
const DIRECTORY_LENGTH_MAX: usize = 44;

/// The transport's version, part of every name: two versions must never meet.
const TRANSPORT: &str = "0100";

/// The name of the lock's file.
const LOCK: &str = "lock";

/// One robot's directory and prefix.
#[derive(Debug, Clone)]
pub struct Namespace {
    robot: String,
    directory: PathBuf,
    prefix: String,
}

impl Namespace {
    /// The namespace of `robot` under `TESEO_RUNTIME_DIR`, or the user's runtime directory.
    pub fn new(robot: &str) -> Result<Self> {
        Self::under(&runtime_directory(), robot)
    }

    fn under(runtime: &Path, robot: &str) -> Result<Self> {
        check_name(robot)?;
        let directory = runtime.join(robot);
        if DIRECTORY_LENGTH_MAX < directory.as_os_str().len() {
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

    /// The robot's own directory, mode 0700: sockets, lock, transport configuration.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Makes the directory and makes this namespace the process's own, before its first port.
    pub(crate) fn enter(&self) -> Result<Config> {
        self.create_directory()?;
        let path = self.directory.join("iceoryx2.toml");
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
                .filter(|entry| entry.file_name() != LOCK)
                .map(|entry| entry.path())
                .filter(|path| fs::remove_dir_all(path).is_err() && fs::remove_file(path).is_err()),
        );
        left
    }

    /// Removes every file of the robot. Only for one who holds the lock while nothing of the run
    /// lives. Returns what could not be removed.
    pub fn remove(&self) -> Vec<PathBuf> {
        let mut left = self.remove_segments();
        if fs::remove_dir_all(&self.directory).is_err() && self.directory.exists() {
            left.push(self.directory.clone());
        }
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

    fn remove_segments(&self) -> Vec<PathBuf> {
        let prefix = self.prefix.as_bytes();
        let segments = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        segments
            .filter(|entry| entry.file_name().as_encoded_bytes().starts_with(prefix))
            .map(|entry| entry.path())
            .filter(|path| fs::remove_file(path).is_err())
            .collect()
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

//! The emergency stop's latch: a file in the robot's directory.
//!
//! It needs neither the supervisor nor shared memory, any process of the robot's user can set it, and
//! it outlives every process: a robot that is started again finds it as it was. Whoever drives the
//! wheels looks for it with every turn of its loop.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use crate::{Error, Namespace, Result};

/// The latch of one robot.
#[derive(Debug, Clone)]
pub struct EmergencyStop(PathBuf);

impl EmergencyStop {
    /// The latch's name in the robot's directory.
    pub(crate) const FILE: &str = "emergency_stop";

    /// That of the robot in `namespace`.
    pub fn of(namespace: &Namespace) -> Self {
        Self(namespace.directory().join(Self::FILE))
    }

    /// Whether it is latched; what cannot be told is taken for yes.
    pub fn is_latched(&self) -> bool {
        self.0.try_exists().unwrap_or(true)
    }

    /// Who latched it and why, in the words of whoever did.
    pub fn reason(&self) -> Option<String> {
        std::fs::read_to_string(&self.0).ok().map(|text| text.trim().to_owned())
    }

    /// Latches it. False where somebody else has before, whose reason stays.
    pub fn latch(&self, namespace: &Namespace, reason: &str) -> Result<bool> {
        namespace.create_directory()?;
        match OpenOptions::new().write(true).create_new(true).mode(0o600).open(&self.0) {
            Ok(mut file) => {
                // Latched is what counts: the reason is for people, and a full disk takes it away.
                drop(writeln!(file, "{reason}"));
                Ok(true)
            }
            Err(cause) if cause.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(cause) => Err(Error::File { path: self.0.clone(), cause }),
        }
    }

    /// Releases it. False where it was not latched.
    pub fn release(&self) -> Result<bool> {
        let outcome = match std::fs::remove_file(&self.0) {
            Ok(()) => Ok(true),
            Err(cause) if cause.kind() == ErrorKind::NotFound => Ok(false),
            Err(cause) => Err(Error::File { path: self.0.clone(), cause }),
        };
        // The directory goes with its last file.
        self.0.parent().map(Namespace::unmake);
        outcome
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

//! What can go wrong in a process, and the exit code that tells its supervisor.

use std::fmt;
use std::path::PathBuf;

use crate::config;

/// What a node's functions return.
pub type Result<T = ()> = std::result::Result<T, Error>;

/// Why a process cannot go on.
#[derive(Debug)]
pub enum Error {
    /// The configuration is wrong; starting again will not help.
    Config(config::Errors),
    /// A file that the process needs is not there or not readable.
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// Somebody else publishes on a topic that has one publisher.
    Taken {
        /// The topic's full name.
        topic: String,
        /// Who should be its publisher, by role.
        publisher: &'static str,
    },
    /// A topic exists with another message type, size or depth.
    Incompatible {
        /// The topic's full name.
        topic: String,
        /// The message type on this side.
        message: &'static str,
    },
    /// Shared memory refused an operation.
    SharedMemory {
        /// What was tried.
        action: String,
        /// The refusal.
        cause: String,
    },
    /// The name of a robot or node cannot be used.
    Name {
        /// The name.
        name: String,
    },
    /// The runtime directory's path does not fit in a socket's address.
    PathTooLong {
        /// The directory.
        path: PathBuf,
    },
    /// Another supervisor holds the robot, or nodes that nobody supervises.
    Held {
        /// The robot.
        robot: String,
        /// Who holds it.
        process: String,
    },
    /// The world's doing, found by the node's own code.
    Fault(String),
}

impl Error {
    /// The exit code: 78 for a wrong configuration (do not start me again), 5 where others hold
    /// the robot, else 1.
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) | Self::Name { .. } | Self::PathTooLong { .. } => 78,
            Self::Held { .. } => 5,
            Self::File { .. }
            | Self::Taken { .. }
            | Self::Incompatible { .. }
            | Self::SharedMemory { .. }
            | Self::Fault(_) => 1,
        }
    }

    pub(crate) fn shared_memory(action: impl Into<String>, cause: impl fmt::Debug) -> Self {
        Self::SharedMemory { action: action.into(), cause: format!("{cause:?}") }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(errors) => errors.fmt(formatter),
            Self::File { path, cause } => write!(formatter, "{}: {cause}", path.display()),
            Self::Taken { topic, publisher } => write!(
                formatter,
                "topic '{topic}' already has its one publisher ({publisher}); stop that one first"
            ),
            Self::Incompatible { topic, message } => write!(
                formatter,
                "topic '{topic}' exists, but not as {message} with this depth; \
                 are all processes of one build?"
            ),
            Self::SharedMemory { action, cause } => write!(formatter, "cannot {action}: {cause}"),
            Self::Name { name } => {
                write!(formatter, "'{name}' cannot be a name; use 1 to 32 of a-z, 0-9, '-' and '_'")
            }
            Self::PathTooLong { path } => write!(
                formatter,
                "the runtime directory {} is too long for a socket's address; \
                 set TESEO_RUNTIME_DIR to a shorter one",
                path.display()
            ),
            Self::Held { robot, process } => write!(
                formatter,
                "robot '{robot}' is already running, held by process {process}; \
                 stop that one, or name another robot with --robot"
            ),
            Self::Fault(what) => formatter.write_str(what),
        }
    }
}

impl std::error::Error for Error {}

impl From<config::Errors> for Error {
    fn from(errors: config::Errors) -> Self {
        Self::Config(errors)
    }
}

impl From<config::Error> for Error {
    fn from(error: config::Error) -> Self {
        let mut errors = config::Errors::default();
        errors.extend([error]);
        Self::Config(errors)
    }
}

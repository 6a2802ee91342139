//! Serial ports: opened raw, alone and without waiting, read and written without waiting.

use std::fmt;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use interfaces::Stamp;
use rustix::fs::{FlockOperation, Mode, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, SpecialCodeIndex, ioctl_tiocexcl, tcflush,
    tcgetattr, tcsetattr,
};

/// How long nobody tries a port again: it is back within a second of being plugged in.
const RETRY: std::time::Duration = std::time::Duration::from_millis(250);

/// Why a port cannot be used, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    path: String,
    /// The parameter that says it.
    key: &'static str,
    cause: Errno,
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, key, .. } = self;
        match self.cause {
            Errno::NOENT | Errno::NODEV | Errno::NXIO => write!(
                formatter,
                "{path} is not there: plug it in, or set `{key}` (ls -l /dev/serial/by-id)"
            ),
            Errno::ACCESS | Errno::PERM => write!(
                formatter,
                "may not open {path}: sudo usermod -aG dialout $USER, then log in again"
            ),
            Errno::BUSY | Errno::AGAIN => {
                write!(
                    formatter,
                    "{path} is in use by another program: sudo fuser -v {path} shows which"
                )
            }
            Errno::NOTTY | Errno::INVAL => {
                write!(formatter, "{path} is no serial port: set `{key}` to the right one")
            }
            cause => write!(formatter, "{path}: {cause}"),
        }
    }
}

/// The other side has gone: unplugged, or switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Gone(Errno);

impl fmt::Display for Gone {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "it went away ({})", self.0)
    }
}

/// One open serial port, 8N1, raw.
#[derive(Debug)]
struct Port(OwnedFd);

impl Port {
    fn open(path: &str, baud_rate: u32) -> Result<Self, Errno> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = rustix::fs::open(path, flags, Mode::empty())?;
        let mut modes = tcgetattr(&port)?;
        modes.make_raw();
        modes.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD | ControlModes::CS8;
        modes.control_modes -= ControlModes::CSTOPB | ControlModes::PARENB | ControlModes::CRTSCTS;
        // So that no bytes are told from no port.
        modes.special_codes[SpecialCodeIndex::VMIN] = 1;
        modes.special_codes[SpecialCodeIndex::VTIME] = 0;
        modes.set_speed(baud_rate)?;
        // The first keeps off those who do not ask, the second those who are root.
        ioctl_tiocexcl(&port)?;
        flock(&port, FlockOperation::NonBlockingLockExclusive)?;
        tcsetattr(&port, OptionalActions::Now, &modes)?;
        tcflush(&port, QueueSelector::IOFlush)?;
        Ok(Self(port))
    }

    /// What has come, as much as fits; 0 where there is nothing now.
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Gone> {
        match rustix::io::read(&self.0, buffer) {
            Ok(0) => Err(Gone(Errno::IO)),
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(cause) => Err(Gone(cause)),
        }
    }

    /// Writes what the port takes at once; the rest is lost, as on a bad line.
    fn write(&self, bytes: &[u8]) -> Result<(), Gone> {
        match rustix::io::write(&self.0, bytes) {
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(cause) => Err(Gone(cause)),
        }
    }
}

/// A port that comes and goes.
#[derive(Debug)]
pub(crate) struct Line {
    path: String,
    key: &'static str,
    port: Option<Port>,
    retry_due: Stamp,
}

impl Line {
    /// At `path`, as the parameter `key` says.
    pub(crate) fn new(path: &str, key: &'static str) -> Self {
        Self { path: path.to_owned(), key, port: None, retry_due: Stamp::ZERO }
    }

    pub(crate) fn is_open(&self) -> bool {
        self.port.is_some()
    }

    /// Opens it, if it is time to try.
    pub(crate) fn open(
        &mut self,
        now: Stamp,
        baud_rate: u32,
    ) -> Option<Result<BorrowedFd<'_>, Refusal>> {
        if self.is_open() || now < self.retry_due {
            return None;
        }
        self.retry_due = now.after(RETRY);
        Some(match Port::open(&self.path, baud_rate) {
            Ok(port) => Ok(self.port.insert(port).0.as_fd()),
            Err(cause) => Err(Refusal { path: self.path.clone(), key: self.key, cause }),
        })
    }

    /// Lets go of it; it is tried again a little later.
    pub(crate) fn close(&mut self, now: Stamp) {
        self.port = None;
        self.retry_due = now.after(RETRY);
    }

    /// When it is to be tried again.
    pub(crate) fn due(&self) -> Option<Stamp> {
        (!self.is_open()).then_some(self.retry_due)
    }

    /// What has come, as much as fits; 0 where there is nothing now.
    pub(crate) fn read(&self, buffer: &mut [u8]) -> Result<usize, Gone> {
        self.port.as_ref().map_or(Ok(0), |port| port.read(buffer))
    }

    /// Writes, where it is open.
    pub(crate) fn write(&self, bytes: &[u8]) -> Result<(), Gone> {
        let port = self.port.as_ref().filter(|_| !bytes.is_empty());
        port.map_or(Ok(()), |port| port.write(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Root may open everything: a whole robot can be refused only where somebody else runs the tests.
    #[test]
    fn a_refusal_says_what_to_do() {
        let says = |cause, what: &str| {
            let path = "/dev/ttyACM0".to_owned();
            let text = Refusal { path, key: "board_port", cause }.to_string();
            assert!(text.contains("/dev/ttyACM0") && text.contains(what), "{text}");
        };
        says(Errno::ACCESS, "sudo usermod -aG dialout $USER");
        says(Errno::NOENT, "set `board_port` (ls -l /dev/serial/by-id");
        says(Errno::BUSY, "fuser -v /dev/ttyACM0");
        says(Errno::NOTTY, "no serial port");
    }
}

//! One serial line: a pseudo-terminal under a name that stays, and what goes wrong on it.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// What happens to what is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Fault {
    /// Nothing.
    #[default]
    None,
    /// It is not sent.
    Silent,
    /// Other bytes are sent instead.
    Garbage,
    /// Only the first half of each packet is sent.
    Half,
    /// In every fourth packet a bit is flipped.
    Damaged,
}

/// A line with one end here.
#[derive(Debug)]
pub(crate) struct Line {
    link: PathBuf,
    end: Option<OwnedFd>,
    /// Whether somebody has opened the other end.
    is_open: bool,
    pub(crate) fault: Fault,
    random: ChaCha8Rng,
}

impl Line {
    /// Reached by the name `link`.
    pub(crate) fn new(link: &Path, seed: u64) -> io::Result<Self> {
        let mut new = Self {
            link: link.to_owned(),
            end: None,
            is_open: false,
            fault: Fault::None,
            random: ChaCha8Rng::seed_from_u64(seed),
        };
        new.plug()?;
        Ok(new)
    }

    /// The other end's name is there.
    pub(crate) fn plug(&mut self) -> io::Result<()> {
        self.unplug();
        let end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::io::ioctl_fionbio(&end, true)?;
        grantpt(&end)?;
        unlockpt(&end)?;
        // Until somebody sets it up, nothing must come back as an echo.
        let mut modes = tcgetattr(&end)?;
        modes.make_raw();
        tcsetattr(&end, OptionalActions::Now, &modes)?;
        let name = ptsname(&end, Vec::new())?;
        let name = name.to_str().map_err(|_| io::ErrorKind::InvalidData)?;
        std::os::unix::fs::symlink(name, &self.link)?;
        self.end = Some(end);
        Ok(())
    }

    /// Pulled out: the name is gone, and whoever has the other end is hung up on.
    pub(crate) fn unplug(&mut self) {
        // It may be gone already.
        let _ = std::fs::remove_file(&self.link);
        self.end = None;
        self.is_open = false;
    }

    /// [bit/s] What the other end has set.
    pub(crate) fn baud_rate(&self) -> u32 {
        let modes = self.end.as_ref().and_then(|end| tcgetattr(end).ok());
        modes.map_or(0, |modes| modes.output_speed())
    }

    /// What to wait for, where somebody is there.
    pub(crate) fn waits_for(&self) -> Option<BorrowedFd<'_>> {
        self.end.as_ref().filter(|_| self.is_open).map(AsFd::as_fd)
    }

    /// What has come.
    pub(crate) fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let Some(end) = &self.end else { return bytes };
        let mut piece = [0; 512];
        loop {
            match rustix::io::read(end, &mut piece) {
                Ok(0) => return bytes,
                Ok(count) => bytes.extend_from_slice(&piece[..count]),
                Err(cause) => {
                    // EIO: nobody has the other end.
                    self.is_open = cause == Errno::AGAIN || cause == Errno::INTR;
                    return bytes;
                }
            }
        }
    }

    /// Sends a packet, as its fault has it; what does not fit is lost.
    pub(crate) fn write(&mut self, packet: &[u8]) {
        let mut bytes = packet.to_vec();
        match self.fault {
            Fault::None => {}
            Fault::Silent => return,
            Fault::Garbage => self.random.fill_bytes(&mut bytes),
            Fault::Half => bytes.truncate(packet.len() / 2),
            Fault::Damaged => {
                let draw = self.random.next_u32() as usize;
                if draw.is_multiple_of(4) && !bytes.is_empty() {
                    let at = (draw >> 8) % bytes.len();
                    bytes[at] ^= 1 << (draw >> 2 & 7);
                }
            }
        }
        if let Some(end) = self.waits_for() {
            let _ = rustix::io::write(end, &bytes);
        }
    }

    /// Sends noise as long as this packet: what comes of the wrong baud rate.
    pub(crate) fn write_noise(&mut self, packet: &[u8]) {
        let fault = std::mem::replace(&mut self.fault, Fault::Garbage);
        self.write(packet);
        self.fault = fault;
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.unplug();
    }
}

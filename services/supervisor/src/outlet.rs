//! Standard output and standard error that never hold anybody up.

use std::collections::VecDeque;
use std::io::Write;
use std::os::fd::AsFd;
use std::time::Duration;

use node::clock;
use rustix::event::{PollFd, PollFlags, Timespec};

/// [byte] What a pipe takes without blocking once it is said to have room (`PIPE_BUF`).
const PIECE: usize = 4096;

/// [byte] What waits for a reader who has stopped; what comes after is dropped, and counted.
const WAITING_MAX: usize = 256 * 1024;

/// At the end, a slow reader gets so much time for what still waits.
const PATIENCE: Duration = Duration::from_secs(1);

/// One of the two.
#[derive(Debug)]
pub(crate) struct Outlet<W> {
    writer: W,
    waiting: VecDeque<u8>,
    dropped: u64,
}

impl<W: Write + AsFd> Outlet<W> {
    pub(crate) fn new(writer: W) -> Self {
        Self { writer, waiting: VecDeque::new(), dropped: 0 }
    }

    /// Writes as soon as there is room for it.
    pub(crate) fn print(&mut self, text: &str) {
        if WAITING_MAX < self.waiting.len() + text.len() {
            self.dropped += 1;
            return;
        }
        if 0 < self.dropped && self.waiting.is_empty() {
            let dropped = std::mem::take(&mut self.dropped);
            self.waiting.extend(format!("({dropped} lines were not read in time)\n").into_bytes());
        }
        self.waiting.extend(text.as_bytes());
        self.flush();
    }

    /// Writes what waits, as far as there is room.
    pub(crate) fn flush(&mut self) {
        while !self.waiting.is_empty() && self.has_room(Duration::ZERO) {
            self.write_piece();
        }
    }

    /// Writes what waits, and waits for it too, but not for ever.
    pub(crate) fn finish(&mut self) {
        let begun = clock::now();
        while !self.waiting.is_empty() {
            let left = PATIENCE.saturating_sub(clock::now().since(begun));
            if left.is_zero() || !self.has_room(left) {
                return;
            }
            self.write_piece();
        }
    }

    fn write_piece(&mut self) {
        let (piece, _) = self.waiting.as_slices();
        let piece = &piece[..piece.len().min(PIECE)];
        match self.writer.write(piece).and_then(|count| self.writer.flush().map(|()| count)) {
            Ok(count) => drop(self.waiting.drain(..count)),
            // Whoever closed it does not want to know, and a full disk cannot; the robot goes on.
            Err(_) => self.waiting.clear(),
        }
    }

    fn has_room(&self, patience: Duration) -> bool {
        let mut fds = [PollFd::new(&self.writer, PollFlags::OUT)];
        let timeout = Timespec::try_from(patience).unwrap_or_default();
        rustix::event::poll(&mut fds, Some(&timeout)).is_ok_and(|ready| 0 < ready)
    }
}

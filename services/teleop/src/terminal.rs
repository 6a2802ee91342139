//! The terminal: keys as they are pressed, and one line that is shown in place.

use std::io::{IsTerminal, Stdin, Stdout, Write};
use std::time::Duration;

use node::{Error, Result, signal};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcsetattr,
};

/// [byte] Far more than a person presses between two looks.
const PIECE: usize = 256;

/// What has come from a keyboard.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Come {
    /// These bytes; none where the time has passed, or a signal came.
    Bytes(Vec<u8>),
    /// The end: the terminal was closed, or the connection to it.
    Gone,
}

/// Standard input as a keyboard: every key comes at once, unechoed, and none makes a signal. However
/// this process ends, short of SIGKILL, the terminal is as it was before.
#[derive(Debug)]
pub(crate) struct Keyboard {
    terminal: Stdin,
    before: Termios,
}

impl Keyboard {
    pub(crate) fn open() -> Result<Self> {
        let terminal = std::io::stdin();
        if !terminal.is_terminal() {
            let why = "keys come from a terminal, which standard input is not";
            return Err(Error::Fault(why.to_owned()));
        }
        let failed = |cause: Errno| Error::Fault(format!("cannot read the terminal: {cause}"));
        let before = tcgetattr(&terminal).map_err(failed)?;
        let mut modes = before.clone();
        // Ctrl-C comes as a key, and is heard like `q`. Output stays as it is, so lines end as usual.
        modes.local_modes -=
            LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG | LocalModes::IEXTEN;
        // Nor may Ctrl-S hold up what is shown, and with it the commands.
        modes.input_modes -= InputModes::IXON;
        modes.special_codes[SpecialCodeIndex::VMIN] = 1;
        modes.special_codes[SpecialCodeIndex::VTIME] = 0;
        let keyboard = Self { terminal, before };
        tcsetattr(&keyboard.terminal, OptionalActions::Now, &modes).map_err(failed)?;
        Ok(keyboard)
    }

    /// Waits for keys, or a signal, but no longer than `timeout`.
    pub(crate) fn wait(&self, timeout: Duration) -> Come {
        let mut fds = vec![PollFd::new(&self.terminal, PollFlags::IN)];
        fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
        let timeout = Timespec::try_from(timeout).unwrap_or_default();
        let _ = rustix::event::poll(&mut fds, Some(&timeout));
        signal::sleep_again();
        if fds[0].revents().is_empty() {
            return Come::Bytes(Vec::new());
        }
        let mut bytes = [0; PIECE];
        match rustix::io::read(&self.terminal, &mut bytes) {
            Ok(0) => Come::Gone,
            Ok(count) => Come::Bytes(bytes[..count].to_vec()),
            Err(Errno::INTR | Errno::AGAIN) => Come::Bytes(Vec::new()),
            // EIO: the other side has hung up.
            Err(_) => Come::Gone,
        }
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        // Keys that nobody has read were meant for the robot, not for the shell. A terminal that is
        // gone needs nothing.
        let _ = tcsetattr(&self.terminal, OptionalActions::Flush, &self.before);
    }
}

/// Standard output: on a terminal one line in place, else a line for each change.
#[derive(Debug)]
pub(crate) struct Screen {
    output: Stdout,
    is_terminal: bool,
    shown: String,
}

impl Screen {
    pub(crate) fn new() -> Self {
        let output = std::io::stdout();
        let is_terminal = output.is_terminal();
        Self { output, is_terminal, shown: String::new() }
    }

    /// Prints lines that stay.
    pub(crate) fn say(&mut self, text: &str) {
        self.print(&format!("{text}\n"));
    }

    /// Shows `line`, unless it stands there already, or whoever should read it holds it up: driving
    /// does not wait for that.
    pub(crate) fn show(&mut self, line: &str) {
        if self.shown == line || !self.has_room() {
            return;
        }
        line.clone_into(&mut self.shown);
        if self.is_terminal {
            self.print(&format!("\r\x1b[K{line}"));
        } else {
            self.print(&format!("{line}\n"));
        }
    }

    fn has_room(&self) -> bool {
        let mut fds = [PollFd::new(&self.output, PollFlags::OUT)];
        rustix::event::poll(&mut fds, Some(&Timespec::default())).is_ok_and(|ready| 0 < ready)
    }

    fn print(&self, text: &str) {
        let mut output = self.output.lock();
        // Whoever closed it does not want to know.
        let _ = output.write_all(text.as_bytes()).and_then(|()| output.flush());
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        if self.is_terminal && !self.shown.is_empty() && self.has_room() {
            self.print("\n");
        }
    }
}

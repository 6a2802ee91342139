//! A person's end of a pseudo-terminal.

use std::cell::{Ref, RefCell};
use std::fs::File;
use std::io::{Read, Write};
use std::process::Stdio;
use std::time::Duration;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Termios, Winsize, tcgetattr, tcsetwinsize};

use crate::robot::{Robot, Run, wait_until};

/// How long may pass until something is sure to have happened.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A person's end of a pseudo-terminal, and what it shows.
pub(crate) struct Terminal {
    master: File,
    path: String,
    /// Held, so that it does not count as hung up between two programs.
    slave: File,
    /// Everything that ever came.
    shown: RefCell<String>,
    cells: RefCell<Cells>,
}

impl Terminal {
    pub(crate) fn new(columns: u16, rows: u16) -> Self {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        rustix::io::ioctl_fionbio(&master, true).unwrap();
        let slave = open(&path);
        let terminal = Self {
            master: master.into(),
            path,
            slave,
            shown: RefCell::default(),
            cells: RefCell::default(),
        };
        terminal.resize(columns, rows);
        terminal
    }

    pub(crate) fn resize(&self, columns: u16, rows: u16) {
        let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&self.slave, size).unwrap();
        self.cells.borrow_mut().resize(columns.into(), rows.into());
    }

    /// The program's end.
    pub(crate) fn end(&self) -> Stdio {
        open(&self.path).into()
    }

    /// Starts `teseo` on it.
    pub(crate) fn start<'a>(
        &self,
        robot: &'a Robot,
        words: &[&str],
        environment: &[(&str, &str)],
    ) -> Run<'a> {
        robot.start_under(&[], words, |command| {
            command.stdin(self.end()).stdout(self.end()).stderr(self.end());
            command.env("LC_ALL", "C.UTF-8").env_remove("NO_COLOR");
            command.envs(environment.iter().copied());
        })
    }

    pub(crate) fn press(&self, keys: &str) {
        (&self.master).write_all(keys.as_bytes()).unwrap();
    }

    pub(crate) fn modes(&self) -> Termios {
        tcgetattr(&self.slave).unwrap()
    }

    /// What a person sees.
    pub(crate) fn screen(&self) -> String {
        self.read();
        self.cells.borrow().text()
    }

    #[track_caller]
    pub(crate) fn await_screen(&self, what: &str, is_it: impl Fn(&str) -> bool) {
        let found = wait_until(TIMEOUT, || is_it(&self.screen()));
        assert!(found, "the screen never shows {what}:\n{}", self.screen());
    }

    #[track_caller]
    pub(crate) fn await_shown(&self, text: &str) {
        let found = wait_until(TIMEOUT, || self.shown().contains(text));
        assert!(found, "the terminal never showed '{text}': {}", self.shown());
    }

    /// Everything that was ever shown.
    pub(crate) fn shown(&self) -> Ref<'_, String> {
        self.read();
        self.shown.borrow()
    }

    /// Everything that was shown since this was last asked.
    pub(crate) fn take_shown(&self) -> String {
        self.read();
        self.shown.take()
    }

    #[track_caller]
    pub(crate) fn assert_restored(&self, before: &Termios) {
        assert_eq!(format!("{:?}", self.modes()), format!("{before:?}"));
        let shown = self.shown();
        for (set, reset) in [("\x1b[?1049h", "\x1b[?1049l"), ("\x1b[?25l", "\x1b[?25h")] {
            let (set, reset) = (shown.rfind(set), shown.rfind(reset));
            assert!(set.is_some() && set < reset, "{set:?} {reset:?}");
        }
    }

    fn read(&self) {
        let mut bytes = [0; 16384];
        while let Ok(count @ 1..) = (&self.master).read(&mut bytes) {
            let text = String::from_utf8_lossy(&bytes[..count]).into_owned();
            self.shown.borrow_mut().push_str(&text);
            self.cells.borrow_mut().take(&bytes[..count]);
        }
    }
}

fn open(path: &str) -> File {
    File::options().read(true).write(true).open(path).unwrap()
}

/// A terminal's characters: as much of one as the screen makes use of.
#[derive(Default)]
struct Cells {
    rows: Vec<Vec<char>>,
    at: (usize, usize),
    /// What of a sequence or a character has come.
    begun: Vec<u8>,
}

impl Cells {
    fn resize(&mut self, columns: usize, rows: usize) {
        self.rows = vec![vec![' '; columns]; rows];
    }

    fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.begun.push(byte);
            if self.begun[0] == 0x1b {
                let is_whole = 2 < self.begun.len() && (0x40..=0x7e).contains(&byte);
                if is_whole {
                    let sequence = String::from_utf8(std::mem::take(&mut self.begun)).unwrap();
                    self.obey(&sequence[2..]);
                }
            } else if let Ok(text) = std::str::from_utf8(&self.begun) {
                let character = text.chars().next().unwrap();
                self.begun.clear();
                self.put(character);
            }
        }
    }

    fn obey(&mut self, sequence: &str) {
        let (parameters, command) = sequence.split_at(sequence.len() - 1);
        match command {
            "H" => {
                let mut numbers = parameters.split(';').map(|number| number.parse().unwrap_or(1));
                let row: usize = numbers.next().unwrap_or(1);
                let column: usize = numbers.next().unwrap_or(1);
                self.at = (row - 1, column - 1);
            }
            "J" => self.rows.iter_mut().for_each(|row| row.fill(' ')),
            _ => {}
        }
    }

    fn put(&mut self, character: char) {
        match character {
            '\r' => self.at.1 = 0,
            '\n' => self.at.0 += 1,
            character => {
                if let Some(cell) =
                    self.rows.get_mut(self.at.0).and_then(|row| row.get_mut(self.at.1))
                {
                    *cell = character;
                }
                self.at.1 += 1;
            }
        }
    }

    fn text(&self) -> String {
        self.rows.iter().map(|row| String::from_iter(row) + "\n").collect()
    }
}

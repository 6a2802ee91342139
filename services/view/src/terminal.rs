//! The terminal: drawn on while the screen is open, and as it was before afterwards.

use std::io::{self, BufWriter, IsTerminal, Stdout};

use node::{Error, Result};
use ratatui::backend::{Backend, ClearType, CrosstermBackend, WindowSize};
use ratatui::buffer::Cell;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::layout::{Position, Size};
use ratatui::{Frame, Terminal};

/// [byte] More than a whole screen takes, so that it is written at once.
const BUFFER: usize = 256 * 1024;

/// An open screen. However it ends, short of SIGKILL, the terminal is as it was before.
pub(crate) struct Screen {
    terminal: Terminal<Output>,
}

impl Screen {
    pub(crate) fn open() -> Result<Self> {
        check_terminal()?;
        let output = BufWriter::with_capacity(BUFFER, io::stdout());
        let terminal = Terminal::new(Output(CrosstermBackend::new(output)));
        // From here on the end of this value puts everything back.
        let mut screen = Self { terminal: terminal.map_err(|cause| failed(&cause))? };
        enable_raw_mode().map_err(|cause| failed(&cause))?;
        let output = &mut screen.terminal.backend_mut().0;
        execute!(output, EnterAlternateScreen, Hide).map_err(|cause| failed(&cause))?;
        screen.terminal.clear().map_err(|cause| failed(&cause))?;
        Ok(screen)
    }

    /// Draws what has changed.
    pub(crate) fn draw(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> Result {
        self.terminal.draw(draw).map(drop).map_err(|cause| failed(&cause))
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Where the terminal is gone there is nothing to put back.
        let output = &mut self.terminal.backend_mut().0;
        let _ = execute!(output, LeaveAlternateScreen, Show);
        let _ = disable_raw_mode();
    }
}

/// Refuses where there is nothing to draw on, or nobody at the keys.
pub fn check_terminal() -> Result {
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    if std::io::stdin().is_terminal() && std::io::stdout().is_terminal() && !is_dumb {
        return Ok(());
    }
    let why =
        "a screen needs a terminal for input and output; `teseo view --once` prints one picture";
    Err(Error::Fault(why.to_owned()))
}

/// Standard output: as large as it is itself, not as the terminal that this process was started from,
/// and never asked where its cursor is, which not every terminal answers.
struct Output(CrosstermBackend<BufWriter<Stdout>>);

impl Backend for Output {
    type Error = io::Error;

    fn draw<'a, I: Iterator<Item = (u16, u16, &'a Cell)>>(&mut self, cells: I) -> io::Result<()> {
        self.0.draw(cells)
    }

    fn hide_cursor(&mut self) -> io::Result<()> {
        self.0.hide_cursor()
    }

    fn show_cursor(&mut self) -> io::Result<()> {
        self.0.show_cursor()
    }

    fn get_cursor_position(&mut self) -> io::Result<Position> {
        Ok(Position::ORIGIN)
    }

    fn set_cursor_position<P: Into<Position>>(&mut self, position: P) -> io::Result<()> {
        self.0.set_cursor_position(position)
    }

    fn clear(&mut self) -> io::Result<()> {
        self.0.clear()
    }

    fn clear_region(&mut self, region: ClearType) -> io::Result<()> {
        self.0.clear_region(region)
    }

    fn size(&self) -> io::Result<Size> {
        let size = rustix::termios::tcgetwinsize(io::stdout())?;
        // One that was never told its size has none.
        let is_told = 0 < size.ws_col && 0 < size.ws_row;
        Ok(if is_told { Size::new(size.ws_col, size.ws_row) } else { Size::new(80, 24) })
    }

    fn window_size(&mut self) -> io::Result<WindowSize> {
        Ok(WindowSize { columns_rows: self.size()?, pixels: Size::default() })
    }

    fn flush(&mut self) -> io::Result<()> {
        Backend::flush(&mut self.0)
    }
}

fn failed(cause: &dyn std::fmt::Display) -> Error {
    Error::Fault(format!("cannot draw on the terminal: {cause}"))
}

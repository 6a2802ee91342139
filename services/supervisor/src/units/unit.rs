//! The text of one unit file, line by line.

use std::fmt::{Display, Write};

/// A unit file in the making.
#[derive(Debug)]
pub(super) struct Unit(String);

impl Unit {
    /// Begins with `mark`, a comment.
    pub(super) fn new(mark: &str) -> Self {
        Self(format!("{mark}\n"))
    }

    pub(super) fn section(&mut self, name: &str) {
        let _ = write!(self.0, "\n[{name}]\n");
    }

    /// Says why the next line is as it is.
    pub(super) fn because(&mut self, why: &str) {
        let _ = writeln!(self.0, "# {why}");
    }

    pub(super) fn set(&mut self, key: &str, value: impl Display) {
        let value = value.to_string();
        // Whatever an argument or a variable contains, it cannot become a line of its own.
        assert!(!value.contains(char::is_control), "{key}={value:?} is more than one line");
        let _ = writeln!(self.0, "{key}={value}");
    }

    pub(super) fn into_text(self) -> String {
        self.0
    }
}

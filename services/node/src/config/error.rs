//! What is wrong with a configuration, where, and how to mend it.

use std::fmt;
use std::ops::Deref;
use std::path::PathBuf;

use super::source::Origin;

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Error {
    /// Where it was written.
    pub place: Place,
    /// Dotted, as in that place; empty if the mistake is not about a key.
    pub key: String,
    /// What is wrong.
    pub message: String,
    /// How to mend it.
    pub help: String,
    excerpt: Option<Excerpt>,
}

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// A character of a file, line and column from 1.
    Line {
        /// As the user would type it.
        file: PathBuf,
        /// [-] From 1.
        line: usize,
        /// [-] From 1, in characters.
        column: usize,
    },
    /// A file as a whole.
    File(PathBuf),
    /// `--set`, with the `KEY=VALUE` that followed.
    Setting(String),
    /// No layer: it is the default.
    Default,
}

/// The line of a mistake, and how much of it to mark.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Excerpt {
    pub(super) text: String,
    pub(super) width: usize,
}

impl Error {
    /// A mistake without a line to show.
    pub fn new(
        place: Place,
        key: impl Into<String>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        let (key, message, help) = (key.into(), message.into(), help.into());
        Self { place, key, message, help, excerpt: None }
    }

    pub(super) fn at(origin: &Origin, message: impl Into<String>, help: impl Into<String>) -> Self {
        let plain = Self::new(origin.place(), origin.key.clone(), message, help);
        Self { excerpt: origin.excerpt(), ..plain }
    }
}

impl std::error::Error for Error {}

impl fmt::Display for Error {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "error: ")?;
        if !self.key.is_empty() {
            write!(formatter, "`{}`: ", self.key)?;
        }
        writeln!(formatter, "{}", self.message)?;
        write!(formatter, "  --> {}", self.place)?;

        let mut margin = String::from(" ");
        if let (Place::Line { line, column, .. }, Some(excerpt)) = (&self.place, &self.excerpt) {
            margin = " ".repeat(line.to_string().len());
            let (text, marks) = excerpt.render(*column);
            write!(formatter, "\n{margin} |\n{line} | {text}\n{margin} | {marks}")?;
        }
        if !self.help.is_empty() {
            write!(formatter, "\n{margin} = help: {}", self.help)?;
        }
        Ok(())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { file, line, column } => {
                write!(formatter, "{}:{line}:{column}", file.display())
            }
            Self::File(path) => write!(formatter, "{}", path.display()),
            Self::Setting(text) => {
                write!(formatter, "--set {}", text.replace(char::is_control, " "))
            }
            Self::Default => write!(formatter, "default value"),
        }
    }
}

impl Excerpt {
    /// [character] What fits on a terminal beside the margin.
    const WIDTH: usize = 90;

    /// The line, cut around `column` if it is long, and carets under what is marked.
    fn render(&self, column: usize) -> (String, String) {
        let before = column - 1;
        let skipped = if before + self.width < Self::WIDTH { 0 } else { before.saturating_sub(20) };
        let shown = self.text.chars().skip(skipped).take(Self::WIDTH);
        // A tab or an escape sequence would move the carets, or the terminal.
        let text: String = shown.map(|c| if c.is_control() { ' ' } else { c }).collect();
        let width = self.width.clamp(1, Self::WIDTH - (before - skipped));
        (text.trim_end().to_owned(), " ".repeat(before - skipped) + &"^".repeat(width))
    }
}

/// All mistakes, in the order of the files; none means that all is well.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Errors(Vec<Error>);

impl Deref for Errors {
    type Target = [Error];

    fn deref(&self) -> &[Error] {
        &self.0
    }
}

impl Extend<Error> for Errors {
    /// Two processes that share a file share its mistakes: each is kept once.
    fn extend<I: IntoIterator<Item = Error>>(&mut self, errors: I) {
        self.0.extend(errors);
        self.0.sort();
        self.0.dedup();
    }
}

impl IntoIterator for Errors {
    type Item = Error;
    type IntoIter = std::vec::IntoIter<Error>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl std::error::Error for Errors {}

impl fmt::Display for Errors {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for error in &self.0 {
            writeln!(formatter, "{error}\n")?;
        }
        match self.len() {
            1 => write!(formatter, "1 error"),
            count => write!(formatter, "{count} errors"),
        }
    }
}

//! Where a value was written.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{Excerpt, Place};

/// Text that values were read from.
#[derive(Debug)]
pub(super) enum Source {
    /// A file, by the path the user knows it by.
    File { path: PathBuf, text: String },
    /// `KEY=VALUE`, as typed.
    Setting { text: String },
}

impl Source {
    pub(super) fn text(&self) -> &str {
        match self {
            Self::File { text, .. } | Self::Setting { text } => text,
        }
    }
}

/// The bytes a value or key was read from, and what it is called there.
#[derive(Debug, Clone)]
pub(super) struct Origin {
    source: Arc<Source>,
    span: Range<usize>,
    /// Dotted, from the top of the source.
    pub(super) key: String,
    /// Of what was typed, what a file has in its place, as the name of another file.
    instead_of: Option<PathBuf>,
}

impl Origin {
    pub(super) fn new(source: &Arc<Source>, span: Range<usize>, key: String) -> Self {
        let text = source.text();
        let (mut start, mut end) = (span.start.min(text.len()), span.end.min(text.len()));
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        while !text.is_char_boundary(end) {
            end += 1;
        }
        Self { source: Arc::clone(source), span: start..end.max(start), key, instead_of: None }
    }

    /// This is laid over the `name` that is written at `below`.
    pub(super) fn lie_over(&mut self, below: &Self, name: &str) {
        self.instead_of = match (&*self.source, &*below.source) {
            (Source::Setting { .. }, Source::File { .. }) => Some(below.directory().join(name)),
            (Source::Setting { .. }, Source::Setting { .. }) => below.instead_of.clone(),
            (Source::File { .. }, _) => None,
        };
    }

    /// Where the file lies that this was typed instead of.
    pub(super) fn home(&self) -> Option<&Path> {
        self.instead_of.as_deref()?.parent()
    }

    /// The same place, for another key.
    pub(super) fn called(&self, key: String) -> Self {
        Self { key, ..self.clone() }
    }

    pub(super) fn start(&self) -> usize {
        self.span.start
    }

    /// The directory that relative file names start from.
    pub(super) fn directory(&self) -> &Path {
        match &*self.source {
            Source::File { path, .. } => path.parent().unwrap_or(Path::new("")),
            Source::Setting { .. } => Path::new(""),
        }
    }

    pub(super) fn place(&self) -> Place {
        match &*self.source {
            Source::Setting { text } => Place::Setting(text.clone()),
            Source::File { path, text } => Place::Line {
                file: path.clone(),
                line: self.line(),
                column: text[self.line_start()..self.span.start].chars().count() + 1,
            },
        }
    }

    pub(super) fn excerpt(&self) -> Option<Excerpt> {
        let Source::File { text, .. } = &*self.source else { return None };
        let line = text[self.line_start()..].lines().next().unwrap_or_default();
        let line_end = self.line_start() + line.len();
        let marked = &text[self.span.start..self.span.end.min(line_end).max(self.span.start)];
        Some(Excerpt { text: line.to_owned(), width: marked.chars().count() })
    }

    pub(super) fn line(&self) -> usize {
        self.source.text()[..self.span.start].matches('\n').count() + 1
    }

    fn line_start(&self) -> usize {
        self.source.text()[..self.span.start].rfind('\n').map_or(0, |newline| newline + 1)
    }
}

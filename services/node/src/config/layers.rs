//! Reading TOML from several places, the later over the earlier.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use super::captured::{FileName, Table};
use super::error::{Error, Errors};
use super::listed::{Listable, Listed, listed};
use super::missing::unreadable;
use super::repair;
use super::report::{Parameters, Report};
use super::setting::Setting;
use super::source::{Origin, Source};
use super::value::Value;

/// Layers of configuration, the last one on top.
#[derive(Debug)]
pub struct Layers {
    merged: Value,
    errors: Vec<Error>,
    /// A layer could not be read, so that a missing key may be written there.
    incomplete: bool,
}

impl Default for Layers {
    fn default() -> Self {
        Self { merged: Value::table(None), errors: Vec::new(), incomplete: false }
    }
}

impl Layers {
    /// No layer yet: every key has its default.
    pub fn new() -> Self {
        Self::default()
    }

    /// The file at `path`, as the user typed it.
    #[must_use]
    pub fn file(self, path: impl AsRef<Path>) -> Self {
        self.read(path.as_ref(), None)
    }

    /// The file that another file names; nothing if there is no name.
    #[must_use]
    pub fn named<'a>(self, name: impl Into<Option<&'a FileName>>) -> Self {
        match name.into() {
            Some(name) => self.read(name.path(), name.origin()),
            None => self,
        }
    }

    /// A table captured from another file.
    #[must_use]
    pub fn table(mut self, table: &Table) -> Self {
        self.merged.merge(table.value().clone());
        self
    }

    /// What was set on the command line, in that order.
    #[must_use]
    pub fn settings<'a>(mut self, settings: impl IntoIterator<Item = &'a Setting>) -> Self {
        for setting in settings {
            self.merged.merge(setting.value().clone());
        }
        self
    }

    /// The value of all layers, or everything that is wrong with them.
    pub fn parse<T: Parameters>(self) -> Result<T, Errors> {
        self.parse_and(|_: &T, _| {})
    }

    /// The same, and what else `check` finds wrong that the value itself cannot know.
    pub fn parse_and<T: Parameters>(
        self,
        check: impl FnOnce(&T, &mut Report<'_>),
    ) -> Result<T, Errors> {
        let Self { mut merged, mut errors, incomplete } = self;
        let (parsed, rejected) = repair::read::<T>(&mut merged, incomplete);
        errors.extend(rejected);
        if let Some(parsed) = &parsed
            && !incomplete
        {
            let mut report = Report::new(&merged, &mut errors);
            parsed.check(&mut report);
            check(parsed, &mut report);
        }

        match parsed {
            Some(parsed) if errors.is_empty() => Ok(parsed),
            _ => {
                let mut all = Errors::default();
                all.extend(errors);
                Err(all)
            }
        }
    }

    /// Every key with its value, and where that was written; or everything that is wrong.
    pub fn listed<T: Listable>(self) -> Result<Vec<Listed>, Errors> {
        let merged = self.merged.clone();
        let parsed: T = self.parse()?;
        Ok(listed(&merged, &parsed))
    }

    fn read(mut self, path: &Path, named_at: Option<&Origin>) -> Self {
        match fs::read(path) {
            Ok(bytes) => return self.bytes(path, bytes),
            Err(error) => {
                self.incomplete = true;
                self.errors.push(unreadable(path, &error, named_at));
            }
        }
        self
    }

    pub(super) fn bytes(mut self, path: &Path, bytes: Vec<u8>) -> Self {
        let (text, invalid) = match String::from_utf8(bytes) {
            Ok(text) => (text, None),
            Err(error) => {
                let valid = error.utf8_error().valid_up_to();
                (String::from_utf8_lossy(error.as_bytes()).into_owned(), Some(valid))
            }
        };
        let text = text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text);
        let source = Arc::new(Source::File { path: path.to_owned(), text });

        let (value, errors) = match invalid {
            None => Value::parse_file(&source),
            Some(at) => {
                let origin = Origin::new(&source, at..at + 1, String::new());
                (None, vec![Error::at(&origin, "not UTF-8", "save the file as UTF-8")])
            }
        };
        self.errors.extend(errors);
        match value {
            Some(value) => self.merged.merge(value),
            None => self.incomplete = true,
        }
        self
    }
}

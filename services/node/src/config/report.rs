//! Mistakes that only the meaning of a value shows.

use std::fmt;

use serde::de::DeserializeOwned;

use super::error::Error;
use super::value::{Step, Value};

/// A struct that is read from configuration.
///
/// `#[serde(default, deny_unknown_fields)]` makes keys optional and strangers errors; without the
/// latter, a struct is a view of some keys. A `try_from` type says what is wrong and what to do as
/// `"not a port; write 1 to 65535"`.
pub trait Parameters: DeserializeOwned {
    /// Refuses values that have the right type and the wrong meaning.
    fn check(&self, _report: &mut Report<'_>) {}
}

/// Takes what [`Parameters::check`] refuses to the place it was written.
#[derive(Debug)]
pub struct Report<'a> {
    root: &'a Value,
    errors: &'a mut Vec<Error>,
    path: Vec<Step>,
}

impl<'a> Report<'a> {
    pub(super) fn new(root: &'a Value, errors: &'a mut Vec<Error>) -> Self {
        Self { root, errors, path: Vec::new() }
    }

    /// The same for a part: `self.drive.check(&mut report.within("drive"))`.
    pub fn within(&mut self, key: impl fmt::Display) -> Report<'_> {
        let path = self.path(&key.to_string());
        Report { root: self.root, errors: self.errors, path }
    }

    /// The value at `key` (`drive.speed_max_m_s`, `process[1].after[0]`) cannot be; `help` says
    /// what can.
    pub fn refuse(
        &mut self,
        key: impl fmt::Display,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        // What stands in for a mistake is none of the user's.
        if self.is_mended(&key) {
            return;
        }
        let path = self.path(&key.to_string());
        let written = self.root.along(&path).count() > 1;
        let root = if written { self.root } else { &Value::INVENTED };
        self.errors.push(root.mistake(&path, message, help));
    }

    /// Whether the value at `key` is wrong already, so that nothing follows from what stands there.
    pub fn is_mended(&self, key: impl fmt::Display) -> bool {
        self.root.along(&self.path(&key.to_string())).any(Value::is_mended)
    }

    fn path(&self, key: &str) -> Vec<Step> {
        let mut path = self.path.clone();
        for mut step in steps(key) {
            // An element that was left out is in the file still.
            if let (Step::Index(index), Some(array)) = (&mut step, self.root.along(&path).last()) {
                *index = array.written_index(*index).unwrap_or(*index);
            }
            path.push(step);
        }
        path
    }
}

/// The parts of a dotted key with indices in brackets.
fn steps(key: &str) -> Vec<Step> {
    let parts = key.split(['.', '[']).filter(|part| !part.is_empty());
    let step = |part: &str| match part.strip_suffix(']').map(str::parse) {
        Some(Ok(index)) => Step::Index(index),
        _ => Step::Key(part.to_owned()),
    };
    parts.map(step).collect()
}

//! A value set on the command line.

use std::str::FromStr;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::error::{Error, Place};
use super::likely::suggestion;
use super::source::{Origin, Source};
use super::value::{Entry, Kind, Step, Value, dotted};

/// `KEY=VALUE`: a dotted key, and a TOML value or, failing that, a bare string.
#[derive(Debug, Clone)]
pub struct Setting {
    text: String,
    value: Value,
}

impl Setting {
    /// The first part of the key.
    pub fn scope(&self) -> &str {
        match &self.value.kind {
            Kind::Table(entries) => entries.first().map_or("", |entry| &entry.key),
            _ => "",
        }
    }

    /// The setting as `scope` sees it, if it is meant for that: `controller.gain=2` sets `gain` of
    /// `controller`.
    #[must_use]
    pub fn within(&self, scope: &str) -> Option<Self> {
        let Kind::Table(entries) = &self.value.kind else { return None };
        let entry = entries.iter().find(|entry| entry.key == scope)?;
        Some(Self { text: self.text.clone(), value: entry.value.clone() })
    }

    /// The error of a setting whose scope is not among those `allowed`.
    pub fn unknown<S: AsRef<str>>(&self, allowed: &[S]) -> Error {
        let help = suggestion(self.scope(), allowed);
        Error::new(Place::Setting(self.text.clone()), self.scope(), "unknown key", help)
    }

    pub(super) fn value(&self) -> &Value {
        &self.value
    }
}

impl FromStr for Setting {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let malformed = || {
            let place = Place::Setting(text.to_owned());
            Error::new(
                place,
                "",
                "not a setting",
                "write `--set KEY=VALUE`, such as `--set speed.max=0.2`",
            )
        };
        let (key, written) = text.split_once('=').ok_or_else(malformed)?;
        let keys = keys(key).ok_or_else(malformed)?;

        let source = Arc::new(Source::Setting { text: text.to_owned() });
        let origin = |depth: usize| {
            let steps: Vec<_> = keys[..depth].iter().cloned().map(Step::Key).collect();
            Origin::new(&source, 0..text.len(), dotted("", &steps))
        };
        let leaf = match DeValue::parse(written.trim()) {
            Ok(value) => Value::from_toml(&source, value.get_ref(), origin(keys.len())),
            Err(_) => {
                Value { kind: Kind::String(written.to_owned()), origin: Some(origin(keys.len())) }
            }
        };

        let value = keys.iter().enumerate().rfold(leaf, |value, (depth, key)| {
            let key_origin = Some(origin(depth + 1));
            let entry = Entry { key: key.clone(), key_origin, value };
            Value { kind: Kind::Table(vec![entry]), origin: Some(origin(depth)) }
        });
        Ok(Self { text: text.to_owned(), value })
    }
}

/// The parts of a dotted key; TOML itself knows best what is one.
fn keys(text: &str) -> Option<Vec<String>> {
    let line = format!("{text}=0");
    let document = DeTable::parse(&line).ok()?;
    let mut table = document.get_ref();
    let mut keys = Vec::new();
    while let Some((key, value)) = table.iter().next() {
        keys.push(key.get_ref().to_string());
        match value.get_ref() {
            DeValue::Table(below) => table = below,
            _ if text.contains('\n') => return None,
            _ => return Some(keys),
        }
    }
    None
}

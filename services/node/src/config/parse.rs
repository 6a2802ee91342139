//! From TOML's text to the tree.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::error::Error;
use super::source::{Origin, Source};
use super::value::{Entry, Kind, Step, Value, dotted};

impl Value {
    /// A file's tree, unless its syntax is too wrong for the rest to mean anything.
    pub(super) fn parse_file(source: &Arc<Source>) -> (Option<Self>, Vec<Error>) {
        let (table, errors) = DeTable::parse_recoverable(source.text());
        let only_duplicates = errors.iter().all(|error| error.message() == "duplicate key");
        let value = only_duplicates.then(|| {
            let value = DeValue::Table(table.get_ref().clone());
            Self::from_toml(source, &value, Origin::new(source, 0..0, String::new()))
        });
        (value, syntax_errors(source, &errors))
    }

    /// `origin` is given, not taken from `value`: a setting's parts all are where the setting is.
    pub(super) fn from_toml(source: &Arc<Source>, value: &DeValue<'_>, origin: Origin) -> Self {
        let kind = match value {
            DeValue::Boolean(value) => Kind::Boolean(*value),
            DeValue::Integer(value) => match i128::from_str_radix(value.as_str(), value.radix()) {
                Ok(value) => Kind::Integer(value),
                Err(_) => Kind::Float(value.as_str().parse().unwrap_or(f64::INFINITY)),
            },
            DeValue::Float(value) => Kind::Float(value.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::String(value) => Kind::String(value.to_string()),
            // Nothing in a robot is configured by a date: it is text.
            DeValue::Datetime(value) => Kind::String(value.to_string()),
            DeValue::Array(values) => {
                let values = values.iter().enumerate().map(|(index, value)| {
                    let key = dotted(&origin.key, &[Step::Index(index)]);
                    Self::from_toml(source, value.get_ref(), Origin::new(source, value.span(), key))
                });
                Kind::Array(values.collect())
            }
            DeValue::Table(table) => {
                let entries = table.iter().map(|(name, value)| {
                    let key = dotted(&origin.key, &[Step::Key(name.get_ref().to_string())]);
                    let value_origin = Origin::new(source, value.span(), key.clone());
                    Entry {
                        key: name.get_ref().to_string(),
                        key_origin: Some(Origin::new(source, name.span(), key)),
                        value: Self::from_toml(source, value.get_ref(), value_origin),
                    }
                });
                Kind::Table(entries.collect())
            }
        };
        Self { kind, origin: Some(origin) }
    }
}

/// One per line, and none after an open bracket: what follows is seldom meant as the parser sees
/// it.
fn syntax_errors(source: &Arc<Source>, errors: &[toml::de::Error]) -> Vec<Error> {
    let mut errors: Vec<_> = errors
        .iter()
        .map(|error| (Origin::new(source, error.span().unwrap_or(0..0), String::new()), error))
        .collect();
    errors.sort_by_key(|(origin, _)| origin.start());
    errors.dedup_by_key(|(origin, _)| origin.line());
    if let Some(open) = errors.iter().position(|(_, error)| error.message().contains("array")) {
        errors.truncate(open + 1);
    }
    errors.iter().map(|(origin, error)| syntax_error(source, origin, error)).collect()
}

fn syntax_error(source: &Arc<Source>, origin: &Origin, error: &toml::de::Error) -> Error {
    let written = error.span().and_then(|span| source.text().get(span)).unwrap_or_default();
    let (message, expected) =
        error.message().split_once(", expected ").unwrap_or((error.message(), ""));
    match message {
        "duplicate key" => Error::at(
            &origin.called(written.to_owned()),
            message,
            "remove it here or where it was first written",
        ),
        "string values must be quoted" if written.is_empty() => {
            Error::at(origin, "a value is missing", "write a value after `=`")
        }
        "string values must be quoted" => {
            Error::at(origin, message, format!("write it in quotes: {written:?}"))
        }
        _ if expected.is_empty() || expected == "nothing" => {
            Error::at(origin, message, "remove what does not belong here")
        }
        _ => Error::at(origin, message, format!("expected {expected}")),
    }
}

//! Parts of a file that are kept, with their places, for someone else to read.

use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{Deserialize, Deserializer, Error as _, Visitor};
use serde::{Serialize, Serializer};

use super::report::Parameters;
use super::source::Origin;
use super::value::{Kind, Value};

/// A table as written: a launch file's `parameters`, which only the process named there
/// understands.
#[derive(Debug, Clone)]
pub struct Table(Value);

impl Table {
    pub(super) fn value(&self) -> &Value {
        &self.0
    }
}

impl Default for Table {
    fn default() -> Self {
        Self(Value::table(None))
    }
}

impl Parameters for Table {}

impl<'de> Deserialize<'de> for Table {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::capture(deserializer)?;
        match &value.kind {
            Kind::Table(_) => Ok(Self(value)),
            Kind::Invented(_) => Ok(Self::default()),
            kind => Err(D::Error::invalid_type(kind.unexpected(), &"a map")),
        }
    }
}

/// The name of another file, relative to the file it is written in; on the command line, to the
/// working directory.
#[derive(Debug, Clone, Default)]
pub struct FileName {
    path: PathBuf,
    origin: Option<Origin>,
}

impl FileName {
    /// As the user would type it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn origin(&self) -> Option<&Origin> {
        self.origin.as_ref()
    }
}

impl Serialize for FileName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.path.serialize(serializer)
    }
}

impl PartialEq for FileName {
    fn eq(&self, other: &Self) -> bool {
        self.path == other.path
    }
}

impl<P: Into<PathBuf>> From<P> for FileName {
    fn from(path: P) -> Self {
        Self { path: path.into(), origin: None }
    }
}

impl<'de> Deserialize<'de> for FileName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::capture(deserializer)?;
        match (value.kind, value.origin) {
            (Kind::String(name), Some(origin)) => {
                Ok(Self { path: origin.directory().join(name), origin: Some(origin) })
            }
            (Kind::String(name), None) => Ok(name.into()),
            (Kind::Invented(_), _) => Ok(Self::default()),
            (kind, _) => Err(D::Error::invalid_type(kind.unexpected(), &"a file name in quotes")),
        }
    }
}

/// The name by which [`super::reader::Reader`] recognises that a value is wanted as it is.
pub(super) const CAPTURE: &str = "node::config::Value";

thread_local! {
    // Serde has no word for "the value itself", so it is handed over beside serde's back.
    static HANDED_OVER: RefCell<Option<Value>> = const { RefCell::new(None) };
}

pub(super) fn hand_over(value: &Value) {
    HANDED_OVER.set(Some(value.clone()));
}

impl Value {
    fn capture<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(CAPTURE, Capture)?;
        HANDED_OVER.take().ok_or_else(|| D::Error::custom("cannot be captured in this place"))
    }
}

struct Capture;

impl<'de> Visitor<'de> for Capture {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a value of a configuration file")
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    /// From no configuration file: the name is whole already.
    fn visit_newtype_struct<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        let name = String::deserialize(deserializer)?;
        hand_over(&Value { kind: Kind::String(name), origin: None });
        Ok(())
    }
}

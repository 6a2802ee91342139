//! A tree of TOML values that know where they were written.

use std::fmt;

use serde::de::Unexpected;

use super::error::{Error, Place};
use super::source::Origin;

/// A value and where it was written.
#[derive(Debug, Clone)]
pub(super) struct Value {
    pub(super) kind: Kind,
    /// Absent in what nobody wrote.
    pub(super) origin: Option<Origin>,
}

#[derive(Debug, Clone)]
pub(super) enum Kind {
    Boolean(bool),
    /// Wide enough for `u64` seeds, which TOML's own integers are not.
    Integer(i128),
    Float(f64),
    String(String),
    Array(Vec<Value>),
    Table(Vec<Entry>),
    /// A mistake, already reported: the key counts as not written.
    Absent,
    /// Stands for a value that is wrong or missing: pleases every type.
    Invented(Vec<Entry>),
}

/// A key of a table, and its value.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) key_origin: Option<Origin>,
    pub(super) value: Value,
}

/// One step down the tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    Key(String),
    Index(usize),
}

impl Value {
    /// What pleases every type.
    pub(super) const INVENTED: Self = Self { kind: Kind::Invented(Vec::new()), origin: None };

    /// An empty table.
    pub(super) fn table(origin: Option<Origin>) -> Self {
        Self { kind: Kind::Table(Vec::new()), origin }
    }

    /// Lays `above` over this: tables key by key, anything else as a whole.
    pub(super) fn merge(&mut self, above: Self) {
        match (&mut self.kind, above.kind) {
            (Kind::Table(entries), Kind::Table(above_entries)) => {
                self.origin = self.origin.take().or(above.origin);
                for above in above_entries {
                    match entries.iter_mut().find(|entry| entry.key == above.key) {
                        Some(entry) => {
                            entry.value.merge(above.value);
                            entry.key_origin = above.key_origin;
                        }
                        None => entries.push(above),
                    }
                }
            }
            (below, kind) => {
                let mut origin = above.origin;
                if let (Kind::String(name), Some(below)) = (below, &self.origin)
                    && let Some(origin) = &mut origin
                {
                    origin.lie_over(below, name);
                }
                *self = Self { kind, origin };
            }
        }
    }

    fn child(&self, step: &Step) -> Option<&Self> {
        match (&self.kind, step) {
            (Kind::Table(entries) | Kind::Invented(entries), Step::Key(key)) => {
                entries.iter().find(|entry| entry.key == *key).map(|entry| &entry.value)
            }
            (Kind::Array(values), Step::Index(index)) => values.get(*index),
            _ => None,
        }
    }

    pub(super) fn at_mut(&mut self, path: &[Step]) -> Option<&mut Self> {
        let Some((step, rest)) = path.split_first() else { return Some(self) };
        match (&mut self.kind, step) {
            (Kind::Table(entries) | Kind::Invented(entries), Step::Key(key)) => {
                entries.iter_mut().find(|entry| entry.key == *key)?.value.at_mut(rest)
            }
            (Kind::Array(values), Step::Index(index)) => values.get_mut(*index)?.at_mut(rest),
            _ => None,
        }
    }

    /// This value and those on the way down `path`, as far as it exists.
    pub(super) fn along<'a, 'p>(
        &'a self,
        path: &'p [Step],
    ) -> impl Iterator<Item = &'a Self> + use<'a, 'p> {
        let mut steps = path.iter();
        std::iter::successors(Some(self), move |value| value.child(steps.next()?))
    }

    /// Whether this stands in for a mistake that is reported already.
    pub(super) fn is_mended(&self) -> bool {
        matches!(self.kind, Kind::Absent | Kind::Invented(_))
    }

    /// Where the element is written that is the `index`th of those present.
    pub(super) fn written_index(&self, index: usize) -> Option<usize> {
        let Kind::Array(values) = &self.kind else { return None };
        let present = |(_, value): &(usize, &Self)| !matches!(value.kind, Kind::Absent);
        Some(values.iter().enumerate().filter(present).nth(index)?.0)
    }

    /// Where the last key of `path` was written.
    pub(super) fn key_origin(&self, path: &[Step]) -> Option<&Origin> {
        let (Step::Key(key), above) = path.split_last()? else { return None };
        match &self.along(above).nth(above.len())?.kind {
            Kind::Table(entries) => {
                entries.iter().find(|entry| entry.key == *key)?.key_origin.as_ref()
            }
            _ => None,
        }
    }

    /// The mistake at `path`, shown where that was written, or else the table it belongs to.
    pub(super) fn mistake(
        &self,
        path: &[Step],
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Error {
        let written = self.along(path).enumerate().filter_map(|(depth, value)| {
            let origin = value.origin.as_ref()?;
            Some((origin, &path[depth..]))
        });
        match written.last() {
            Some((origin, below)) => {
                Error::at(&origin.called(dotted(&origin.key, below)), message, help)
            }
            None => Error::new(Place::Default, dotted("", path), message, help),
        }
    }
}

impl Kind {
    /// In serde's words.
    pub(super) fn unexpected(&self) -> Unexpected<'_> {
        match self {
            Self::Boolean(value) => Unexpected::Bool(*value),
            Self::Integer(value) => match i64::try_from(*value) {
                Ok(value) => Unexpected::Signed(value),
                Err(_) => Unexpected::Other("a large number"),
            },
            Self::Float(value) => Unexpected::Float(*value),
            Self::String(text) => Unexpected::Str(text),
            Self::Array(_) => Unexpected::Seq,
            Self::Table(_) => Unexpected::Map,
            Self::Absent | Self::Invented(_) => Unexpected::Unit,
        }
    }
}

impl fmt::Display for Step {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        match self {
            Self::Key(key) if key.chars().all(bare) && !key.is_empty() => formatter.write_str(key),
            Self::Key(key) => write!(formatter, "{key:?}"),
            Self::Index(index) => write!(formatter, "[{index}]"),
        }
    }
}

/// The key `below` the dotted key `above`.
pub(super) fn dotted(above: &str, below: &[Step]) -> String {
    below.iter().fold(above.to_owned(), |above, step| match step {
        Step::Key(_) if !above.is_empty() => format!("{above}.{step}"),
        _ => format!("{above}{step}"),
    })
}

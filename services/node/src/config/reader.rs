//! The tree as serde wants it.

use std::slice;

use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{
    self, DeserializeSeed, Deserializer, IntoDeserializer, MapAccess, SeqAccess, Unexpected,
    Visitor,
};
use serde::forward_to_deserialize_any;

use super::captured::{self, CAPTURE};
use super::likely::quoted;
use super::rejection::{Rejection, in_words};
use super::value::{Entry, Kind, Step, Value};

/// Reads one value.
pub(super) struct Reader<'a>(pub(super) &'a Value);

impl<'a> Reader<'a> {
    fn invented(&self) -> bool {
        matches!(self.0.kind, Kind::Invented(_))
    }

    fn entries(&self) -> Entries<'a> {
        let entries = match &self.0.kind {
            Kind::Table(entries) | Kind::Invented(entries) => entries.as_slice(),
            _ => &[],
        };
        Entries { entries: entries.iter(), current: None }
    }
}

/// Types that can be read as they come, and what stands in for them where a value was invented.
macro_rules! read_as_it_comes {
    ($($method:ident or $visit:ident($default:expr),)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
            if self.invented() { visitor.$visit($default) } else { self.deserialize_any(visitor) }
        }
    )*};
}

impl<'de> Deserializer<'de> for Reader<'_> {
    type Error = Rejection;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
        match &self.0.kind {
            Kind::Boolean(value) => visitor.visit_bool(*value),
            Kind::Integer(value) => match (i64::try_from(*value), u64::try_from(*value)) {
                (Ok(value), _) => visitor.visit_i64(value),
                (_, Ok(value)) => visitor.visit_u64(value),
                _ => visitor.visit_f64(*value as f64),
            },
            Kind::Float(value) if value.is_finite() => visitor.visit_f64(*value),
            Kind::Float(value) => {
                Err(de::Error::invalid_value(Unexpected::Float(*value), &"a finite number"))
            }
            Kind::String(text) => visitor.visit_str(text),
            Kind::Array(values) => visitor.visit_seq(Elements { values, next: 0 }),
            Kind::Table(_) => visitor.visit_map(self.entries()),
            Kind::Absent | Kind::Invented(_) => visitor.visit_unit(),
        }
    }

    read_as_it_comes! {
        deserialize_bool or visit_bool(false),
        deserialize_i8 or visit_i8(0),
        deserialize_i16 or visit_i16(0),
        deserialize_i32 or visit_i32(0),
        deserialize_i64 or visit_i64(0),
        deserialize_u8 or visit_u8(0),
        deserialize_u16 or visit_u16(0),
        deserialize_u32 or visit_u32(0),
        deserialize_u64 or visit_u64(0),
        deserialize_f64 or visit_f64(0.0),
        deserialize_str or visit_str(""),
        deserialize_string or visit_str(""),
        deserialize_seq or visit_seq(Elements { values: &[], next: 0 }),
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
        match self.0.kind {
            // Serde would make it infinite without a word.
            Kind::Float(value) if f64::from(f32::MAX) < value.abs() && value.is_finite() => {
                Err(de::Error::invalid_value(Unexpected::Float(value), &"a number below 3.4e38"))
            }
            _ => self.deserialize_f64(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Rejection> {
        if name == CAPTURE {
            captured::hand_over(self.0);
            return visitor.visit_unit();
        }
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, Rejection> {
        match &self.0.kind {
            Kind::Array(values) if values.len() == length => self.deserialize_any(visitor),
            Kind::Invented(_) => {
                let values = vec![Value::INVENTED; length];
                visitor.visit_seq(Elements { values: &values, next: 0 })
            }
            kind => {
                let found = match kind {
                    Kind::Array(values) => values.len().to_string(),
                    _ => in_words(kind.unexpected()),
                };
                Err(Rejection::bad_value(
                    format!("expected an array of {length} values, found {found}"),
                    format!("write {length} values in brackets"),
                ))
            }
        }
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, Rejection> {
        self.deserialize_tuple(length, visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
        if self.invented() {
            visitor.visit_map(self.entries())
        } else {
            self.deserialize_any(visitor)
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Rejection> {
        match &self.0.kind {
            // Serde would fill the fields in order, but a table says what is what.
            Kind::Array(_) => Err(de::Error::invalid_type(Unexpected::Seq, &visitor)),
            _ => self.deserialize_map(visitor),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Rejection> {
        let name = match &self.0.kind {
            Kind::String(name) => name,
            Kind::Invented(_) => variants.first().copied().unwrap_or_default(),
            Kind::Table(entries) if entries.len() == 1 => {
                return visitor.visit_enum(MapAccessDeserializer::new(self.entries()));
            }
            kind => {
                let allowed = quoted(variants);
                return Err(Rejection::bad_value(
                    format!("expected a name in quotes, found {}", in_words(kind.unexpected())),
                    format!("allowed: {allowed}"),
                ));
            }
        };
        let name: StrDeserializer<'_, Rejection> = name.into_deserializer();
        visitor.visit_enum(name)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Rejection> {
        visitor.visit_unit()
    }

    forward_to_deserialize_any! { i128 u128 char bytes byte_buf unit unit_struct identifier }
}

/// An array's values, without those that are absent.
struct Elements<'a> {
    values: &'a [Value],
    next: usize,
}

impl<'de> SeqAccess<'de> for Elements<'_> {
    type Error = Rejection;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Rejection> {
        let mut rest = self.values.iter().enumerate().skip(self.next);
        let present = rest.find(|(_, value)| !matches!(value.kind, Kind::Absent));
        let Some((index, value)) = present else { return Ok(None) };
        self.next = index + 1;
        let element = seed.deserialize(Reader(value));
        element.map(Some).map_err(|rejection| rejection.below(Step::Index(index)))
    }
}

/// A table's keys and values, without those that are absent.
struct Entries<'a> {
    entries: slice::Iter<'a, Entry>,
    current: Option<&'a Entry>,
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Rejection;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Rejection> {
        self.current = self.entries.find(|entry| !matches!(entry.value.kind, Kind::Absent));
        let Some(entry) = self.current else { return Ok(None) };
        let key: StrDeserializer<'_, Rejection> = entry.key.as_str().into_deserializer();
        seed.deserialize(key).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Rejection> {
        let Some(entry) = self.current else {
            return Err(de::Error::custom("a value was asked for before its key"));
        };
        let value = seed.deserialize(Reader(&entry.value));
        value.map_err(|rejection| rejection.below(Step::Key(entry.key.clone())))
    }
}

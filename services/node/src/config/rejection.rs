//! Why a value was not taken, in serde's words and then in ours.

use std::fmt::{self, Display};

use serde::de::{self, Expected, Unexpected};

use super::likely::suggestion;
use super::value::Step;

/// Why a value was not taken.
#[derive(Debug)]
pub(super) struct Rejection {
    pub(super) path: Vec<Step>,
    pub(super) reason: Reason,
}

#[derive(Debug)]
pub(super) enum Reason {
    /// The table at the path has a key that means nothing.
    UnknownKey { key: String, allowed: &'static [&'static str] },
    /// The table at the path lacks a key.
    MissingKey(&'static str),
    /// The value at the path is wrong.
    BadValue { message: String, help: String },
}

impl Rejection {
    fn new(reason: Reason) -> Self {
        Self { path: Vec::new(), reason }
    }

    pub(super) fn bad_value(message: String, help: String) -> Self {
        Self::new(Reason::BadValue { message, help })
    }

    /// The same, seen from one step further up.
    pub(super) fn below(mut self, step: Step) -> Self {
        self.path.insert(0, step);
        self
    }
}

impl de::Error for Rejection {
    fn custom<T: Display>(message: T) -> Self {
        let message = message.to_string();
        let (message, help) = message.split_once("; ").unwrap_or((&message, ""));
        Self::bad_value(message.to_owned(), help.to_owned())
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let (expected, example) = wanted(&expected.to_string());
        let help = match found {
            Unexpected::Str(text)
                if expected.contains("number") && text.parse().is_ok_and(f64::is_finite) =>
            {
                format!("write it without quotes: `{text}`")
            }
            Unexpected::Bool(_) | Unexpected::Signed(_) | Unexpected::Float(_)
                if expected == "a string" =>
            {
                format!("write it in quotes: `\"{}\"`", in_words(found))
            }
            _ => example,
        };
        Self::bad_value(format!("expected {expected}, found {}", in_words(found)), help)
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn unknown_variant(found: &str, allowed: &'static [&'static str]) -> Self {
        Self::bad_value(format!("unknown value {found:?}"), suggestion(found, allowed))
    }

    fn unknown_field(key: &str, allowed: &'static [&'static str]) -> Self {
        Self::new(Reason::UnknownKey { key: key.to_owned(), allowed })
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Reason::MissingKey(key))
    }
}

impl std::error::Error for Rejection {}

impl Display for Rejection {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:?}", self.reason)
    }
}

pub(super) fn in_words(found: Unexpected<'_>) -> String {
    /// [byte] Enough to recognise a string by.
    const LENGTH_MAX: usize = 60;

    match found {
        Unexpected::Bool(value) => value.to_string(),
        Unexpected::Signed(value) => value.to_string(),
        Unexpected::Unsigned(value) => value.to_string(),
        Unexpected::Float(value) => format!("{value:?}").to_lowercase(),
        Unexpected::Str(text) if text.len() <= LENGTH_MAX => format!("the string {text:?}"),
        Unexpected::Str(_) => "a long string".to_owned(),
        Unexpected::Seq => "an array".to_owned(),
        Unexpected::Map => "a table".to_owned(),
        other => other.to_string(),
    }
}

/// What serde's visitors expect, for people, and how to write it.
fn wanted(expected: &str) -> (String, String) {
    let (expected, example) = match expected {
        "f64" | "f32" => ("a number", "1.5"),
        "a finite number" => ("a finite number", "1.5"),
        "i64" | "isize" => ("a whole number", "3"),
        "u64" | "usize" => ("a whole number, 0 or more", "3"),
        "u32" => ("a whole number from 0 to 4294967295", "3"),
        "u16" => ("a whole number from 0 to 65535", "3"),
        "u8" => ("a whole number from 0 to 255", "3"),
        "i32" => ("a whole number from -2147483648 to 2147483647", "3"),
        "i16" => ("a whole number from -32768 to 32767", "3"),
        "i8" => ("a whole number from -128 to 127", "3"),
        "a boolean" => ("true or false", "true"),
        "a string" => ("a string", "\"text\""),
        "a sequence" => ("an array", "[…]"),
        "a map" => ("a table", "{ key = … }"),
        table if table.starts_with("struct ") => ("a table", "{ key = … }"),
        other => return (other.to_owned(), format!("write {other}")),
    };
    (expected.to_owned(), format!("write {expected}, such as `{example}`"))
}

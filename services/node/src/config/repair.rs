//! Reading on after a mistake, so that all of them are found.

use super::error::Error;
use super::likely::suggestion;
use super::reader::Reader;
use super::rejection::{Reason, Rejection};
use super::report::Parameters;
use super::value::{Entry, Kind, Step, Value};

/// [-] Far more mistakes than anyone mends at once; each costs one reading.
const MISTAKES_MAX: usize = 1_000;

/// Reads `root`; after a mistake, reports and mends it and reads again, until nothing is wrong any
/// more.
///
/// Nothing comes back if there is a type that no invented value pleases. A missing key is no
/// mistake while the tree is `incomplete`.
pub(super) fn read<T: Parameters>(root: &mut Value, incomplete: bool) -> (Option<T>, Vec<Error>) {
    let mut errors = Vec::new();
    for _ in 0..MISTAKES_MAX {
        let rejection = match T::deserialize(Reader(root)) {
            Ok(parsed) => return (Some(parsed), errors),
            Err(rejection) => rejection,
        };
        let excused = incomplete && matches!(rejection.reason, Reason::MissingKey(_));
        if !excused && !is_known(root, &rejection) {
            errors.push(error(root, &rejection));
        }
        if !mend(root, &rejection) {
            break;
        }
    }
    (None, errors)
}

/// Whether it follows from a mistake that was reported before.
fn is_known(root: &Value, rejection: &Rejection) -> bool {
    root.along(&place(rejection)).any(Value::is_mended)
}

fn error(root: &Value, rejection: &Rejection) -> Error {
    let place = place(rejection);
    match &rejection.reason {
        Reason::UnknownKey { key, allowed } => {
            let help = suggestion(key, allowed);
            match root.key_origin(&place) {
                Some(origin) => Error::at(origin, "unknown key", help),
                None => root.mistake(&place, "unknown key", help),
            }
        }
        Reason::MissingKey(key) => root.mistake(&place, "missing key", format!("add `{key} = …`")),
        Reason::BadValue { message, help } => root.mistake(&place, message, help),
    }
}

/// The path of the key or value that the rejection is about.
fn place(rejection: &Rejection) -> Vec<Step> {
    let mut path = rejection.path.clone();
    match &rejection.reason {
        Reason::UnknownKey { key, .. } => path.push(Step::Key(key.clone())),
        Reason::MissingKey(key) => path.push(Step::Key((*key).to_owned())),
        Reason::BadValue { .. } => {}
    }
    path
}

/// Changes the tree such that the mistake is gone: forgets the key, or else invents a value; if
/// that does not help, the same with what is around it. False if there is nothing left to try.
fn mend(root: &mut Value, rejection: &Rejection) -> bool {
    let mended = match (&rejection.reason, root.at_mut(&rejection.path)) {
        (Reason::UnknownKey { key, .. }, Some(table)) => forget(table, key),
        (Reason::MissingKey(key), Some(table)) => invent(table, key),
        (Reason::BadValue { .. }, _) | (_, None) => false,
    };
    if mended {
        return true;
    }

    let mut path = &rejection.path[..];
    loop {
        let Some(value) = root.at_mut(path) else { return false };
        let instead = match (&value.kind, path.last()) {
            (Kind::Invented(_), Some(Step::Index(_))) => Some(Kind::Absent),
            (Kind::Absent | Kind::Invented(_), _) => None,
            // An array had better keep its length; a key may have a default.
            (_, Some(Step::Index(_)) | None) => Some(Kind::Invented(Vec::new())),
            (_, Some(Step::Key(_))) => Some(Kind::Absent),
        };
        if let Some(kind) = instead {
            value.kind = kind;
            return true;
        }
        let Some((_, above)) = path.split_last() else { return false };
        path = above;
    }
}

fn forget(table: &mut Value, key: &str) -> bool {
    let (Kind::Table(entries) | Kind::Invented(entries)) = &mut table.kind else { return false };
    let count = entries.len();
    entries.retain(|entry| entry.key != key);
    entries.len() < count
}

fn invent(table: &mut Value, key: &str) -> bool {
    let (Kind::Table(entries) | Kind::Invented(entries)) = &mut table.kind else { return false };
    match entries.iter_mut().find(|entry| entry.key == key) {
        None => {
            let value = Value::INVENTED;
            entries.push(Entry { key: key.to_owned(), key_origin: None, value });
            true
        }
        Some(entry) if matches!(entry.value.kind, Kind::Absent) => {
            entry.value.kind = Kind::Invented(Vec::new());
            true
        }
        Some(_) => false,
    }
}

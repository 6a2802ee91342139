//! What to say about a file that is not there.

use std::fs;
use std::io;
use std::path::Path;

use super::error::{Error, Place};
use super::likely::{likely, quoted};
use super::source::Origin;

/// The error of a file that `named_at`, or else the command line, names.
pub(super) fn unreadable(path: &Path, error: &io::Error, named_at: Option<&Origin>) -> Error {
    let (message, help) = match error.kind() {
        io::ErrorKind::NotFound => {
            let home = named_at.and_then(Origin::home);
            (format!("no such file: `{}`", path.display()), nearest_file(path, home))
        }
        io::ErrorKind::IsADirectory => {
            (format!("`{}` is a directory", path.display()), files_in(path))
        }
        _ => (
            format!("cannot read `{}`: {error}", path.display()),
            "see to it that the file can be read".to_owned(),
        ),
    };
    match named_at {
        Some(origin) => Error::at(origin, message, help),
        None => Error::new(Place::File(path.to_owned()), "", message, help),
    }
}

/// A name near the first part of `path` that does not exist, or one where such files have their `home`.
fn nearest_file(path: &Path, home: Option<&Path>) -> String {
    let mut missing = path;
    while let Some(parent) = missing.parent() {
        let directory = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
        if directory.is_dir() {
            let Some(name) = missing.file_name() else { break };
            let names = names_in(directory);
            return match (likely(&name.to_string_lossy(), &names).first(), home) {
                (Some(name), _) => format!("did you mean `{}`?", parent.join(name).display()),
                (None, Some(home)) => nearest_at_home(path, home),
                (None, None) => files_in(directory),
            };
        }
        missing = parent;
    }
    String::from("give the path of a file")
}

/// A name in `home` near that of the file at `path`, or all that there are.
fn nearest_at_home(path: &Path, home: &Path) -> String {
    let name = path.with_extension("toml");
    let name = name.file_name().unwrap_or_default().to_string_lossy();
    match likely(&name, &names_in(home)).first() {
        Some(name) => format!("did you mean `{}`?", home.join(name).display()),
        None => files_in(home),
    }
}

fn files_in(directory: &Path) -> String {
    let mut names = names_in(directory);
    names.retain(|name| Path::new(name).extension().is_some_and(|extension| extension == "toml"));
    if names.is_empty() {
        return format!("there are no TOML files in `{}`", directory.display());
    }
    format!("files in `{}`: {}", directory.display(), quoted(&names))
}

fn names_in(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let mut names: Vec<_> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

//! Whether logind removes a user's shared memory at the last logout (logind.conf(5)).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where configuration lies, the strongest first.
const PLACES: [&str; 4] = ["/etc", "/run", "/usr/local/lib", "/usr/lib"];

/// `RemoveIPC=`, as configured under `root`.
pub(super) fn removes_shared_memory(root: &Path) -> bool {
    let place = |place: &str| root.join(place.trim_start_matches('/')).join("systemd");
    let main = PLACES.iter().map(|name| place(name).join("logind.conf")).find(|path| path.exists());
    // A file hides its namesakes in weaker places; together they are read in the order of names.
    let mut parts = BTreeMap::<_, PathBuf>::new();
    for name in PLACES.iter().rev() {
        let entries = std::fs::read_dir(place(name).join("logind.conf.d"));
        for entry in entries.into_iter().flatten().flatten() {
            parts.insert(entry.file_name(), entry.path());
        }
    }
    let is_part = |path: &PathBuf| path.extension().is_some_and(|end| end == "conf");
    let paths = main.into_iter().chain(parts.into_values().filter(is_part));
    let texts: Vec<_> = paths.filter_map(|path| std::fs::read_to_string(path).ok()).collect();
    remove_ipc(&texts)
}

/// The last word on `RemoveIPC=`; yes where nothing is said.
fn remove_ipc(texts: &[String]) -> bool {
    let mut removes = true;
    for text in texts {
        let mut section = "";
        for line in text.lines().map(str::trim) {
            if line.starts_with('[') {
                section = line;
            } else if section == "[Login]"
                && let Some((key, value)) = line.split_once('=')
                && key.trim_end() == "RemoveIPC"
            {
                removes = boolean(value.trim()).unwrap_or(removes);
            }
        }
    }
    removes
}

/// As systemd reads it; what it cannot read, it ignores.
fn boolean(word: &str) -> Option<bool> {
    match word.to_ascii_lowercase().as_str() {
        "1" | "yes" | "y" | "true" | "t" | "on" => Some(true),
        "0" | "no" | "n" | "false" | "f" | "off" => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_word_in_the_right_section_counts() {
        let table: [(&[&str], bool); 9] = [
            (&[], true),
            (&["[Login]\n#RemoveIPC=no\n"], true),
            (&["[Login]\nRemoveIPC=no\n"], false),
            (&["[Login]\nRemoveIPC = off\n"], false),
            (&["RemoveIPC=no\n"], true),
            (&["[Sleep]\nRemoveIPC=no\n"], true),
            (&["[Login]\nRemoveIPC=no\n", "[Login]\nRemoveIPC=yes\n"], true),
            (&["[Login]\nRemoveIPC=yes\n", "[Login]\nRemoveIPC=no\n"], false),
            (&["[Login]\nRemoveIPC=no\nRemoveIPC=perhaps\n"], false),
        ];
        for (texts, expected) in table {
            let owned: Vec<_> = texts.iter().map(|&text| text.to_owned()).collect();
            assert_eq!(remove_ipc(&owned), expected, "{texts:?}");
        }
    }
}

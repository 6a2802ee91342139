//! How a robot ended that nobody watched: kept beside its directory until somebody was told, or it
//! runs again.

use std::fmt::Write;
use std::fs::{self, File};
use std::os::fd::AsFd;
use std::os::unix::fs::FileExt;
use std::path::Path;

use node::{Namespace, clock};
use rustix::fs::FallocateFlags;

/// [-] The report of a run, and what its nodes have written before it.
const LINES: usize = 60;

/// [byte] Of what a run has printed: more than what it takes to come up, which `up` shows.
const KEPT: u64 = 1024 * 1024;

/// [byte] In which they are looked for.
const TAIL: u64 = 64 * 1024;

/// Keeps the last of what this guardian's run has printed, and its exit code.
pub(crate) fn keep(namespace: &Namespace, code: u8) {
    let Ok(output) = std::io::stdout().as_fd().try_clone_to_owned() else { return };
    let (robot, now) = (namespace.robot(), humantime::format_rfc3339_seconds(clock::wall()));
    let said = last_of(&File::from(output));
    // Why it ended is the last line of its report, of which the rest may be long.
    let why = said.iter().rev().find_map(|line| line.strip_prefix("end  ")).map(str::trim);
    let why = why.map_or_else(|| format!("with exit code {code}"), str::to_owned);
    let mut text = format!("{robot} ended at {now}: {why}; it said last:\n");
    for line in said {
        let _ = writeln!(text, "  {line}");
    }
    let path = namespace.last_words();
    if let Err(cause) = fs::write(&path, text) {
        tracing::warn!(path = %path.display(), %cause, "nobody will know how the robot ended");
    }
}

/// What robots under `runtime` have said last, or the one of this name.
pub(crate) fn read(runtime: &Path, robot: Option<&str>) -> String {
    let all = || {
        let paths = fs::read_dir(runtime).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut paths: Vec<_> = paths.filter(|path| Namespace::is_last_words(path)).collect();
        paths.sort();
        paths
    };
    let one = |robot| Namespace::under(runtime, robot).map(|namespace| namespace.last_words());
    let paths = robot.map_or_else(all, |robot| one(robot).into_iter().collect());
    paths.iter().filter_map(|path| fs::read_to_string(path).ok()).collect()
}

/// Somebody was told.
pub(crate) fn forget(namespace: &Namespace) {
    let path = namespace.last_words();
    if fs::remove_file(&path).is_ok()
        && let Some(runtime) = path.parent()
    {
        // Unless another robot lives there.
        Namespace::unmake(runtime);
    }
}

/// The last lines that were written into a file.
pub(crate) fn last_of(output: &File) -> Vec<String> {
    last(&tail(output))
}

/// Gives back the memory of what this guardian's run printed long ago: nobody will ask for it.
pub(crate) fn trim() {
    let output = std::io::stdout();
    let Ok(file) = rustix::fs::fstat(&output) else { return };
    let size = u64::try_from(file.st_size).unwrap_or_default();
    cut(&output, size);
}

fn cut(output: impl AsFd, size: u64) {
    // In whole pages; the file keeps its length, and who writes the place in it.
    let flags = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
    if let Some(old) = size.checked_sub(KEPT).filter(|old| 0 < *old) {
        let _ = rustix::fs::fallocate(output, flags, 0, old);
    }
}

/// Not with `read`: whoever writes shares the place where that begins.
fn tail(output: &File) -> Vec<u8> {
    let size = output.metadata().map_or(0, |file| file.len());
    let mut bytes = vec![0; usize::try_from(size.min(TAIL)).unwrap_or_default()];
    match output.read_exact_at(&mut bytes, size.saturating_sub(TAIL)) {
        Ok(()) => bytes,
        Err(_) => Vec::new(),
    }
}

fn last(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let lines: Vec<_> = text.lines().collect();
    lines[lines.len().saturating_sub(LINES)..].iter().map(|&line| line.to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn a_robot_that_prints_for_ever_grows_no_more() {
        let memory = rustix::fs::memfd_create("test", rustix::fs::MemfdFlags::CLOEXEC);
        let mut output = File::from(memory.unwrap());
        output.write_all(&b"one of many lines\n".repeat(300_000)).unwrap();
        output.write_all(b"the last\n").unwrap();
        let size = output.metadata().unwrap().len();
        cut(&output, size);

        let held = 512 * output.metadata().unwrap().blocks();
        assert!(4 * KEPT < size && held <= KEPT + 4096, "{held} of {size}");
        assert_eq!(last_of(&output).last().unwrap(), "the last");
    }

    #[test]
    fn the_last_lines_are_kept_in_their_order() {
        let text = (0..1_000).map(|number| format!("line {number}")).collect::<Vec<_>>();
        let kept = last(text.join("\n").as_bytes());

        assert_eq!(kept.len(), LINES);
        assert_eq!((kept[0].as_str(), kept[LINES - 1].as_str()), ("line 940", "line 999"));
        assert_eq!(last(b"one\n\xff"), ["one", "\u{fffd}"]);
        assert_eq!(last(b""), [""; 0]);
    }
}

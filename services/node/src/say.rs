//! What verbs print: for people plain text, with colours only where they are wanted.

use std::io::{ErrorKind, IsTerminal, Write};
use std::time::Duration;

use crate::control::Failure;
use serde_json::Value;

/// [character] No line for people is longer, unless a word of it is.
pub const WIDTH: usize = 100;

/// Prints it on standard output, as one line or as many as it has.
pub fn say(text: &str) -> Result<(), Failure> {
    let mut output = std::io::stdout().lock();
    let outcome = output.write_all(text.as_bytes());
    let outcome =
        outcome.and_then(|()| if text.ends_with('\n') { Ok(()) } else { writeln!(output) });
    match outcome.and_then(|()| output.flush()) {
        Ok(()) => Ok(()),
        Err(cause) if cause.kind() == ErrorKind::BrokenPipe => Err(Failure::Unwanted),
        Err(cause) => Err(Failure::Refused(format!("cannot print: {cause}"))),
    }
}

/// Says on standard error what went wrong.
pub fn complain(failure: &Failure) {
    let text = match failure {
        Failure::Unwanted => return,
        Failure::Refused(text)
        | Failure::Unclear(text)
        | Failure::NotRunning(text)
        | Failure::TooLong(text) => text,
    };
    mention(&format!("teseo: {text}"));
}

/// Says on standard error what is no answer, but worth knowing.
pub fn mention(text: &str) {
    for line in text.lines() {
        // Whoever closed our standard error does not want to know.
        let _ = writeln!(std::io::stderr(), "{}", wrapped(&shown(line)));
    }
}

/// A line as one or more, none longer than [`WIDTH`], broken between words; those after the first are
/// set in.
pub fn wrapped(line: &str) -> String {
    const INDENT: &str = "  ";
    let mut text = String::new();
    let mut width = 0;
    for word in line.split_inclusive(' ') {
        let length = word.trim_end().chars().count();
        if INDENT.len() < width && WIDTH < width + length {
            text.truncate(text.trim_end().len());
            text.push('\n');
            text.push_str(INDENT);
            width = INDENT.len();
        }
        text.push_str(word);
        width += word.chars().count();
    }
    text.truncate(text.trim_end().len());
    text
}

/// Whether whoever reads wants colours: a terminal that has them, by <https://no-color.org>.
pub fn wants_colours() -> bool {
    let given = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let is_dumb = given("TERM").is_some_and(|terminal| terminal == "dumb");
    std::io::stdout().is_terminal() && given("NO_COLOR").is_none() && !is_dumb
}

/// What a terminal can be shown, whatever a node has said.
pub fn shown(text: &str) -> String {
    let shown = |c: char| if c.is_control() && c != '\t' { '\u{fffd}' } else { c };
    text.chars().map(shown).collect()
}

/// A length of time in the two units that matter: `42s`, `1m12s`, `2h05m`, `3d04h`.
pub fn span(seconds: f64) -> String {
    let seconds = Duration::try_from_secs_f64(seconds).unwrap_or_default().as_secs();
    let (minutes, hours) = (seconds / 60, seconds / 3600);
    match seconds {
        0..60 => format!("{seconds}s"),
        60..3600 => format!("{minutes}m{:02}s", seconds % 60),
        3600..86_400 => format!("{hours}h{:02}m", minutes % 60),
        _ => format!("{}d{:02}h", hours / 24, hours % 24),
    }
}

/// The time of day of something that has happened, in UTC: `12:01:07.412`.
pub fn time_of_day(happening: &Value) -> &str {
    let wall = happening["wall"].as_str().unwrap_or_default();
    wall.split_once('T').map_or(wall, |(_, time)| time.trim_end_matches('Z'))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_length_of_time_has_two_units_at_the_most() {
        for (seconds, text) in [
            (0.4, "0s"),
            (59.9, "59s"),
            (72.0, "1m12s"),
            (7_500.0, "2h05m"),
            (273_600.0, "3d04h"),
            (-1.0, "0s"),
            (f64::NAN, "0s"),
        ] {
            assert_eq!(span(seconds), text);
        }
    }

    #[test]
    fn a_time_of_day_is_shown_and_whatever_else_came_too() {
        let at = |wall: &str| time_of_day(&json!({ "wall": wall })).to_owned();

        assert_eq!(at("2026-11-25T12:01:07.412Z"), "12:01:07.412");
        assert_eq!(at("yesterday"), "yesterday");
        assert_eq!(time_of_day(&json!({})), "");
    }

    #[test]
    fn a_long_line_is_broken_between_words_and_no_word_is_lost() {
        assert_eq!(wrapped("short"), "short");
        let words = ["word"; 60].join(" ");
        let text = wrapped(&words);
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines.len(), 4, "{text}");
        assert!(
            lines.iter().all(|line| line.len() <= WIDTH && 90 < line.len() || line == &lines[3])
        );
        assert!(lines[1..].iter().all(|line| line.starts_with("  word")), "{text}");
        assert_eq!(text.split_whitespace().count(), 60);
        // There is nowhere to break a path.
        let path = format!("cannot read /{}", "x".repeat(200));
        assert_eq!(wrapped(&path).lines().count(), 2);
    }

    #[test]
    fn what_a_node_has_said_cannot_steer_the_terminal() {
        assert_eq!(shown("a\x1b[2Jb\u{9b}c\td"), "a\u{fffd}[2Jb\u{fffd}c\td");
    }
}

//! One thing that was looked at, how it is, and what mends it; as text and as JSON.

use serde::Serialize;

/// How bad it is, from the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Level {
    /// As it should be.
    Ok,
    /// Worth knowing; this robot does without.
    Note,
    /// The robot runs, but worse, or not always.
    Warning,
    /// The robot does not run, or not for long.
    Failure,
}

/// What was found about one topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    pub(super) level: Level,
    /// The topic, the same in every run.
    pub(super) what: &'static str,
    /// In one line, with figures.
    pub(super) found: String,
    /// Commands, in order; none where nothing is to be mended.
    pub(super) mend: Vec<String>,
}

/// [character] As wide as a terminal is wherever people care.
const WIDTH: usize = 100;

/// [character] Where the topic begins, below the level.
const INDENT: usize = 9;

/// [character] Where what was found begins.
const FOUND_INDENT: usize = INDENT + 20;

impl Finding {
    pub(super) fn new(level: Level, what: &'static str, found: impl Into<String>) -> Self {
        Self { level, what, found: found.into(), mend: Vec::new() }
    }

    pub(super) fn ok(what: &'static str, found: impl Into<String>) -> Self {
        Self::new(Level::Ok, what, found)
    }

    pub(super) fn note(what: &'static str, found: impl Into<String>) -> Self {
        Self::new(Level::Note, what, found)
    }

    pub(super) fn warning(what: &'static str, found: impl Into<String>) -> Self {
        Self::new(Level::Warning, what, found)
    }

    /// One more command that mends it.
    pub(super) fn mend(mut self, command: impl Into<String>) -> Self {
        self.mend.push(command.into());
        self
    }
}

impl Level {
    const fn label(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Failure => "failure",
        }
    }

    /// The terminal's escape sequence for its colour.
    const fn color(self) -> &'static str {
        match self {
            Self::Ok => "\x1b[32m",
            Self::Note => "\x1b[36m",
            Self::Warning => "\x1b[33m",
            Self::Failure => "\x1b[31m",
        }
    }
}

/// For people: aligned, and each command whole in a line of its own, to be copied.
pub(super) fn text(findings: &[Finding], is_colored: bool) -> String {
    let mut text = String::new();
    for finding in findings {
        let label = format!("{:<INDENT$}", finding.level.label());
        if is_colored {
            text.extend([finding.level.color(), &label, "\x1b[0m"]);
        } else {
            text.push_str(&label);
        }
        let width = FOUND_INDENT - INDENT;
        let what = format!("{:<width$}", finding.what);
        let lines = wrap(&finding.found, WIDTH - FOUND_INDENT);
        let found = lines.join(&format!("\n{:FOUND_INDENT$}", ""));
        text.extend([&what, &found, "\n"]);
        for (index, command) in finding.mend.iter().enumerate() {
            let lead = if index == 0 { "mend with: " } else { "" };
            let lead = format!("{:INDENT$}{lead:<11}", "");
            text.extend([&lead, command, "\n"]);
        }
    }
    text
}

/// For programs.
pub(super) fn json(findings: &[Finding]) -> String {
    let array = serde_json::to_string_pretty(findings);
    array.unwrap_or_else(|cause| unreachable!("findings are text: {cause}")) + "\n"
}

/// Lines of at most `width` characters, unless one word is longer.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let Some(line) = lines.last_mut() else { unreachable!("there is a line from the start") };
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            line.extend([" ", word]);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

/// As people write it.
pub(super) fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_aligned_and_a_command_stands_below() {
        let findings = [
            Finding::ok("open files", "1024 each"),
            Finding::warning("governor", "powersave").mend("cpupower x").mend("true"),
        ];

        let expected = "ok       open files          1024 each\n\
                        warning  governor            powersave\n         \
                        mend with: cpupower x\n                    true\n";
        assert_eq!(text(&findings, false), expected);
        assert!(text(&findings, true).contains("\x1b[33mwarning  \x1b[0m"));
    }

    #[test]
    fn a_long_finding_is_broken_between_words() {
        let findings = [Finding::note("governor", "powersave ".repeat(20).trim_end())];

        let text = text(&findings, false);
        assert!(1 < text.lines().count(), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
        assert_eq!(text.matches("powersave").count(), 20);
    }

    #[test]
    fn levels_are_ordered_by_how_bad_they_are() {
        assert!(Level::Ok < Level::Note && Level::Note < Level::Warning);
        assert!(Level::Warning < Level::Failure);
    }
}

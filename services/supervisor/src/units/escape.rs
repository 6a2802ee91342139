//! How words are written into a unit file so that systemd reads them as they are
//! (systemd.syntax(7), "Quoting"; systemd.unit(5), "Specifiers").

use std::fmt::Write;
use std::path::Path;

use node::{Error, Result};

/// `text` as one word. Where `$` means something it is left alone: our command lines begin with a
/// `:`, which switches that off.
pub(super) fn word(text: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./=:,@+".contains(&byte);
    if !text.is_empty() && text.bytes().all(is_plain) {
        return text.to_owned();
    }
    let mut quoted = String::from('"');
    for character in text.chars() {
        match character {
            '%' => quoted.push_str("%%"),
            '"' | '\\' => quoted.extend(['\\', character]),
            control if control.is_control() => {
                for byte in control.encode_utf8(&mut [0; 4]).bytes() {
                    let _ = write!(quoted, "\\x{byte:02x}");
                }
            }
            plain => quoted.push(plain),
        }
    }
    quoted.push('"');
    quoted
}

/// A command line: `program` with `arguments`.
pub(super) fn command(program: &Path, arguments: &[String]) -> Result<String> {
    let words = arguments.iter().map(|argument| format!(" {}", word(argument)));
    Ok(std::iter::once(format!(":{}", word(plain(program)?))).chain(words).collect())
}

/// A path as text, unless systemd refuses it however it is written.
pub(super) fn plain(path: &Path) -> Result<&str> {
    let is_strange = |character: char| character.is_control() || "\"'\\".contains(character);
    path.to_str().filter(|path| !path.contains(is_strange)).ok_or_else(|| {
        let why = "systemd bears no quotes, backslashes or control characters in it";
        Error::Fault(format!("{} cannot be in a unit: {why}", path.display()))
    })
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;
    use crate::units::unit::Unit;

    /// What could end a word, a line or a quotation, or mean something within.
    const NASTY: [&str; 20] = [
        "\n",
        "\r",
        "\t",
        " ",
        "\"",
        "'",
        "\\",
        "%",
        "%n",
        "$",
        "${HOME}",
        ";",
        "#",
        "[Service]",
        "\nExecStartPre=/bin/false",
        "\\x0a",
        "\u{85}",
        "ä",
        "=",
        "a",
    ];

    #[test]
    fn whatever_a_word_contains_systemd_reads_it_back_and_no_line_is_added() {
        let seed = 42;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..20_000 {
            let count = random.next_u32() % 8;
            let pick = |_| NASTY[random.next_u32() as usize % NASTY.len()];
            let text: String = (0..count).map(pick).collect();
            let mut unit = Unit::new("#");
            unit.set("Environment", word(&format!("NAME={text}")));

            let lines: Vec<_> = unit.into_text().lines().map(str::to_owned).collect();
            assert_eq!(lines.len(), 2, "SEED={seed}: {text:?} became {lines:?}");
            let value = lines[1].strip_prefix("Environment=").unwrap();
            assert_eq!(read(value), [format!("NAME={text}")], "SEED={seed}: {value}");
        }
    }

    #[test]
    fn words_stay_apart_even_where_one_is_empty_or_a_separator() {
        let arguments = ["", ";", "a b", "$HOME", "100%", "-x"].map(str::to_owned);
        let line = command(Path::new("/opt/my robot/teseo"), &arguments).unwrap();

        assert_eq!(line, r#":"/opt/my robot/teseo" "" ";" "a b" "$HOME" "100%%" -x"#);
    }

    #[test]
    fn a_path_that_systemd_cannot_read_is_refused() {
        for path in ["/a\nb", "/a\"b", "/a\\b", "/a'b"] {
            assert!(plain(Path::new(path)).is_err(), "{path:?} was accepted");
        }
    }

    /// As systemd does it: `extract_first_word` with `EXTRACT_UNQUOTE | EXTRACT_CUNESCAPE`, then
    /// specifiers.
    fn read(line: &str) -> Vec<String> {
        let mut words = Vec::new();
        let mut word: Option<Vec<u8>> = None;
        let mut is_quoted = false;
        let mut bytes = line.bytes();
        while let Some(byte) = bytes.next() {
            match byte {
                b'"' => {
                    is_quoted = !is_quoted;
                    word.get_or_insert_default();
                }
                b' ' | b'\t' if !is_quoted => words.extend(word.take()),
                b'\\' => {
                    let escaped = match bytes.next().unwrap() {
                        b'x' => {
                            let digits = [bytes.next().unwrap(), bytes.next().unwrap()];
                            let digits = std::str::from_utf8(&digits).unwrap();
                            u8::from_str_radix(digits, 16).unwrap()
                        }
                        itself => itself,
                    };
                    word.get_or_insert_default().push(escaped);
                }
                plain => word.get_or_insert_default().push(plain),
            }
        }
        assert!(!is_quoted, "a quotation that does not end: {line}");
        words.extend(word);
        let text = |word| String::from_utf8(word).unwrap();
        words.into_iter().map(|word| resolve(&text(word))).collect()
    }

    /// `%%` is `%`; any other specifier is one that should have been escaped.
    fn resolve(word: &str) -> String {
        let mut characters = word.chars();
        let mut resolved = String::new();
        while let Some(character) = characters.next() {
            if character == '%' {
                assert_eq!(characters.next(), Some('%'), "a specifier in {word:?}");
            }
            resolved.push(character);
        }
        resolved
    }
}

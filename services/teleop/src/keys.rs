//! Which key was pressed, from the bytes that a terminal sends for it.

use node::hand::Key;

/// Reads keys of several bytes, which may come in pieces.
#[derive(Debug, Clone, Copy, Default)]
pub struct Keys(Within);

/// What has begun.
#[derive(Debug, Clone, Copy, Default)]
enum Within {
    #[default]
    Nothing,
    /// An escape character has come.
    Escape,
    /// A control sequence has: parameters, then a letter (ECMA-48, 5.4).
    Sequence,
}

const ESCAPE: u8 = 0x1b;
const CTRL_C: u8 = 0x03;
const CTRL_D: u8 = 0x04;
const CTRL_BACKSLASH: u8 = 0x1c;

impl Keys {
    /// The key that `byte` completes.
    pub fn read(&mut self, byte: u8) -> Option<Key> {
        let within = std::mem::take(&mut self.0);
        match (within, byte) {
            // It begins anew, and ends what a terminal has broken off.
            (_, ESCAPE) => self.0 = Within::Escape,
            (Within::Escape, b'[' | b'O') | (Within::Sequence, b'0'..=b'?') => {
                self.0 = Within::Sequence;
            }
            (Within::Sequence, b'A') => return Some(Key::Faster),
            (Within::Sequence, b'B') => return Some(Key::Slower),
            (Within::Sequence, b'C') => return Some(Key::Right),
            (Within::Sequence, b'D') => return Some(Key::Left),
            (Within::Sequence, b'@'..=b'~') => return Some(Key::Other),
            // No sequence has such bytes: it is a key of its own.
            (Within::Nothing | Within::Escape | Within::Sequence, _) => return Some(plain(byte)),
        }
        None
    }
}

/// Also in capitals: nobody looks at the lock before stopping.
const fn plain(byte: u8) -> Key {
    match byte.to_ascii_lowercase() {
        b'w' => Key::Faster,
        b'x' => Key::Slower,
        b'a' => Key::Left,
        b'd' => Key::Right,
        b's' | b' ' => Key::Stop,
        b'q' | CTRL_C | CTRL_D | CTRL_BACKSLASH => Key::Quit,
        _ => Key::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Vec<Key> {
        let mut keys = Keys::default();
        bytes.iter().filter_map(|byte| keys.read(*byte)).collect()
    }

    #[test]
    fn letters_are_turtlebot3_s_in_either_case() {
        use Key::{Faster, Left, Other, Quit, Right, Slower, Stop};
        assert_eq!(read(b"wxads q"), [Faster, Slower, Left, Right, Stop, Stop, Quit]);
        assert_eq!(read(b"WXADSQ"), [Faster, Slower, Left, Right, Stop, Quit]);
        assert_eq!(read(b"e\r7\xc3"), [Other; 4]);
    }

    #[test]
    fn arrows_drive_in_both_of_a_terminal_s_modes_and_with_modifiers() {
        use Key::{Faster, Left, Right, Slower};
        assert_eq!(read(b"\x1b[A\x1b[B\x1b[C\x1b[D"), [Faster, Slower, Right, Left]);
        assert_eq!(read(b"\x1bOA\x1bOB\x1bOC\x1bOD"), [Faster, Slower, Right, Left]);
        assert_eq!(read(b"\x1b[1;5A"), [Faster], "with Ctrl");
    }

    #[test]
    fn an_arrow_in_pieces_is_one_key() {
        let mut keys = Keys::default();
        assert_eq!(
            [b'\x1b', b'[', b'A'].map(|byte| keys.read(byte)),
            [None, None, Some(Key::Faster)]
        );
    }

    #[test]
    fn no_other_sequence_moves_the_robot() {
        assert_eq!(read(b"\x1b[3~\x1b[15~\x1b[H"), [Key::Other; 3]);
    }

    #[test]
    fn what_ends_a_program_elsewhere_ends_this_one() {
        for byte in [b"\x03", b"\x04", b"\x1c"] {
            assert_eq!(read(byte), [Key::Quit]);
            assert_eq!(read(&[b"\x1b[", &byte[..]].concat()), [Key::Quit], "within a sequence");
        }
        assert_eq!(read(b"\x1bq"), [Key::Quit], "after Escape");
        assert_eq!(read(b"\x1b[ "), [Key::Stop], "within a sequence");
        assert_eq!(read(b"\x1b\x1bs"), [Key::Stop], "after Escape twice");
    }
}

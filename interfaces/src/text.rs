//! Text of bounded length that fits in shared memory.

use std::fmt;

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// [-] UTF-8 of at most 128 bytes, followed by zeros.
///
/// Another process wrote it, so reading stops at the first byte that is not UTF-8.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[type_name("Text/1")]
#[repr(C)]
pub struct Text {
    bytes: [u8; CAPACITY],
}

/// [byte] Enough for one line on a terminal and a little more.
const CAPACITY: usize = 128;

impl Text {
    /// [byte] The longest text.
    pub const CAPACITY: usize = CAPACITY;

    /// As much of `text` as fits, cut at a character's end.
    pub fn new(text: &str) -> Self {
        let mut length = text.len().min(Self::CAPACITY);
        while !text.is_char_boundary(length) {
            length -= 1;
        }
        let mut bytes = [0; Self::CAPACITY];
        bytes[..length].copy_from_slice(&text.as_bytes()[..length]);
        Self { bytes }
    }

    /// What it says.
    pub fn as_str(&self) -> &str {
        let length = self.bytes.iter().position(|&byte| byte == 0).unwrap_or(Self::CAPACITY);
        let written = &self.bytes[..length];
        match std::str::from_utf8(written) {
            Ok(text) => text,
            Err(error) => std::str::from_utf8(&written[..error.valid_up_to()]).unwrap_or_default(),
        }
    }

    /// Whether it says nothing.
    pub fn is_empty(&self) -> bool {
        self.as_str().is_empty()
    }
}

impl Default for Text {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_str().fmt(formatter)
    }
}

impl fmt::Display for Text {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_text_is_cut_between_characters() {
        let ends_in_the_middle = format!("{}é", "a".repeat(Text::CAPACITY - 1));

        assert_eq!(Text::new(&ends_in_the_middle).as_str(), "a".repeat(Text::CAPACITY - 1));
        assert_eq!(Text::new("short").as_str(), "short");
        assert!(Text::new("").is_empty());
    }

    #[test]
    fn bytes_that_are_not_utf8_end_the_text() {
        let mut text = Text::new("ab");
        text.bytes[1] = 0xff;

        assert_eq!(text.as_str(), "a");
    }
}

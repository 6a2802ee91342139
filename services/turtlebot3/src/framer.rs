//! Bytes as they come from a serial port, until whole packets can be cut out of them.

/// [byte] More than any packet of ours. Where nobody takes anything out, the oldest bytes go.
const CAPACITY: usize = 4096;

/// Bytes that have come and belong to no packet yet.
#[derive(Debug, Clone)]
pub(crate) struct Framer {
    bytes: Vec<u8>,
}

/// Bytes that belong to no packet.
#[derive(Debug)]
pub(crate) struct Garbage;

impl Default for Framer {
    fn default() -> Self {
        Self { bytes: Vec::with_capacity(CAPACITY) }
    }
}

impl Framer {
    /// Takes in what has come.
    pub(crate) fn push(&mut self, bytes: &[u8]) {
        let bytes = &bytes[bytes.len().saturating_sub(CAPACITY)..];
        let excess = (self.bytes.len() + bytes.len()).saturating_sub(CAPACITY);
        self.skip(excess);
        self.bytes.extend_from_slice(bytes);
    }

    /// What is there.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Drops the first `count` bytes.
    pub(crate) fn skip(&mut self, count: usize) {
        self.bytes.drain(..count.min(self.bytes.len()));
    }

    /// Drops what can be no beginning of a packet: everything before the first place at which
    /// `may_begin` holds of the bytes from there on. Returns how much that was.
    pub(crate) fn skip_until(&mut self, may_begin: impl Fn(&[u8]) -> bool) -> usize {
        let count = self.bytes.len();
        let begin = (0..count).find(|&begin| may_begin(&self.bytes[begin..])).unwrap_or(count);
        self.skip(begin);
        begin
    }

    /// Cuts the next packet of `N` bytes out, as `parse` reads it; an error where what was there is
    /// garbage, of which something is dropped; nothing where more has to come.
    pub(crate) fn next<P, const N: usize>(
        &mut self,
        may_begin: impl Fn(&[u8]) -> bool,
        parse: impl Fn(&[u8; N]) -> Option<P>,
    ) -> Option<Result<P, Garbage>> {
        if 0 < self.skip_until(may_begin) {
            return Some(Err(Garbage));
        }
        let packet = parse(self.bytes.first_chunk()?);
        self.skip(if packet.is_some() { N } else { 1 });
        Some(packet.ok_or(Garbage))
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
    }
}

/// Whether `bytes` begin like `pattern`, as far as they go.
pub(crate) fn begins(bytes: &[u8], pattern: &[u8]) -> bool {
    bytes.iter().zip(pattern).all(|(byte, expected)| byte == expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_bytes_make_room() {
        let mut framer = Framer::default();
        framer.push(&[1; CAPACITY]);
        framer.push(&[2, 3]);
        assert_eq!(framer.bytes().len(), CAPACITY);
        assert_eq!(framer.bytes()[CAPACITY - 3..], [1, 2, 3]);
        framer.push(&[4; 2 * CAPACITY]);
        assert_eq!(framer.bytes(), [4; CAPACITY]);
    }

    #[test]
    fn half_a_beginning_at_the_end_is_kept() {
        let mut framer = Framer::default();
        framer.push(&[9, 9, 0xff]);
        assert_eq!(framer.skip_until(|bytes| begins(bytes, &[0xff, 0xfd])), 2);
        assert_eq!(framer.bytes(), [0xff]);
    }
}

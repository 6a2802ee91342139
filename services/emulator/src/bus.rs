//! The device's end of Dynamixel protocol 2.0, as the firmware's library has it.

/// [-] Whom packets are for.
const ID: u8 = 200;

/// [-] Everybody.
const BROADCAST: u8 = 0xfe;

/// [byte] The library's receive buffer: what is longer is no packet.
const LENGTH_MAX: usize = 512;

/// What a packet asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Asked {
    /// Are you there?
    Ping,
    /// So many bytes from there on.
    Read { address: usize, length: usize },
    /// These bytes from there on.
    Write { address: usize, data: Vec<u8> },
}

/// What has come and is no whole packet yet.
#[derive(Debug, Default)]
pub(crate) struct Receiver(Vec<u8>);

impl Receiver {
    pub(crate) fn push(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    /// The next thing that is asked of us. Everything else is ignored without a word: other
    /// devices' packets, other instructions, what is broken.
    pub(crate) fn next(&mut self) -> Option<Asked> {
        loop {
            let begin =
                self.0.windows(4).position(|four| four[..3] == *b"\xff\xff\xfd" && four[3] != 0xfd);
            let Some(begin) = begin else {
                // The last three may be a header's.
                let rest = self.0.len().saturating_sub(3);
                self.0.drain(..rest);
                return None;
            };
            self.0.drain(..begin);
            let length = usize::from(*self.0.get(5)?) + 256 * usize::from(*self.0.get(6)?);
            if !(3..=LENGTH_MAX).contains(&length) {
                self.0.drain(..4);
                continue;
            }
            if self.0.len() < 7 + length {
                return None;
            }
            let packet: Vec<u8> = self.0.drain(..7 + length).collect();
            let (body, check) = packet.split_at(5 + length);
            if [check[0], check[1]] != remainder(body).to_le_bytes() {
                continue;
            }
            if let Some(asked) = understand(body[4], &without_stuffing(&body[7..])) {
                return Some(asked);
            }
        }
    }
}

fn understand(id: u8, contents: &[u8]) -> Option<Asked> {
    let word = |at: usize| {
        Some(usize::from(*contents.get(at)?) | usize::from(*contents.get(at + 1)?) << 8)
    };
    match (id, contents[0]) {
        (ID | BROADCAST, 1) => Some(Asked::Ping),
        (ID, 2) => Some(Asked::Read { address: word(1)?, length: word(3)? }),
        (ID, 3) => Some(Asked::Write { address: word(1)?, data: contents.get(3..)?.to_vec() }),
        _ => None,
    }
}

/// An answer: an error, or 0, and data.
pub(crate) fn answer(error: u8, data: &[u8]) -> Vec<u8> {
    let mut contents = vec![0x55, error];
    contents.extend_from_slice(data);
    let contents = with_stuffing(&contents);
    let length = contents.len() + 2;
    let mut packet = vec![0xff, 0xff, 0xfd, 0x00, ID];
    packet.extend([length.to_le_bytes()[0], length.to_le_bytes()[1]]);
    packet.extend(contents);
    packet.extend(remainder(&packet).to_le_bytes());
    packet
}

/// Behind each FF FF FD another FD.
fn with_stuffing(contents: &[u8]) -> Vec<u8> {
    let mut stuffed = Vec::new();
    let mut run = [0_u8; 3];
    for &byte in contents {
        stuffed.push(byte);
        run = [run[1], run[2], byte];
        if run == [0xff, 0xff, 0xfd] {
            stuffed.push(0xfd);
            run = [0; 3];
        }
    }
    stuffed
}

fn without_stuffing(stuffed: &[u8]) -> Vec<u8> {
    let mut contents = Vec::new();
    let mut bytes = stuffed.iter();
    let mut run = [0_u8; 3];
    while let Some(&byte) = bytes.next() {
        contents.push(byte);
        run = [run[1], run[2], byte];
        if run == [0xff, 0xff, 0xfd] {
            bytes.next();
            run = [0; 3];
        }
    }
    contents
}

/// Of the long division by x^16 + x^15 + x^2 + 1, a bit at a time.
fn remainder(bytes: &[u8]) -> u16 {
    let mut rest = 0_u32;
    for &byte in bytes.iter().chain(&[0, 0]) {
        for bit in (0..8).rev() {
            rest = rest << 1 | u32::from(byte >> bit & 1);
            if 0x1_0000 <= rest {
                rest ^= 0x1_8005;
            }
        }
    }
    u16::try_from(rest).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_for_us_or_broken_is_passed_over_without_a_word() {
        let ping = [0xff, 0xff, 0xfd, 0, 200, 3, 0, 1, 0x3b, 0xfa];
        // A servo's ping, of the protocol's manual.
        let other = [0xff, 0xff, 0xfd, 0, 1, 3, 0, 1, 0x19, 0x4e];
        let mut broken = ping;
        broken[8] ^= 1;
        for noise in [&[][..], &other, &broken, &[0xff, 0xff, 0xfd, 0, 200, 0xff, 0xff], &[0xff; 9]]
        {
            let mut receiver = Receiver::default();
            receiver.push(noise);
            assert_eq!(receiver.next(), None, "{noise:02x?}");
            receiver.push(&ping);
            assert_eq!(receiver.next(), Some(Asked::Ping), "{noise:02x?}");
        }
    }

    #[test]
    fn what_is_stuffed_comes_out_as_it_was() {
        let nasty = [0xff, 0xff, 0xfd, 0xfd, 0xff, 0xff, 0xff, 0xfd, 0, 0xff, 0xff, 0xfd];
        let stuffed = with_stuffing(&nasty);
        assert_eq!(stuffed.len(), nasty.len() + 3);
        assert_eq!(without_stuffing(&stuffed), nasty);
    }
}

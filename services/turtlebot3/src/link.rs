//! The client of one device on a bus: one transaction at a time, each with an end.

use std::time::Duration;

use interfaces::Stamp;

use crate::packet::{Decoder, encode, instruction};
use crate::table::{BLOCK, ID};

/// How long an answer may take: DynamixelSDK's 34 ms for two turns of a USB adapter's latency timer,
/// and a busy machine's pause.
pub const TIMEOUT: Duration = Duration::from_millis(50);

/// What was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// [byte] Where in the device's table.
    pub address: u16,
    /// [byte] How much was asked for; zero for a write.
    pub length: u16,
    /// When it was written to the port.
    pub sent: Stamp,
}

/// Why a transaction failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// Nothing came in time, or nothing for us.
    TimedOut,
    /// What came in time was no whole packet.
    Broken,
    /// The device refuses, with this error: 1 failed, 2 instruction, 3 checksum, 4 range, 5 length,
    /// 6 limit, 7 access; bit 7 is an alert of its hardware.
    Refused(u8),
    /// The answer is not as long as what was asked for.
    WrongLength,
}

/// How a transaction ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ended<'a> {
    /// What was asked.
    pub request: Request,
    /// The data that was asked for, none for a write.
    pub outcome: Result<&'a [u8], Failure>,
}

/// The client's end of the line.
#[derive(Debug, Clone)]
pub struct Link {
    decoder: Decoder,
    pending: Option<(Request, Stamp)>,
    data: Vec<u8>,
    /// Whether the pending transaction has heard anything, and no whole packet yet.
    hears_fragments: bool,
    garbage: u64,
}

impl Default for Link {
    fn default() -> Self {
        Self {
            decoder: Decoder::default(),
            pending: None,
            data: Vec::with_capacity(BLOCK),
            hears_fragments: false,
            garbage: 0,
        }
    }
}

impl Link {
    /// Whether a transaction may begin.
    pub fn is_free(&self) -> bool {
        self.pending.is_none()
    }

    /// When the pending transaction ends at the latest.
    pub fn due(&self) -> Option<Stamp> {
        self.pending.map(|(_, due)| due)
    }

    /// [-] Stretches of bytes so far that were no packet.
    pub fn garbage(&self) -> u64 {
        self.garbage
    }

    /// Asks for `length` bytes at `address`; what is to be written goes to `out`.
    pub fn read(&mut self, now: Stamp, address: u16, length: u16, out: &mut Vec<u8>) {
        let parameters = [address.to_le_bytes(), length.to_le_bytes()];
        encode(ID, instruction::READ, &[parameters.as_flattened()], out);
        self.begin(Request { address, length, sent: now }, TIMEOUT);
    }

    /// Writes `data` at `address`.
    pub fn write(&mut self, now: Stamp, address: u16, data: &[u8], out: &mut Vec<u8>) {
        self.write_within(now, TIMEOUT, address, data, out);
    }

    /// The same for what takes the device longer.
    pub fn write_within(
        &mut self,
        now: Stamp,
        timeout: Duration,
        address: u16,
        data: &[u8],
        out: &mut Vec<u8>,
    ) {
        encode(ID, instruction::WRITE, &[&address.to_le_bytes(), data], out);
        self.begin(Request { address, length: 0, sent: now }, timeout);
    }

    fn begin(&mut self, request: Request, timeout: Duration) {
        assert!(self.is_free(), "one transaction at a time");
        // An answer that comes too late must not be taken for this one's.
        self.decoder.clear();
        self.hears_fragments = false;
        self.pending = Some((request, request.sent.after(timeout)));
    }

    /// Takes in what has come.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.hears_fragments |= !bytes.is_empty();
        self.decoder.push(bytes);
    }

    /// How the pending transaction ended, if it has by `now`.
    pub fn end(&mut self, now: Stamp) -> Option<Ended<'_>> {
        let (request, due) = self.pending?;
        while let Some(decoded) = self.decoder.decode() {
            let Ok(packet) = decoded else {
                self.garbage += 1;
                continue;
            };
            self.hears_fragments = false;
            // Whatever else is on the line: an echo of ours, another device.
            if packet.id != ID || packet.instruction != instruction::STATUS {
                continue;
            }
            let Some((&error, data)) = packet.parameters.split_first() else { continue };
            let is_whole = data.len() == usize::from(request.length);
            let outcome = match error & 0x7f {
                0 if is_whole => Ok(()),
                0 => Err(Failure::WrongLength),
                _ => Err(Failure::Refused(error)),
            };
            self.data.clear();
            self.data.extend_from_slice(data);
            self.pending = None;
            return Some(Ended { request, outcome: outcome.map(|()| &self.data[..]) });
        }
        (due <= now).then(|| {
            self.pending = None;
            let failure = if self.hears_fragments { Failure::Broken } else { Failure::TimedOut };
            Ended { request, outcome: Err(failure) }
        })
    }

    /// Forgets everything: the port was opened anew.
    pub fn reset(&mut self) {
        self.decoder.clear();
        self.pending = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(milliseconds: u64) -> Stamp {
        Stamp::ZERO.after(Duration::from_millis(milliseconds))
    }

    fn status(id: u8, parameters: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(id, instruction::STATUS, &[parameters], &mut bytes);
        bytes
    }

    /// A link that has asked for two bytes at 0 ms.
    fn asking() -> Link {
        let mut link = Link::default();
        link.read(at(0), 0, 2, &mut Vec::new());
        link
    }

    #[test]
    fn the_answer_is_found_in_whatever_else_is_on_the_line() {
        let mut link = asking();
        let mut echo = Vec::new();
        encode(ID, instruction::READ, &[&[0, 0, 2, 0]], &mut echo);
        for bytes in [&echo[..], &[1, 2, 3], &status(1, &[0, 9, 9]), &status(ID, &[0, 0, 0x50])] {
            assert_eq!(link.end(at(1)), None);
            link.hear(bytes);
        }
        let ended = link.end(at(2)).unwrap();
        assert_eq!(ended.outcome, Ok(&[0, 0x50][..]));
        assert_eq!(ended.request, Request { address: 0, length: 2, sent: at(0) });
        assert!(link.is_free());
    }

    #[test]
    fn every_transaction_ends() {
        let refused = status(ID, &[7, 0, 0]);
        let alert = status(ID, &[0x80, 1, 2]);
        let table = [
            (refused, Err(Failure::Refused(7))),
            // The alert says that something else is wrong; the data are there.
            (alert, Ok(&[1, 2][..])),
            (status(ID, &[0, 1]), Err(Failure::WrongLength)),
            (status(ID, &[0, 1, 2])[..7].to_vec(), Err(Failure::Broken)),
            (status(1, &[0, 1, 2]), Err(Failure::TimedOut)),
            (Vec::new(), Err(Failure::TimedOut)),
        ];
        for (bytes, expected) in table {
            let mut link = asking();
            link.hear(&bytes);
            let late = link.due().unwrap();
            assert_eq!(link.end(late).map(|ended| ended.outcome), Some(expected));
            assert!(link.is_free());
            assert_eq!(link.end(late), None);
        }
    }

    // Broken on purpose: without clearing, the late answer was taken for the next one's.
    #[test]
    fn an_answer_that_comes_too_late_is_none_to_the_next_question() {
        let mut link = asking();
        assert_eq!(link.end(at(50)).unwrap().outcome, Err(Failure::TimedOut));
        link.hear(&status(ID, &[0, 1, 1]));
        link.read(at(60), 2, 2, &mut Vec::new());
        assert_eq!(link.end(at(61)), None);
        link.hear(&status(ID, &[0, 2, 2]));
        assert_eq!(link.end(at(62)).unwrap().outcome, Ok(&[2, 2][..]));
    }

    #[test]
    fn noise_ends_no_transaction_but_by_its_time() {
        let mut link = asking();
        for round in 0..1_000_u32 {
            link.hear(&round.wrapping_mul(2_654_435_761).to_le_bytes());
            assert_eq!(link.end(at(49)), None);
        }
        assert_eq!(link.end(at(50)).unwrap().outcome, Err(Failure::Broken));
        assert!(0 < link.garbage());
    }
}

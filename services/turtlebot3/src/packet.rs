//! Dynamixel protocol 2.0, in which the robot's OpenCR board is spoken to: packets and their bytes.
//!
//! Source: ROBOTIS e-manual, "DYNAMIXEL Protocol 2.0"; the vectors in `tests/data`.

use crate::framer::{Framer, begins};

/// [byte] The largest packet that we take: the board's answer of 172 bytes, every third of them
/// stuffed. A false header in noise holds up no more than this.
pub const PACKET_MAX: usize = 256;

/// The first four bytes of a packet; a stuffed packet has them nowhere else.
const HEADER: [u8; 4] = [0xff, 0xff, 0xfd, 0x00];

/// [byte] Header, id and length field.
const PREFIX: usize = 7;

/// [byte] What the length field counts beside parameters: the instruction and the checksum.
const LENGTH_MIN: usize = 3;

/// What is asked of a device, or that it answers.
pub mod instruction {
    /// Are you there?
    pub const PING: u8 = 0x01;
    /// Parameters: address, length.
    pub const READ: u8 = 0x02;
    /// Parameters: address, data.
    pub const WRITE: u8 = 0x03;
    /// An answer. Parameters: error, data.
    pub const STATUS: u8 = 0x55;
}

/// Why bytes from the robot are not a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PacketError {
    /// Bytes without a header; skipped.
    NoHeader,
    /// The length field exceeds the largest packet.
    TooLong,
    /// The length field leaves no room for an instruction.
    TooShort,
    /// The checksum does not match the contents.
    BadChecksum,
}

/// A packet, unstuffed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet<'a> {
    /// [-] Whom it is for, or whom it is from.
    pub id: u8,
    /// [-] One of [`instruction`], or another.
    pub instruction: u8,
    /// [-] Its parameters.
    pub parameters: &'a [u8],
}

/// Appends a packet's bytes to `out`.
pub fn encode(id: u8, instruction: u8, parameters: &[&[u8]], out: &mut Vec<u8>) {
    let begin = out.len();
    out.extend_from_slice(&HEADER);
    out.extend_from_slice(&[id, 0, 0]);
    let contents = out.len();
    out.push(instruction);
    for &byte in parameters.iter().copied().flatten() {
        out.push(byte);
        if out[contents..].ends_with(&HEADER[..3]) {
            out.push(0xfd);
        }
    }
    // Stuffed bytes and the checksum count.
    let length = out.len() - contents + 2;
    let length = u16::try_from(length).expect("packets are far shorter than 64 KiB");
    out[contents - 2..contents].copy_from_slice(&length.to_le_bytes());
    let crc = crc(&out[begin..]);
    out.extend_from_slice(&crc.to_le_bytes());
}

/// Finds packets in a stream of bytes, whatever else is in it.
#[derive(Debug, Clone)]
pub struct Decoder {
    framer: Framer,
    /// The parameters of the packet that was found last.
    parameters: Vec<u8>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { framer: Framer::default(), parameters: Vec::with_capacity(PACKET_MAX) }
    }
}

impl Decoder {
    /// Takes in what has come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.framer.push(bytes);
    }

    /// The next packet, or why there is none where one seemed to be; `None` until more has come.
    ///
    /// What turns out to be none costs its first byte only, so a packet behind a false header in
    /// noise is found.
    pub fn decode(&mut self) -> Option<Result<Packet<'_>, PacketError>> {
        if 0 < self.framer.skip_until(|bytes| begins(bytes, &HEADER)) {
            return Some(Err(PacketError::NoHeader));
        }
        let bytes = self.framer.bytes();
        let &[_, _, _, _, id, low, high, ..] = bytes else { return None };
        let length = usize::from(u16::from_le_bytes([low, high]));
        if length < LENGTH_MIN {
            return Some(self.refuse(PacketError::TooShort));
        }
        if PACKET_MAX < PREFIX + length {
            return Some(self.refuse(PacketError::TooLong));
        }
        let packet = bytes.get(..PREFIX + length)?;
        let (contents, checksum) = packet.split_at(PREFIX + length - 2);
        if crc(contents).to_le_bytes() != checksum {
            return Some(self.refuse(PacketError::BadChecksum));
        }
        let instruction = contents[PREFIX];
        unstuff(&contents[PREFIX..], &mut self.parameters);
        self.framer.skip(PREFIX + length);
        Some(Ok(Packet { id, instruction, parameters: &self.parameters[1..] }))
    }

    /// Forgets what has come.
    pub fn clear(&mut self) {
        self.framer.clear();
    }

    fn refuse(&mut self, error: PacketError) -> Result<Packet<'_>, PacketError> {
        self.framer.skip(1);
        Err(error)
    }
}

/// Drops the byte behind each header's beginning, which was put there so that it is no header.
fn unstuff(stuffed: &[u8], out: &mut Vec<u8>) {
    out.clear();
    let mut is_stuffing = false;
    let mut matched = 0;
    for &byte in stuffed {
        if is_stuffing && byte == 0xfd {
            is_stuffing = false;
            matched = 0;
            continue;
        }
        out.push(byte);
        matched = match (matched, byte) {
            (2, 0xfd) => 3,
            (1 | 2, 0xff) => 2,
            (_, 0xff) => 1,
            _ => 0,
        };
        is_stuffing = matched == 3;
    }
}

/// CRC-16 of polynomial 0x8005, initially 0, neither reflected nor inverted.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, &byte| {
        (0..8).fold(crc ^ (u16::from(byte) << 8), |crc: u16, _| {
            (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x8005 }
        })
    })
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;

    type Found = Vec<Result<(u8, u8, Vec<u8>), PacketError>>;

    fn decode_all(decoder: &mut Decoder) -> Found {
        let mut found = Vec::new();
        while let Some(next) = decoder.decode() {
            found.push(
                next.map(|packet| (packet.id, packet.instruction, packet.parameters.to_vec())),
            );
        }
        found
    }

    fn packets(found: Found) -> Vec<Vec<u8>> {
        found.into_iter().flatten().map(|(_, _, parameters)| parameters).collect()
    }

    fn encoded(parameters: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        encode(200, instruction::WRITE, &[parameters], &mut out);
        out
    }

    #[test]
    fn the_check_value_of_the_checksum_is_the_published_one() {
        assert_eq!(crc(b"123456789"), 0xfee8);
    }

    /// Parameters that hold many headers, or beginnings of one.
    fn parameters(random: &mut ChaCha8Rng) -> Vec<u8> {
        let length = random.next_u32() as usize % 150;
        let byte = |_| [0xff, 0xff, 0xfd, 0x00, 0x55][random.next_u32() as usize % 5];
        (0..length).map(byte).collect()
    }

    // Broken on purpose: where the encoder did not stuff, or the decoder took no stuffing out.
    #[test]
    fn whatever_is_encoded_is_decoded_and_looks_like_a_header_only_at_its_beginning() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for round in 0..20_000 {
            let parameters = parameters(&mut random);
            let bytes = encoded(&parameters);
            let headers = bytes.windows(4).filter(|window| *window == HEADER).count();
            assert_eq!(headers, 1, "round {round}: {parameters:02x?}");
            let mut decoder = Decoder::default();
            decoder.push(&bytes);
            let expected = vec![Ok((200, instruction::WRITE, parameters))];
            assert_eq!(decode_all(&mut decoder), expected, "round {round}");
        }
    }

    #[test]
    fn a_packet_in_pieces_of_any_size_is_whole() {
        let bytes = encoded(&[0xff, 0xff, 0xfd, 0x00, 1, 2, 3]);
        for piece in 1..bytes.len() {
            let mut decoder = Decoder::default();
            let mut found = Vec::new();
            for piece in bytes.chunks(piece) {
                decoder.push(piece);
                found.extend(decode_all(&mut decoder));
            }
            let expected = vec![0xff, 0xff, 0xfd, 0x00, 1, 2, 3];
            assert_eq!(packets(found), [expected], "pieces of {piece}");
        }
    }

    #[test]
    fn with_any_byte_flipped_it_is_no_packet_and_the_next_one_is() {
        let bytes = encoded(&[150, 0, 22, 0, 0, 0]);
        for index in 0..bytes.len() {
            for bit in 0..8 {
                let mut broken = bytes.clone();
                broken[index] ^= 1 << bit;
                let mut decoder = Decoder::default();
                decoder.push(&broken);
                let found = packets(decode_all(&mut decoder));
                assert!(found.is_empty(), "byte {index} bit {bit}: {found:02x?}");
                // A false length holds up what it claims to be long, and no more.
                for _ in 0..=PACKET_MAX / bytes.len() {
                    decoder.push(&bytes);
                }
                let found = packets(decode_all(&mut decoder));
                let expected = PACKET_MAX / bytes.len() + 1;
                assert!(expected <= found.len() + 1, "byte {index} bit {bit}: {}", found.len());
            }
        }
    }

    #[test]
    fn no_noise_makes_a_packet_or_hides_one_for_long() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        for round in 0..20_000 {
            let mut decoder = Decoder::default();
            let mut noise = vec![0; random.next_u32() as usize % 400];
            random.fill_bytes(&mut noise);
            if round % 2 == 0 {
                // Noise that is full of headers.
                noise = parameters(&mut random);
            }
            decoder.push(&noise);
            let found = packets(decode_all(&mut decoder));
            assert!(found.is_empty(), "round {round}: {found:02x?} in {noise:02x?}");
            let bytes = encoded(&[1, 2, 3]);
            let count = PACKET_MAX / bytes.len() + 2;
            for _ in 0..count {
                decoder.push(&bytes);
            }
            let found = packets(decode_all(&mut decoder));
            // What noise has joined itself to is lost.
            assert!(count - 1 <= found.len(), "round {round}: {} of {count}", found.len());
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let table: [(&[u8], PacketError); 4] = [
            (&[1, 2, 3], PacketError::NoHeader),
            (&[0xff, 0xff, 0xfd, 0, 200, 2, 0, 3], PacketError::TooShort),
            (&[0xff, 0xff, 0xfd, 0, 200, 0xff, 0xff, 3], PacketError::TooLong),
            (&[0xff, 0xff, 0xfd, 0, 200, 3, 0, 1, 0, 0], PacketError::BadChecksum),
        ];
        for (bytes, expected) in table {
            let mut decoder = Decoder::default();
            decoder.push(bytes);
            assert_eq!(decode_all(&mut decoder).first(), Some(&Err(expected)), "{bytes:02x?}");
        }
    }
}

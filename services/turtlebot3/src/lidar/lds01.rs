//! The LDS-01 (HLS-LFCD2): 60 packets a turn, six rays each.
//!
//! Source: HLDS, "HLS-LFCD2 Basic Specification"; the vectors in `tests/data`.

use std::time::Duration;

use interfaces::Stamp;

use super::{Heard, Model, Point, Turn};
use crate::framer::Framer;

/// [byte] One packet.
const PACKET: usize = 42;

/// [-] Rays in a packet.
const RAYS: usize = 6;

/// [-] Packets in a turn.
const PACKETS: u8 = 60;

/// [-] Beams in a turn.
pub const BEAMS: usize = 360;

/// [-] Packets without which a turn is not told: a third of them.
const LOST_MAX: usize = 20;

/// Turns are never slower: 60 rpm. What says so does not turn yet.
const PERIOD_MAX: Duration = Duration::from_secs(1);

/// One packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    /// [-] Which sixtieth of the turn, from 0.
    pub index: u8,
    /// [0.1 rpm] How fast it turns.
    pub speed: u16,
    /// Its rays.
    pub rays: [Ray; RAYS],
}

/// One ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ray {
    /// [-] How strong the return was.
    pub intensity: u16,
    /// [mm] How far it came from; 0 where nothing returned.
    pub distance_mm: u16,
}

impl Packet {
    /// From its bytes; `None` where they are none. One of the two copies of the checksum suffices.
    pub fn parse(bytes: &[u8; PACKET]) -> Option<Self> {
        let index = bytes[1].wrapping_sub(0xa0);
        let sum = bytes[..PACKET - 2].iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let is_whole = bytes[PACKET - 2..].contains(&(0xff - sum));
        if bytes[0] != 0xfa || PACKETS <= index || !is_whole {
            return None;
        }
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let mut rays = [Ray::default(); RAYS];
        for (ray, at) in rays.iter_mut().zip((4..).step_by(6)) {
            *ray = Ray { intensity: word(at), distance_mm: word(at + 2) };
        }
        Some(Self { index, speed: word(2), rays })
    }

    /// How long a turn takes at this packet's speed; `None` where it stands.
    fn period(&self) -> Option<Duration> {
        let seconds = 600.0 / f64::from(self.speed.max(1));
        Some(Duration::from_secs_f64(seconds)).filter(|period| *period <= PERIOD_MAX)
    }
}

/// Its stream.
#[derive(Debug, Clone, Default)]
pub struct Lds01 {
    framer: Framer,
    heard: Stamp,
    turn: Turn,
    whole: Turn,
    /// The last packet of the turn; `None` where none has begun yet.
    last: Option<u8>,
}

impl Lds01 {
    pub(super) fn hear(&mut self, now: Stamp, bytes: &[u8]) {
        self.heard = now;
        self.framer.push(bytes);
    }

    pub(super) fn decode(&mut self) -> Option<Heard<'_>> {
        let is_begin = |bytes: &[u8]| {
            bytes[0] == 0xfa
                && bytes.get(1).is_none_or(|index| (0xa0..0xa0 + PACKETS).contains(index))
        };
        let Ok(packet) = self.framer.next(is_begin, Packet::parse)? else {
            return Some(Heard::Garbage);
        };
        let came = self.heard.before(Model::Lds01.transfer(self.framer.bytes().len()));
        Some(if self.take(&packet, came) { Heard::Turn(&self.whole) } else { Heard::Packet })
    }

    /// Takes a packet; true where a turn is whole with it.
    fn take(&mut self, packet: &Packet, came: Stamp) -> bool {
        let Some(period) = packet.period() else {
            self.last = None;
            return false;
        };
        let follows = self.last.is_some_and(|last| last < packet.index);
        let mut is_whole = false;
        if !follows {
            is_whole = self.last.is_some() && self.finish();
            // The packet is sent once its last ray is measured.
            let share = f64::from(packet.index + 1) / f64::from(PACKETS);
            let begun = came.before(Model::Lds01.transfer(PACKET)).before(period.mul_f64(share));
            self.turn.begin(begun, period);
        }
        for (ray, degrees) in packet.rays.iter().zip(RAYS * usize::from(packet.index)..) {
            let range = if ray.distance_mm == 0 {
                f64::INFINITY
            } else {
                f64::from(ray.distance_mm) * 1e-3
            };
            let angle = ((BEAMS - degrees) % BEAMS) as f64;
            self.turn.push(Point { angle: angle.to_radians(), range, intensity: ray.intensity });
        }
        self.last = Some(packet.index);
        // The last packet of a turn ends it; where that was lost, the first of the next one does.
        if packet.index == PACKETS - 1 {
            self.last = None;
            return self.finish() || is_whole;
        }
        is_whole
    }

    /// The turn is over; false where too much of it is missing.
    fn finish(&mut self) -> bool {
        let lost = usize::from(PACKETS).saturating_sub(self.turn.points.len() / RAYS);
        if LOST_MAX < lost {
            return false;
        }
        std::mem::swap(&mut self.turn, &mut self.whole);
        true
    }
}

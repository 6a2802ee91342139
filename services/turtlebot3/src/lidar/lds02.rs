//! The LDS-02 (LD08): packets of twelve rays, anywhere in the turn.
//!
//! Source: ROBOTIS-GIT/ld08_driver; LDROBOT, "LD06 Development Manual"; the vectors in `tests/data`.

use std::time::Duration;

use interfaces::{BEAMS_MAX, Stamp};

use super::{Heard, Model, Point, Turn, near};
use crate::framer::Framer;

/// [byte] One packet.
const PACKET: usize = 47;

/// [-] Rays in a packet.
const RAYS: usize = 12;

/// [-] Steps between them.
const STEPS: u32 = 11;

/// [Hz] Rays in a second, at whatever speed it turns.
pub const RAY_RATE: f64 = 2300.0;

/// [0.01 degree] One turn.
const TURN: u32 = 36_000;

/// [degree] An angle that falls by more than this begins a new turn. ROBOTIS' driver says 350, and
/// takes two turns for one where the packet between them is lost.
const WRAP: f64 = 180.0;

/// [mm] Where the receiver sits on the sensor, ahead of its axis and to its side, and how far it
/// squints.
const RECEIVER_AHEAD: f64 = 5.9;
const RECEIVER_ASIDE: f64 = -20.14;
const RECEIVER_SQUINT: f64 = 0.119_23;

/// [degree/s] Slower it does not turn yet.
const SPEED_MIN: u16 = 360;

/// One packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    /// [degree/s] How fast it turns.
    pub speed: u16,
    /// [0.01 degree] Of the first ray, clockwise from straight ahead.
    pub start: u16,
    /// [0.01 degree] Of the last ray.
    pub end: u16,
    /// [ms] The sensor's clock; wraps at 30000.
    pub timestamp: u16,
    /// Its rays.
    pub rays: [Ray; RAYS],
}

/// One ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ray {
    /// [mm] From the receiver; 0 where nothing returned.
    pub distance_mm: u16,
    /// [-] How sure the sensor is.
    pub confidence: u8,
}

impl Packet {
    /// From its bytes; `None` where they are none.
    pub fn parse(bytes: &[u8; PACKET]) -> Option<Self> {
        let is_whole = crc(&bytes[..PACKET - 1]) == bytes[PACKET - 1];
        if bytes[0] != 0x54 || !matches!(bytes[1], 0x2c | 0xec) || !is_whole {
            return None;
        }
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let mut rays = [Ray::default(); RAYS];
        for (ray, at) in rays.iter_mut().zip((6..).step_by(3)) {
            *ray = Ray { distance_mm: word(at), confidence: bytes[at + 2] };
        }
        let packet =
            Self { speed: word(2), start: word(4), end: word(42), timestamp: word(44), rays };
        packet.is_possible().then_some(packet)
    }

    /// Whether its rays are no farther apart than its speed lets them be, half as much again.
    fn is_possible(&self) -> bool {
        let degrees = |hundredths: u16| i32::from(hundredths) / 100;
        let span = (degrees(self.end) - degrees(self.start)).rem_euclid(360);
        f64::from(span) <= f64::from(self.speed) * RAYS as f64 / RAY_RATE * 1.5
    }

    /// [degree] Of ray `ray`, clockwise from straight ahead, 0 to 360.
    pub fn angle(&self, ray: usize) -> f64 {
        let span = (u32::from(self.end) + TURN - u32::from(self.start) % TURN) % TURN;
        let step = f64::from(span / STEPS) / 100.0;
        (f64::from(self.start) / 100.0 + ray as f64 * step) % 360.0
    }

    /// How long a turn takes at this packet's speed; `None` where it stands.
    fn period(&self) -> Option<Duration> {
        let is_turning = SPEED_MIN <= self.speed;
        is_turning.then(|| Duration::from_secs_f64(360.0 / f64::from(self.speed)))
    }
}

/// A ray as seen from the sensor's axis: angle [rad], counterclockwise, 0 to 2 PI, and range [m].
pub fn from_axis(clockwise_degrees: f64, distance_mm: u16) -> (f64, f64) {
    let distance = f64::from(distance_mm);
    let x = distance + RECEIVER_AHEAD;
    let y = RECEIVER_SQUINT * distance + RECEIVER_ASIDE;
    let angle = (360.0 - clockwise_degrees).to_radians() + libm::atan2(y, x);
    (angle.rem_euclid(std::f64::consts::TAU), libm::hypot(x, y) * 1e-3)
}

/// CRC-8 of polynomial 0x4D, initially 0, neither reflected nor inverted.
fn crc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, &byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { 0x4d })
    })
}

/// Its stream.
#[derive(Debug, Clone)]
pub struct Lds02 {
    framer: Framer,
    heard: Stamp,
    near_filter: bool,
    turn: Turn,
    whole: Turn,
    has_begun: bool,
    /// [degree] Of the ray before.
    angle: f64,
}

impl Lds02 {
    pub(super) fn new(near_filter: bool) -> Self {
        Self {
            framer: Framer::default(),
            heard: Stamp::ZERO,
            near_filter,
            turn: Turn::default(),
            whole: Turn::default(),
            has_begun: false,
            angle: 0.0,
        }
    }

    /// Of the turns that are not over yet.
    pub(super) const fn set_near_filter(&mut self, near_filter: bool) {
        self.near_filter = near_filter;
    }

    pub(super) fn hear(&mut self, now: Stamp, bytes: &[u8]) {
        self.heard = now;
        self.framer.push(bytes);
    }

    pub(super) fn decode(&mut self) -> Option<Heard<'_>> {
        let is_begin = |bytes: &[u8]| {
            bytes[0] == 0x54 && bytes.get(1).is_none_or(|kind| matches!(kind, 0x2c | 0xec))
        };
        let Ok(packet) = self.framer.next(is_begin, Packet::parse)? else {
            return Some(Heard::Garbage);
        };
        let came = self.heard.before(Model::Lds02.transfer(self.framer.bytes().len()));
        Some(if self.take(&packet, came) { Heard::Turn(&self.whole) } else { Heard::Packet })
    }

    /// Takes a packet; true where a turn is whole with it.
    fn take(&mut self, packet: &Packet, came: Stamp) -> bool {
        let Some(period) = packet.period() else {
            self.has_begun = false;
            return false;
        };
        let sent = came.before(Model::Lds02.transfer(PACKET));
        let mut is_whole = false;
        for (index, ray) in packet.rays.iter().enumerate() {
            let angle = packet.angle(index);
            if WRAP < self.angle - angle {
                is_whole |=
                    std::mem::replace(&mut self.has_begun, true) && self.finish(packet.speed);
                let left = Duration::from_secs_f64((RAYS - index) as f64 / RAY_RATE);
                self.turn.begin(sent.before(left), period);
            }
            self.angle = angle;
            if self.has_begun {
                self.turn.push(point(angle, *ray));
            }
        }
        is_whole
    }

    /// The turn is over; false where too much of it is missing.
    fn finish(&mut self, speed: u16) -> bool {
        let expected = self.turn.period.as_secs_f64() * RAY_RATE;
        if (self.turn.points.len() as f64) < expected * 2.0 / 3.0 {
            return false;
        }
        if self.near_filter {
            near::filter(&mut self.turn.points, speed);
        }
        std::mem::swap(&mut self.turn, &mut self.whole);
        true
    }
}

fn point(clockwise_degrees: f64, ray: Ray) -> Point {
    let intensity = u16::from(ray.confidence);
    if ray.distance_mm == 0 {
        let angle = (360.0 - clockwise_degrees).to_radians().rem_euclid(std::f64::consts::TAU);
        return Point { angle, range: f64::INFINITY, intensity };
    }
    let (angle, range) = from_axis(clockwise_degrees, ray.distance_mm);
    Point { angle, range, intensity }
}

/// [-] Beams of a scan of this turn: one for each ray that its speed leaves room for.
pub fn beams(turn: &Turn) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
    let beams = (turn.period.as_secs_f64() * RAY_RATE).round() as usize;
    beams.min(BEAMS_MAX)
}

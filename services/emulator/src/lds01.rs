//! An LDS-01: six rays a packet, sixty packets a turn, clockwise.

use std::time::Duration;

use crate::World;

/// [bit/s] Its line.
pub(crate) const BAUD_RATE: u32 = 230_400;

/// [-] Packets in a turn.
const PACKETS: u8 = 60;

/// [0.1 rpm] 5 Hz.
const SPEED: u16 = 3_000;

/// Between two packets.
pub(crate) const PERIOD: Duration = Duration::from_nanos(200_000_000 / 60);

/// [m] What it sees.
const RANGES: std::ops::RangeInclusive<f64> = 0.05..=3.6;

/// A packet of its rays: intensity and distance [mm].
pub(crate) fn packet(index: u8, speed: u16, rays: &[(u16, u16); 6]) -> Vec<u8> {
    let mut bytes = vec![0xfa, 0xa0 + index];
    bytes.extend(speed.to_le_bytes());
    for (intensity, distance) in rays {
        bytes.extend(intensity.to_le_bytes());
        bytes.extend(distance.to_le_bytes());
        bytes.extend([0, 0]);
    }
    let sum = bytes.iter().map(|&byte| u32::from(byte)).sum::<u32>();
    let check = 0xff - sum.to_le_bytes()[0];
    bytes.extend([check, check]);
    bytes
}

/// The sensor.
#[derive(Debug, Default)]
pub(crate) struct Lds01 {
    index: u8,
}

impl Lds01 {
    /// The next packet, of what is around now.
    pub(crate) fn measure(&mut self, world: &mut dyn World) -> Vec<u8> {
        let mut rays = [(0, 0); 6];
        for (ray, clockwise) in rays.iter_mut().zip(6 * u16::from(self.index)..) {
            let range = world.range(-f64::from(clockwise).to_radians());
            if RANGES.contains(&range) {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "small"
                )]
                let distance = (range * 1e3).round() as u16;
                *ray = (3_000, distance);
            }
        }
        let packet = packet(self.index, SPEED, &rays);
        self.index = (self.index + 1) % PACKETS;
        packet
    }
}

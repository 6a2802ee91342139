//! The robot's LiDAR, whichever of the two it is: from the bytes that it sends to whole turns.

pub mod lds01;
pub mod lds02;
mod near;
mod turn;

use std::time::Duration;

use interfaces::Stamp;
use serde::Deserialize;

pub use turn::{Point, Turn};

use lds01::Lds01;
use lds02::Lds02;

/// Which LiDAR it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Model {
    /// HLS-LFCD2: 360 beams, 5 Hz.
    #[serde(rename = "lds-01")]
    Lds01,
    /// LD08: about 230 beams, 10 Hz.
    #[serde(rename = "lds-02")]
    Lds02,
}

impl Model {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Lds01, Self::Lds02];

    /// Its name.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Lds01 => "LDS-01",
            Self::Lds02 => "LDS-02",
        }
    }

    /// [bit/s] Of its serial line.
    pub const fn baud_rate(self) -> u32 {
        match self {
            Self::Lds01 => 230_400,
            Self::Lds02 => 115_200,
        }
    }

    /// What makes it turn: later LDS-01, and every LDS-02, turn by themselves.
    pub const fn start_command(self) -> &'static [u8] {
        match self {
            Self::Lds01 => b"b",
            Self::Lds02 => b"",
        }
    }

    /// [m] What it can measure, by its data sheet.
    pub const fn range(self) -> (f32, f32) {
        match self {
            Self::Lds01 => (0.12, 3.5),
            Self::Lds02 => (0.16, 8.0),
        }
    }

    /// [-] Beams of a scan of this turn.
    pub fn beams(self, turn: &Turn) -> usize {
        match self {
            Self::Lds01 => lds01::BEAMS,
            Self::Lds02 => lds02::beams(turn),
        }
    }

    /// How long `count` bytes take on its line: ten bits each.
    pub fn transfer(self, count: usize) -> Duration {
        Duration::from_secs_f64(count as f64 * 10.0 / f64::from(self.baud_rate()))
    }
}

/// One LiDAR's decoder.
#[derive(Debug, Clone)]
pub struct Lidar {
    model: Model,
    decoder: Decoder,
}

#[derive(Debug, Clone)]
enum Decoder {
    Lds01(Lds01),
    Lds02(Lds02),
}

/// What has come of what was heard.
#[derive(Debug)]
pub enum Heard<'a> {
    /// A packet of a turn that goes on.
    Packet,
    /// Bytes that are no packet.
    Garbage,
    /// A whole turn.
    Turn(&'a Turn),
}

impl Lidar {
    /// That has said nothing yet. With `near_filter`, ranges below a metre that are probably
    /// sunshine are dropped, as ROBOTIS' driver of the LDS-02 does; an LDS-01 has no such thing.
    pub fn new(model: Model, near_filter: bool) -> Self {
        let decoder = match model {
            Model::Lds01 => Decoder::Lds01(Lds01::default()),
            Model::Lds02 => Decoder::Lds02(Lds02::new(near_filter)),
        };
        Self { model, decoder }
    }

    /// From now on filters near ranges or does not; see [`Lidar::new`].
    pub const fn set_near_filter(&mut self, near_filter: bool) {
        match &mut self.decoder {
            Decoder::Lds01(_) => {}
            Decoder::Lds02(decoder) => decoder.set_near_filter(near_filter),
        }
    }

    /// Which it is.
    pub fn model(&self) -> Model {
        self.model
    }

    /// Takes in what has come from the port by `now`.
    pub fn hear(&mut self, now: Stamp, bytes: &[u8]) {
        match &mut self.decoder {
            Decoder::Lds01(decoder) => decoder.hear(now, bytes),
            Decoder::Lds02(decoder) => decoder.hear(now, bytes),
        }
    }

    /// What has come of it; `None` until more was heard.
    pub fn decode(&mut self) -> Option<Heard<'_>> {
        match &mut self.decoder {
            Decoder::Lds01(decoder) => decoder.decode(),
            Decoder::Lds02(decoder) => decoder.decode(),
        }
    }
}

#[cfg(test)]
mod tests;

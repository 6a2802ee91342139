//! The command line.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};

/// What is emulated, and where.
#[derive(Debug, Clone, Args)]
#[group(skip)]
pub struct Options {
    /// Where the two ports appear, as `board` and `lidar` [default: teseo-emulator in the temporary
    /// directory]
    #[arg(long, value_name = "DIRECTORY")]
    pub ports: Option<PathBuf>,

    /// Which LiDAR it has
    #[arg(long, value_enum, default_value_t = Lidar::Lds02)]
    pub lidar: Lidar,

    /// How long the gyro takes; on a robot up to five
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = seconds)]
    pub calibration: f64,

    /// End after this long
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    pub for_s: Option<f64>,
}

/// Which LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lidar {
    /// HLS-LFCD2, 360 beams, 5 Hz
    #[value(name = "lds-01")]
    Lds01,
    /// LD08, 230 beams, 10 Hz
    #[value(name = "lds-02")]
    Lds02,
}

impl Options {
    /// Where the ports appear.
    pub(crate) fn directory(&self) -> PathBuf {
        self.ports.clone().unwrap_or_else(|| std::env::temp_dir().join("teseo-emulator"))
    }

    pub(crate) fn calibration(&self) -> Duration {
        Duration::from_secs_f64(self.calibration)
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=1e6).contains(seconds));
    seconds.ok_or_else(|| "give seconds".to_owned())
}

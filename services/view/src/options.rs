//! The command line of `teseo view`.

use std::path::PathBuf;

use clap::Args;

/// How long the live screen stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stay {
    /// Until the person leaves it.
    UntilLeft,
    /// Until the robot is down.
    UntilTheEnd,
}

/// Which robot, and how it is shown.
///
/// Keys: q quit, p or space pause, tab or 1 to 6 another panel, n another node, r restart it,
/// a arm, e emergency stop, c clear it. Where the robot has a multiplexer, arrows drive, s stops, and
/// esc gives the robot back.
#[derive(Debug, Clone, Default, Args)]
pub struct Options {
    /// The robot [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,

    /// Draw with ASCII alone [default: where the locale is not UTF-8]
    #[arg(long)]
    pub ascii: bool,

    /// Print one picture and end
    #[arg(long)]
    pub once: bool,

    /// With --once: print everything that the screen knows, as JSON
    #[arg(long, requires = "once")]
    pub json: bool,

    /// With --once: write the picture to this file, as SVG
    #[arg(long, requires = "once", value_name = "FILE")]
    pub svg: Option<PathBuf>,

    /// With --once: how large the picture is
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "80x24", value_parser = size)]
    pub size: (u16, u16),

    /// With --once: how long it looks at the robot before
    #[arg(long = "after", value_name = "SECONDS", default_value_t = 1.5)]
    pub after_s: f64,
}

fn size(text: &str) -> Result<(u16, u16), String> {
    let sides = text.split_once('x').map(|(width, height)| (width.parse(), height.parse()));
    match sides {
        Some((Ok(width), Ok(height))) if 0 < width && 0 < height => Ok((width, height)),
        _ => Err("write it as 80x24".to_owned()),
    }
}

impl Options {
    /// The robot, where one is named.
    pub fn robot(&self) -> Option<&str> {
        self.robot.as_deref()
    }
}

//! The page of a run: one HTML file that needs nothing else, made of what the robot's processes have
//! written into the run's directory.

#![forbid(unsafe_code)]

mod chart;
mod page;
mod run;

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use node::{Error, Result};

use run::Run;

/// The page's name, in the directory of a run.
pub const PAGE: &str = "report.html";

/// [m] The two ends of a wall, in the frame `map`.
pub type Wall = [[f64; 2]; 2];

/// Which run.
#[derive(Debug, Clone, Args)]
pub struct Options {
    /// The directory of the run, as `teseo up --report DIR` has made it
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
}

/// Makes the page of the run in `directory`, beside `walls_of` the world file that it names; where that
/// is not there any more the robot is drawn without walls. Returns the page's path.
pub fn write(
    directory: &Path,
    walls_of: impl FnOnce(&Path) -> Result<Vec<Wall>>,
) -> Result<PathBuf> {
    let run = Run::read(directory)?;
    let walls = match run.world() {
        // The world is no part of the run: it may have been moved since.
        Some(world) => walls_of(world).unwrap_or_default(),
        None => Vec::new(),
    };
    let path = directory.join(PAGE);
    fs::write(&path, page::page(&run, &walls))
        .map_err(|cause| Error::File { path: path.clone(), cause })?;
    Ok(path)
}

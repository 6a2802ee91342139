//! `teseo report`: the page of a run, with the walls of the world that it was driven in.

use std::io::Write;
use std::path::Path;

use node::Result;
use report::Wall;

use crate::map;

/// Makes the page of the run in `directory`.
pub(crate) fn write(directory: &Path) -> Result {
    report::write(directory, walls).map(drop)
}

/// The verb: says where the page is.
pub(crate) fn make(options: &report::Options) -> Result {
    let page = report::write(&options.run, walls)?;
    // Whoever closed it does not want to know.
    let _ = writeln!(std::io::stdout(), "{}", page.display());
    Ok(())
}

fn walls(world: &Path) -> Result<Vec<Wall>> {
    map::read(world).map(|world| world.outline())
}

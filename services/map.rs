//! The simulator's world, for `teseo view` and `teseo report` to draw. None of them knows another.

use std::path::Path;

use node::Result;
use node::config::{FileName, Layers};
use simulator::World;
use view::{Map, Pose};

/// The walls of the world in this file, and the start of this name; `None` where it cannot be read.
pub(crate) fn map(world: &Path, start: &str) -> Option<Map> {
    let world = read(world).ok()?;
    let start = world.start(start).ok()?;
    let start = Pose { x: start.x_m, y: start.y_m, yaw: start.yaw_rad };
    Some(Map { walls: world.outline(), start })
}

/// The world in this file.
pub(crate) fn read(world: &Path) -> Result<World> {
    let file = FileName::from(world.to_string_lossy().as_ref());
    Ok(Layers::new().named(&file).parse()?)
}

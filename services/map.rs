//! The map that `teseo view` draws: the simulator's world. Neither knows the other.

use std::path::Path;

use node::config::{FileName, Layers};
use simulator::World;
use view::{Map, Pose};

/// The walls of the world in this file, and the start of this name; `None` where it cannot be read.
pub(crate) fn map(world: &Path, start: &str) -> Option<Map> {
    let file = FileName::from(world.to_str()?);
    let world: World = Layers::new().named(&file).parse().ok()?;
    let start = world.start(start).ok()?;
    let start = Pose { x: start.x_m, y: start.y_m, yaw: start.yaw_rad };
    Some(Map { walls: world.outline(), start })
}

//! The live screen: a running robot, drawn in a terminal.
//!
//! Two halves. The pure one has no clock and no I/O: [`State`] is everything the screen knows, [`draw`]
//! makes a frame of it. The shell reads the robot's shared memory, the supervisor's socket and the
//! keyboard, and tells the first half. It only looks: nobody is woken for it, nothing waits for it.

#![forbid(unsafe_code)]

mod draw;
mod keys;
mod map;
mod options;
mod processes;
mod raster;
mod robot;
mod run;
mod snapshot;
mod state;
mod svg;
mod terminal;

pub use draw::{Look, draw};
pub use keys::{Action, Desk};
pub use map::{FindMap, Map, Pose};
pub use options::{Options, Stay};
pub use run::run;
pub use state::State;
pub use terminal::check_terminal;

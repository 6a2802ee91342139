//! What every process of a robot shares: ports, clock, waiting, signals, logs, configuration,
//! lifecycle.
//!
//! A node is a function that opens ports and loops:
//!
//! ```no_run
//! use interfaces::topics::{ODOMETRY, VELOCITY_COMMAND};
//!
//! fn run(node: &mut node::Node<'_>) -> node::Result {
//!     let mut odometry = node.subscribe(&ODOMETRY)?;
//!     let mut command = node.publish(&VELOCITY_COMMAND)?;
//!     while node.tick()?.is_some() {
//!         while let Some(odometry) = odometry.receive()? {
//!             command.send_with(|command| command.header.stamp = odometry.header.stamp)?;
//!         }
//!     }
//!     Ok(())
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     node::main("brake", run)
//! }
//! ```

#![forbid(unsafe_code)]

mod arguments;
mod arrivals;
pub mod clock;
pub mod config;
pub mod control;
pub mod deadman;
mod diary;
mod digest;
mod error;
mod estop;
pub mod faults;
mod figures;
pub mod hand;
pub mod launch;
pub mod log;
mod managed;
mod memory;
mod namespace;
mod notify;
pub mod observe;
pub mod pairing;
mod port;
pub mod process;
mod refusals;
pub mod say;
mod session;
pub mod signal;
pub mod trace;
mod tuning;
mod wake;
mod wheels;
mod window;

pub use arguments::{
    Arguments, PARENT, SUPERVISOR, Settings, die_with_parent, exit_code, main, start,
};
pub use clock::Clock;
pub use diary::{Diary, RECORDS, save_diaries_of_the_dead};
pub use error::{Error, Result};
pub use estop::EmergencyStop;
pub use figures::{Gauge, Latency};
pub use managed::{Node, Tick, run_with};
pub use namespace::{Namespace, SharedMemory, Swept, Unfinished};
pub use notify::{Notifier, watchdog_period};
pub use port::{Publisher, Sample, Subscriber};
pub use refusals::Refusals;
pub use session::{Held, Session};
pub use tuning::{Choice, Tunable, Tuning};
pub use wake::{Wait, Waiter};
pub use wheels::{Heard, Wheels};
pub use window::{Lookup, Recent, Window};

//! A trip meter: reads odometry and says how far the robot has gone. A whole node, to be copied.

#![forbid(unsafe_code)]

use std::process::ExitCode;

use interfaces::topics::ODOMETRY;
use node::{Node, Result};

fn main() -> ExitCode {
    node::main("trip_meter", run)
}

fn run(node: &mut Node<'_>) -> Result {
    let mut odometry = node.subscribe(&ODOMETRY)?;
    let trip = node.gauge("trip_m");
    let mut previous = None;
    while node.tick()?.is_some() {
        while let Some(sample) = odometry.receive()? {
            let now = sample.header.stamp;
            let dt = previous.map_or(0.0, |before| now.since(before).as_secs_f64());
            trip.set(trip.get() + sample.linear.abs() * dt);
            previous = Some(now);
        }
    }
    Ok(())
}

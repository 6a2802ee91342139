//! What the parameters of our services may be: each service knows its own, and here all are known.

use node::Settings;

/// Checks the parameters of one of our services; `None` where there is no such service.
pub(crate) fn check(settings: &Settings) -> Option<node::Result> {
    match settings.name() {
        "simulator" => Some(simulator::check(settings)),
        "odometry" => Some(odometry::check(settings)),
        "controller" => Some(controller::check(settings)),
        "multiplexer" => Some(multiplexer::check(settings)),
        "turtlebot3" => Some(turtlebot3::check(settings)),
        _ => None,
    }
}

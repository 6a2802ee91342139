//! What the parameters of our services may be: each service knows its own, and here all are known.

use node::config::Listed;
use node::launch::PairingParameters;
use node::{Settings, Tunable};

/// What the supervisor is told of our services.
pub(crate) const CHECK: supervisor::Check = supervisor::Check {
    services: &["simulator", "odometry", "controller", "multiplexer", "turtlebot3"],
    parameters: check,
};

/// Checks the parameters of one of our services; `None` where there is no such service.
fn check(settings: &Settings) -> Option<node::Result> {
    match settings.name() {
        "simulator" => Some(simulator::check(settings)),
        "odometry" => Some(odometry::check(settings)),
        "controller" => Some(controller::check(settings)),
        "multiplexer" => Some(multiplexer::check(settings)),
        "turtlebot3" => Some(turtlebot3::check(settings)),
        _ => None,
    }
}

/// The parameters of one of our services, and which of them may be changed while it runs; `None` where
/// there is no such service.
pub(crate) fn parameters(
    settings: &Settings,
) -> Option<(node::Result<Vec<Listed>>, &'static [Tunable])> {
    match settings.name() {
        "simulator" => Some((settings.listed::<simulator::Config>(), &simulator::TUNABLES)),
        "odometry" => Some((settings.listed::<odometry::Config>(), &odometry::TUNABLES)),
        "pairing" => Some((settings.listed::<PairingParameters>(), &supervisor::PAIRING_TUNABLES)),
        "controller" => Some((settings.listed::<controller::Config>(), &controller::TUNABLES)),
        "multiplexer" => Some((settings.listed::<multiplexer::Config>(), &multiplexer::TUNABLES)),
        "turtlebot3" => Some((settings.listed::<turtlebot3::Config>(), &turtlebot3::TUNABLES)),
        _ => None,
    }
}

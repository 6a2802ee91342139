//! The launch file, as the machine has to know it.

use std::time::Duration;

use node::launch::{Launch, Process};

use crate::machine::{Backoff, NodePlan, StartLimit};
use crate::supervise::PAIRING;

/// All nodes in the order in which they start: the pairing first, so that whoever feeds it finds it.
pub(crate) fn plans(launch: &Launch) -> Vec<NodePlan> {
    let processes = launch.start_order();
    let number = |name: &String| processes.iter().position(|process| process.name == *name);
    let plan = |process: &&Process| NodePlan {
        requires: process.requires.iter().filter_map(number).map(|index| index + 1).collect(),
        ..of_process(process)
    };
    std::iter::once(of_pairing()).chain(processes.iter().map(plan)).collect()
}

fn of_process(process: &Process) -> NodePlan {
    NodePlan {
        name: process.name.clone(),
        requires: Vec::new(),
        restart: process.restart,
        strategy: process.strategy,
        backoff: Backoff {
            first: Duration::from_millis(process.restart_delay_ms),
            max: Duration::from_millis(process.restart_delay_max_ms),
            steps: process.restart_steps,
        },
        start_limit: StartLimit {
            burst: process.start_limit_burst,
            interval: Duration::from_secs(process.start_limit_interval_s),
        },
        start_timeout: Duration::from_millis(process.start_timeout_ms),
        stop_timeout: Duration::from_millis(process.stop_timeout_ms),
        watchdog: process.watchdog(),
        may_end: !process.is_managed(),
    }
}

/// The node in the supervisor's own process: where it fails the supervisor has.
fn of_pairing() -> NodePlan {
    NodePlan {
        name: PAIRING.to_owned(),
        requires: Vec::new(),
        restart: node::launch::Restart::Never,
        strategy: node::launch::Strategy::All,
        backoff: Backoff { first: Duration::ZERO, max: Duration::ZERO, steps: 1 },
        start_limit: StartLimit { burst: 1, interval: Duration::from_secs(1) },
        start_timeout: Duration::from_secs(10),
        stop_timeout: Duration::from_secs(2),
        watchdog: None,
        may_end: false,
    }
}

//! Looking at a robot that runs: what the console's verbs show of it, and that it does not notice.

use interfaces::topics;
use node::observe;

use crate::robot::alone;

/// Long enough, in simulated time, for whoever comes in the meantime.
const FOR: [&str; 2] = ["--for", "900"];

#[test]
fn one_who_looks_on_and_never_reads_holds_no_robot_up_and_changes_no_byte() {
    alone(|robot| {
        let unseen = robot.up(&FOR);
        let run = robot.start_up(&FOR).await_active();
        let session = observe::join(&robot.namespace(), "idle").unwrap();
        let mut observers: Vec<_> = topics::names()
            .into_iter()
            .filter_map(|name| observe::topic(&session, name).unwrap().map(|found| (name, found)))
            .collect();
        let seen = run.wait();

        seen.assert_code(0).assert_nothing_lost();
        assert_eq!(seen.digest(), unseen.digest(), "SEED=1\n{}", seen.story());
        assert_eq!(seen.report["topics"], unseen.report["topics"], "{}", seen.story());
        // More was sent than its queues hold, and it is the oldest that it finds there.
        for (name, depth) in [("scan", 10), ("odom", 32), ("cmd_vel", 10)] {
            let (_, observer) = observers.iter_mut().find(|(of, _)| *of == name).unwrap();
            let numbers: Vec<_> = std::iter::from_fn(|| observer.receive().unwrap())
                .map(|sample| sample.header().sequence)
                .collect();
            let whole: Vec<_> = (numbers[0]..).take(depth).collect();
            assert_eq!(numbers, whole, "{name}");
            assert!(numbers[depth - 1] + 1 < seen.topics()[name]["sent"].as_u64().unwrap());
        }
    });
}

//! All memory is taken at construction.

use std::time::Duration;

use super::super::{Bounds, Config, Pairing, Policy};
use super::streams::{Arrival, Random, Trouble, stream};

#[test]
fn nothing_is_allocated_after_construction() {
    let max_age = Duration::from_millis(500);
    let limited = Bounds::Limited { max_age, max_delay: Duration::from_millis(20) };
    for seed in 0..50 {
        for (topics, queue_size) in [(2, 1), (2, 10), (2, 100), (3, 10), (4, 20)] {
            for policy in [Policy::Nearest, Policy::ADAPTIVE] {
                for bounds in [Bounds::Unlimited, limited] {
                    let slop = Duration::from_millis(50);
                    let config = Config { policy, topics, queue_size, slop, bounds };
                    let arrivals = stream(&mut Random::new(seed), topics, Trouble::Any);
                    let mut pairing = Pairing::new(&config).unwrap();
                    let allocations = allocation_counter::measure(|| run(&mut pairing, &arrivals));
                    assert_eq!(allocations.count_total, 0, "SEED={seed}: {config:?}");
                }
            }
        }
    }
}

fn run(pairing: &mut Pairing, arrivals: &[Arrival]) {
    for &Arrival { topic, entry } in arrivals {
        pairing.poll(entry.received);
        for pair in pairing.push(topic, entry).pairs() {
            std::hint::black_box(pair.spread());
        }
        std::hint::black_box((pairing.next_deadline(), pairing.books(topic)));
    }
    pairing.reset();
}

//! What one sample costs the pairing.

use std::hint::black_box;
use std::time::Duration;

use interfaces::Stamp;
use node::clock;
use node::pairing::{Bounds, Config, Entry, Pairing, Policy};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::measured::Values;

/// [-] Enough that reading the clock costs nothing in proportion.
const SAMPLES: usize = 200_000;

/// A scan each 50 ms and an odometry each 20 ms, with up to 5 ms of jitter.
const PERIODS_NS: [u64; 2] = [50_000_000, 20_000_000];

/// What is measured: the policy and how long a queue is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Core {
    policy: Policy,
    queue_size: usize,
}

/// Everything that is measured.
pub(crate) fn configurations() -> Vec<Core> {
    let policies = [Policy::Nearest, Policy::ADAPTIVE];
    let cores = policies.map(|policy| [10, 100].map(|queue_size| Core { policy, queue_size }));
    cores.concat()
}

impl Core {
    pub(crate) fn name(&self) -> String {
        let policy = match self.policy {
            Policy::Nearest => "nearest",
            Policy::Adaptive { .. } => "adaptive",
        };
        format!("one sample into the pairing, {policy}, queue {}", self.queue_size)
    }

    pub(crate) fn measure(&self) -> Values {
        Values::One(cost(self.policy, self.queue_size, &stream()))
    }
}

/// [ns] A sample.
fn cost(policy: Policy, queue_size: usize, stream: &[(usize, Entry)]) -> f64 {
    let config = Config {
        policy,
        topics: 2,
        queue_size,
        slop: Duration::from_millis(50),
        bounds: Bounds::Limited {
            max_age: Duration::from_millis(500),
            max_delay: Duration::from_millis(100),
        },
    };
    let Ok(mut pairing) = Pairing::new(&config) else { return f64::NAN };
    let begun = clock::now();
    for &(topic, entry) in stream {
        black_box(pairing.push(topic, entry).pairs().count());
    }
    clock::now().since(begun).as_nanos() as f64 / stream.len() as f64
}

fn stream() -> Vec<(usize, Entry)> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut due = [0, 0];
    let mut sequence = [0, 0];
    let mut stream = Vec::with_capacity(SAMPLES);
    while stream.len() < SAMPLES {
        let topic = usize::from(due[1] < due[0]);
        let stamp = Stamp::from_nanoseconds(due[topic] + random.next_u64() % 5_000_000);
        let received = Stamp::from_nanoseconds(due[topic] + 5_000_000);
        stream.push((topic, Entry { stamp, sequence: sequence[topic], epoch: 1, received }));
        due[topic] += PERIODS_NS[topic];
        sequence[topic] += 1;
    }
    stream
}

//! Waiting: no wake-up is ever lost, however a process waits.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use interfaces::topics::{JOINT_STATES, ODOMETRY};
use interfaces::{Message, Topic};
use node::{Namespace, Session, Subscriber, Wait, clock};

use crate::random::{Random, number};
use crate::robot::{Robot, alone};

/// A wait that nothing ends lasts so long.
const TIMEOUT: Duration = Duration::from_secs(4);

/// One that has lasted so long and leaves a sample behind has missed it.
const LOST: Duration = Duration::from_secs(3);

/// [-] Samples of each of the two publishers; `WAKE_UPS` asks for others.
const SAMPLES: u64 = 250_000;

/// The stress test of each way to wait takes no longer than this; with a tenth of the samples sent it
/// has said what it can.
const TIME_MAX: Duration = Duration::from_secs(30);

// Broken on purpose: with a single `try_wait` in place of draining the channel to zero, a reader slept
// on beside its sample.
#[test]
fn no_wake_up_is_lost_by_one_who_sleeps() {
    alone(|robot| stress(robot, Wait::Block));
}

// Broken on purpose: without the look between draining the channel and sleeping, a reader slept on.
#[test]
fn no_wake_up_is_lost_by_one_who_looks_and_then_sleeps() {
    alone(|robot| stress(robot, Wait::Hybrid));
}

#[test]
fn no_sample_is_missed_by_one_who_looks() {
    alone(|robot| stress(robot, Wait::Yield));
}

fn stress(robot: &Robot, mode: Wait) {
    let samples = number("WAKE_UPS", SAMPLES);
    let is_over = AtomicBool::new(false);
    let seen = [AtomicU64::new(0), AtomicU64::new(0)];
    let namespace = robot.namespace();
    let reader = Session::join(&namespace, "reader", 1).unwrap();
    let mut odometry = reader.subscriber(&ODOMETRY).unwrap();
    let mut joints = reader.subscriber(&JOINT_STATES).unwrap();
    let sender = |seed| Sender { namespace: &namespace, seed, samples, is_over: &is_over };
    let (one, other) = (sender(1), sender(2));
    let (sent, waits, longest) = reader
        .with_waiter(mode, |waiter| {
            // From here on every sample wakes the reader; what came before would not.
            thread::scope(|scope| {
                // Each a notifier of its own, at random moments of the reader's turn.
                let first = scope.spawn(|| one.send(&ODOMETRY, &seen[0]));
                let second = scope.spawn(|| other.send(&JOINT_STATES, &seen[1]));
                let begun = clock::now();
                let (mut waits, mut longest) = (0_u64, Duration::ZERO);
                while !(first.is_finished() && second.is_finished()) {
                    let now = clock::now();
                    waiter.wait(now.after(TIMEOUT), || {
                        Ok(odometry.has_samples()? || joints.has_samples()?)
                    })?;
                    let waited = clock::now().since(now);
                    if drain(&mut odometry, &seen[0]) | drain(&mut joints, &seen[1]) {
                        longest = longest.max(waited);
                    }
                    waits += 1;
                    is_over.fetch_or(TIME_MAX < now.since(begun), Ordering::Relaxed);
                }
                Ok((first.join().unwrap() + second.join().unwrap(), waits, longest))
            })
        })
        .unwrap();
    println!("| {} | {sent} sent | {waits} waits | longest {longest:?} |", mode.label());
    assert!(longest < LOST, "{longest:?} beside a sample, in {waits} waits");
    assert!(samples / 10 < sent, "only {sent} samples in {TIME_MAX:?}");
}

/// One who sends bursts, each only when the one before was seen: nothing later wakes the reader then.
struct Sender<'a> {
    namespace: &'a Namespace,
    seed: u64,
    samples: u64,
    is_over: &'a AtomicBool,
}

impl Sender<'_> {
    /// Sends bursts of 1 to 4, with gaps of up to 6 microseconds. Returns how many samples they were.
    fn send<T: Message>(&self, topic: &Topic<T>, seen: &AtomicU64) -> u64 {
        let mut random = Random(self.seed);
        let session = Session::join(self.namespace, topic.name, 1).unwrap();
        let mut publisher = session.publisher(topic).unwrap();
        let mut sent = 0;
        while sent < self.samples && !self.is_over.load(Ordering::Relaxed) {
            for _ in 0..=random.below(4) {
                publisher.send_with(|_| {}).unwrap();
                sent += 1;
            }
            let gap = random.duration(Duration::from_micros(6));
            while seen.load(Ordering::Acquire) < sent && !self.is_over.load(Ordering::Relaxed) {
                thread::yield_now();
            }
            let begun = clock::now();
            while clock::now().since(begun) < gap {
                std::hint::spin_loop();
            }
        }
        sent
    }
}

/// Whether there was something.
fn drain<T: Message>(subscriber: &mut Subscriber<T>, seen: &AtomicU64) -> bool {
    let mut found = false;
    while let Some(sample) = subscriber.receive().unwrap() {
        seen.store(sample.header().sequence + 1, Ordering::Release);
        found = true;
    }
    found
}

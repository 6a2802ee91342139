//! Through `node`'s ports, as every process of a robot does it.

use std::time::Duration;

use hdrhistogram::Histogram;
use interfaces::{Stamp, Topic};
use node::{Namespace, Publisher, Result, Session, Subscriber, Wait, Waiter, clock};

use super::side::{Arrival, Body, End, LIFE_MAX, Link, await_peer, check_time};
use crate::payload::{Words, expected, sum, word};
use crate::peers::Role;

/// As long as anybody watches.
const DEADLINE: Duration = Duration::from_secs(1);

/// [-] Samples that wait for a reader; there is never more than one.
const DEPTH: usize = 4;

/// [-] Readers of one sample.
const ANSWERS: [&str; 4] = ["answer0", "answer1", "answer2", "answer3"];

fn topic<T: Words>(name: &'static str) -> Topic<T> {
    Topic::new(name, DEPTH, DEADLINE, "bench")
}

pub(super) fn with_link<T: Words>(
    end: &End<'_>,
    namespace: &Namespace,
    wait: Wait,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    let session = Session::join(namespace, &end.role.name(), 1)?;
    let until = clock::now().after(LIFE_MAX);
    let question = topic::<T>("question");
    let answers = ANSWERS.map(topic::<T>);
    let (publisher, subscribers, readers) = match end.role {
        Role::Sender => {
            let answers = answers.iter().take(end.hop.readers);
            let subscribers = answers.map(|answer| session.subscriber(answer));
            let subscribers = subscribers.collect::<Result<Vec<_>>>()?;
            (session.publisher(&question)?, subscribers, end.hop.readers)
        }
        Role::Reader(index) => {
            (session.publisher(&answers[index])?, vec![session.subscriber(&question)?], 1)
        }
    };
    session.with_waiter(wait, |waiter| {
        await_peer(until, || {
            publisher.readers() == readers && subscribers.iter().all(Subscriber::has_publisher)
        })?;
        body(&mut Ours { publisher, subscribers, waiter, until, touched: end.hop.touched })
    })
}

struct Ours<'a, T: Words> {
    publisher: Publisher<T>,
    subscribers: Vec<Subscriber<T>>,
    waiter: &'a Waiter<'a>,
    until: Stamp,
    touched: bool,
}

impl<T: Words> Link for Ours<'_, T> {
    fn send(&mut self, number: u64, stamp: Stamp) -> Result {
        let touched = self.touched;
        self.publisher.send_with(|sample| {
            sample.header_mut().stamp = stamp;
            if touched {
                sample.words_mut().fill(word(number));
            }
        })
    }

    fn receive(&mut self) -> Result<Arrival> {
        let mut has_waited = false;
        loop {
            for subscriber in &mut self.subscribers {
                let Some(sample) = subscriber.receive()? else { continue };
                let header = sample.header();
                let words = sample.words();
                let intact = self.touched && sum(words) == expected(words.len(), header.sequence);
                return Ok(Arrival { number: header.sequence, stamp: header.stamp, intact });
            }
            // Not in the way that every sample takes: it costs a look at the clock.
            if std::mem::replace(&mut has_waited, true) {
                check_time(self.until)?;
            }
            let has_come = || {
                for subscriber in &self.subscribers {
                    if subscriber.has_samples()? {
                        return Ok(true);
                    }
                }
                Ok(false)
            };
            self.waiter.wait(self.until, has_come)?;
        }
    }
}

//! The last few samples of a topic, borrowed where they lie, to be found by sequence number.

use std::collections::VecDeque;
use std::ops::Deref;

use interfaces::{Message, Topic};

use crate::{Node, Result, Sample, Subscriber};

/// Keeps as many samples of one topic as its queue is deep; a newer one lets the oldest go.
#[derive(Debug)]
pub struct Window<T: Message> {
    subscriber: Subscriber<T>,
    samples: Recent<Sample<T>>,
}

impl<T: Message + 'static> Window<T> {
    /// A window on `topic`; its samples do not wake the node.
    pub fn open(node: &mut Node<'_>, topic: &Topic<T>) -> Result<Self> {
        let subscriber = node.subscribe_quietly(topic)?;
        Ok(Self { subscriber, samples: Recent::new(topic.depth) })
    }

    /// Takes in what has come.
    pub fn refresh(&mut self) -> Result {
        while let Some(sample) = self.subscriber.receive()? {
            self.samples.push(sample);
        }
        Ok(())
    }

    /// The sample with this number from this life of the publisher.
    pub fn find(&self, sequence: u64, epoch: u32) -> Lookup<'_, Sample<T>> {
        self.samples.find(sequence, epoch)
    }
}

/// The last few samples themselves, however they are held: pure.
#[derive(Debug, Clone)]
pub struct Recent<S> {
    samples: VecDeque<S>,
    depth: usize,
}

impl<S: Deref<Target: Message>> Recent<S> {
    /// Room for `depth` samples.
    pub fn new(depth: usize) -> Self {
        // One more than stay: the newcomer is in before the oldest goes.
        Self { samples: VecDeque::with_capacity(depth + 1), depth }
    }

    /// Takes one in, and lets the oldest go.
    pub fn push(&mut self, sample: S) {
        self.samples.push_back(sample);
        if self.depth < self.samples.len() {
            self.samples.pop_front();
        }
    }

    /// The sample with this number from this life of the publisher.
    pub fn find(&self, sequence: u64, epoch: u32) -> Lookup<'_, S> {
        let wanted = (epoch, sequence);
        let place = |sample: &S| (sample.header().epoch, sample.header().sequence);
        // Not a search in an order: a sample may have overtaken another.
        match self.samples.iter().rev().find(|sample| place(sample) == wanted) {
            Some(sample) => Lookup::Here(sample),
            None if self.samples.iter().any(|sample| wanted < place(sample)) => Lookup::Gone,
            None => Lookup::NotYet,
        }
    }
}

/// What became of a sample that somebody else has seen.
#[derive(Debug)]
pub enum Lookup<'a, S> {
    /// It is here.
    Here(&'a S),
    /// It has not come: a publisher serves its readers one after another, and this one is not the
    /// first.
    NotYet,
    /// Newer ones have come, and it has made room for them or was never sent here.
    Gone,
}

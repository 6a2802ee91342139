//! The last few samples of a topic, borrowed where they lie, to be found by sequence number.

use std::collections::VecDeque;

use interfaces::{Message, Topic};

use crate::{Node, Result, Sample, Subscriber};

/// Keeps as many samples of one topic as its queue is deep; a newer one lets the oldest go.
#[derive(Debug)]
pub struct Window<T: Message> {
    subscriber: Subscriber<T>,
    samples: VecDeque<Sample<T>>,
    depth: usize,
}

impl<T: Message + 'static> Window<T> {
    /// A window on `topic`; its samples do not wake the node.
    pub fn open(node: &mut Node<'_>, topic: &Topic<T>) -> Result<Self> {
        let subscriber = node.subscribe_quietly(topic)?;
        // One more than stay: the newcomer is in before the oldest goes.
        let samples = VecDeque::with_capacity(topic.depth + 1);
        Ok(Self { subscriber, samples, depth: topic.depth })
    }

    /// Takes in what has come.
    pub fn refresh(&mut self) -> Result {
        while let Some(sample) = self.subscriber.receive()? {
            self.samples.push_back(sample);
            if self.depth < self.samples.len() {
                self.samples.pop_front();
            }
        }
        Ok(())
    }

    /// The sample with this number from this life of the publisher, if it is still there.
    pub fn find(&self, sequence: u64, epoch: u32) -> Option<&Sample<T>> {
        self.samples.iter().rev().find(|sample| {
            let header = sample.header();
            header.sequence == sequence && header.epoch == epoch
        })
    }
}

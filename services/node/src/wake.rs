//! Waking and being woken: every process has one channel, and every publisher knows its readers'.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{CallbackProgression, WaitSet, ipc};
use serde::Deserialize;

use crate::session::open_wake_service;
use crate::{Error, Result};

/// How a process waits for the next sample: the choice between latency and a core.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wait {
    /// Sleeps until somebody wakes it.
    Block,
    /// Looks again and again, giving its core away in between: for a chain of processes in step.
    Yield,
    /// Looks again and again: only for a process that has a core to itself.
    Poll,
}

/// The notifiers of every reader that this process wakes, by name; one for all its publishers.
#[derive(Debug)]
pub(crate) struct Wakers {
    node: iceoryx2::node::Node<ipc::Service>,
    notifiers: RefCell<BTreeMap<String, Notifier<ipc::Service>>>,
}

impl Wakers {
    pub(crate) fn new(node: iceoryx2::node::Node<ipc::Service>) -> Self {
        Self { node, notifiers: RefCell::default() }
    }

    pub(crate) const fn node(&self) -> &iceoryx2::node::Node<ipc::Service> {
        &self.node
    }

    /// Wakes `owner`. An event is a hint: one that cannot be given is no failure, since every
    /// wait ends by itself.
    pub(crate) fn wake(&self, owner: &str) {
        let mut notifiers = self.notifiers.borrow_mut();
        if !notifiers.contains_key(owner) {
            let notifier = open_wake_service(&self.node, owner).and_then(|service| {
                service
                    .notifier_builder()
                    .create()
                    .map_err(|cause| Error::shared_memory(format!("wake '{owner}'"), cause))
            });
            match notifier {
                Ok(notifier) => drop(notifiers.insert(owner.to_owned(), notifier)),
                Err(cause) => return tracing::debug!(%cause, "a reader will wake late"),
            }
        }
        if let Some(notifier) = notifiers.get(owner)
            && let Err(cause) = notifier.notify()
        {
            tracing::debug!(?cause, owner, "a reader will wake late");
        }
    }
}

/// One process's way to wait. The listener is all that is attached to the set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Waiter<'a> {
    pub(crate) mode: Wait,
    pub(crate) listener: &'a Listener<ipc::Service>,
    pub(crate) waitset: &'a WaitSet<ipc::Service>,
}

impl Waiter<'_> {
    /// Waits until somebody wakes this process, a signal arrives, or `timeout` has passed.
    pub(crate) fn wait(&self, timeout: Duration) -> Result<()> {
        match self.mode {
            Wait::Block => self.block(timeout),
            Wait::Yield => {
                rustix::thread::sched_yield();
                Ok(())
            }
            Wait::Poll => {
                std::hint::spin_loop();
                Ok(())
            }
        }
    }

    fn block(&self, timeout: Duration) -> Result<()> {
        // An interrupt is a short wait: the caller looks at the stop flag.
        self.waitset
            .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, timeout)
            .map_err(|cause| Error::shared_memory("wait", cause))?;
        self.drain()
    }

    /// Down to zero, and on time-outs too: iceoryx2 0.10.0 can otherwise lose a wake-up for good.
    fn drain(&self) -> Result<()> {
        let pending = || {
            self.listener
                .try_wait(|_| {})
                .map_err(|cause| Error::shared_memory("drain the wake-up channel", cause))
        };
        while 0 < pending()? {}
        Ok(())
    }
}

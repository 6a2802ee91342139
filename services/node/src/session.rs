//! One process's membership in a robot's shared memory: opens topics and wake-up channels.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::{
    BackpressureStrategy, CallbackProgression, NodeBuilder, NodeName, PortFactory as _, PortName,
    ServiceName, SignalHandlingMode, ipc,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory;
use interfaces::{Loss, Message, Scope, Topic};

use crate::arguments::uncounted_epoch;
use crate::port::{Publisher, Subscriber};
use crate::wake::Wakers;
use crate::{Clock, Error, Namespace, Result, clock, signal};

pub(crate) type Service<T> = port_factory::publish_subscribe::PortFactory<ipc::Service, T, ()>;

/// [-] Readers of one topic: the robot's processes, observers and recorders.
pub(crate) const SUBSCRIBERS_MAX: usize = 16;

/// [-] Processes that may take part in one topic or channel, the dead ones not yet cleared included.
const NODES_MAX: usize = 32;

/// [-] Samples that a reader may hold beside its queue: a full queue and the one at hand.
pub(crate) const BORROWED_SPARE: usize = 2;

/// [-] Attempts to open what another process is just making or clearing away.
const OPEN_ATTEMPTS: u32 = 100;

/// A reader in lock-step that takes longer than this for one sample hangs.
const READER_TIMEOUT: Duration = Duration::from_secs(2);

/// What the port names of readers begin with that no sample wakes. No node's name begins with it.
const QUIET: char = '~';

/// The same of readers that are no part of the robot: in lock-step it does not wait for them.
const OBSERVER: char = '?';

/// By then the supervisor has removed what a killed guest left half made.
const GUEST_PATIENCE: Duration = Duration::from_secs(3);

/// Long enough for another process to finish a system call.
const OPEN_PAUSE: Duration = Duration::from_millis(5);

/// A process's membership in a robot's shared memory. Its ports stay on the thread that made it.
#[derive(Debug)]
pub struct Session {
    name: String,
    epoch: u32,
    clock: Clock,
    wakers: Rc<Wakers>,
}

impl Session {
    /// Joins `namespace` under `name`, in life number `epoch` of that name.
    pub fn join(namespace: &Namespace, name: &str, epoch: u32) -> Result<Self> {
        let config = namespace.enter()?;
        let node_name = NodeName::new(name).map_err(|_| Error::Name { name: name.to_owned() })?;
        let node = retry(
            || {
                NodeBuilder::new()
                    .name(&node_name)
                    .config(&config)
                    .signal_handling_mode(SignalHandlingMode::Disabled)
                    .create::<ipc::Service>()
            },
            |_| true,
        )
        .map_err(|cause| {
            Error::shared_memory(format!("join robot '{}'", namespace.robot()), cause)
        })?;
        Ok(Self {
            name: name.to_owned(),
            epoch,
            clock: Clock::Realtime,
            wakers: Rc::new(Wakers::new(node, namespace)),
        })
    }

    /// Joins `namespace` as a guest called `name`, whom no supervisor starts, in a life whose number
    /// nobody has counted. It clears away what guests before it held that were killed, when nothing
    /// is half made any more: that would hold it up for ever.
    pub fn guest(namespace: &Namespace, name: &str) -> Result<Self> {
        namespace.await_finished(GUEST_PATIENCE);
        namespace.clear_dead()?;
        Self::join(namespace, name, uncounted_epoch(clock::now()))
    }

    /// In lock-step no sample is lost: a full queue holds its publisher up until it is read. And
    /// publishers digest what they send, since only there two runs can be equal.
    #[must_use]
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }

    /// Whose time the robot lives in.
    pub(crate) const fn clock(&self) -> Clock {
        self.clock
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Becomes the one publisher of `topic`, of this session's own where each node has one.
    pub fn publisher<T: Message>(&self, topic: &Topic<T>) -> Result<Publisher<T>> {
        self.publisher_to(topic, &self.name)
    }

    /// Becomes the one publisher of `topic` that belongs to `owner`.
    pub fn publisher_to<T: Message>(&self, topic: &Topic<T>, owner: &str) -> Result<Publisher<T>> {
        let name = topic.full_name(owner);
        let service = Arc::new(self.open(topic, owner)?);
        let port = retry(
            || {
                let readers = Arc::clone(&service);
                service
                    .publisher_builder()
                    .name(&port_name(&self.name))
                    .max_loaned_samples(1)
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .set_backpressure_handler(move |info| await_reader(&readers, info))
                    .create()
            },
            |_| false,
        )
        .map_err(|_| Error::Taken { topic: name.clone(), publisher: topic.publisher })?;
        Ok(Publisher::new(
            name,
            self.epoch,
            service,
            port,
            Rc::clone(&self.wakers),
            self.is_lossless(topic),
        ))
    }

    /// A reader of `topic`, of this session's own where each node has one. Every sample wakes it.
    pub fn subscriber<T: Message>(&self, topic: &Topic<T>) -> Result<Subscriber<T>> {
        self.subscriber_as(topic, &self.name, &self.name)
    }

    /// A reader of `topic` that belongs to `owner`. Every sample wakes this session.
    pub fn subscriber_to<T: Message>(
        &self,
        topic: &Topic<T>,
        owner: &str,
    ) -> Result<Subscriber<T>> {
        self.subscriber_as(topic, owner, &self.name)
    }

    /// A reader of `topic` that no sample wakes: for what is looked at when something else wakes.
    pub fn quiet_subscriber<T: Message>(&self, topic: &Topic<T>) -> Result<Subscriber<T>> {
        self.subscriber_as(topic, &self.name, &format!("{QUIET}{}", self.name))
    }

    /// A reader of `topic` that belongs to `owner`, for one who looks on and is no part of the robot:
    /// no sample wakes it, and none waits for it, not even in lock-step, where it finds gaps if it
    /// reads too slowly. `None` where nobody has opened the topic: one who looks on makes none.
    pub fn observer<T: Message>(
        &self,
        topic: &Topic<T>,
        owner: &str,
    ) -> Result<Option<Subscriber<T>>> {
        let name = topic.full_name(owner);
        let service_name = service_name(&name)?;
        let open = || {
            let service = self.wakers.node().service_builder(&service_name);
            service.publish_subscribe::<T>().open()
        };
        let is_passing = |cause: &PublishSubscribeOpenError| {
            *cause != PublishSubscribeOpenError::DoesNotExist && !is_other(*cause)
        };
        let service = match retry(open, is_passing) {
            Ok(service) => service,
            Err(PublishSubscribeOpenError::DoesNotExist) => return Ok(None),
            Err(cause) if is_other(cause) => return Err(incompatible::<T>(name)),
            Err(cause) => {
                return Err(Error::shared_memory(format!("open topic '{name}'"), cause));
            }
        };
        let observer = format!("{OBSERVER}{}", self.name);
        reader(topic, name, service, &observer).map(Some)
    }

    fn subscriber_as<T: Message>(
        &self,
        topic: &Topic<T>,
        owner: &str,
        port: &str,
    ) -> Result<Subscriber<T>> {
        let service = self.open(topic, owner)?;
        reader(topic, topic.full_name(owner), service, port)
    }

    /// Opens `topic` without a port and holds it open: for the one process that outlives the rest.
    pub fn hold<T: Message>(&self, topic: &Topic<T>, owner: &str) -> Result<Held> {
        Ok(Held(Box::new(self.open(topic, owner)?)))
    }

    fn open<T: Message>(&self, topic: &Topic<T>, owner: &str) -> Result<Service<T>> {
        let name = topic.full_name(owner);
        let service_name = service_name(&name)?;
        let history = usize::from(topic.loss == Loss::Latched);
        let open = || {
            self.wakers
                .node()
                .service_builder(&service_name)
                .publish_subscribe::<T>()
                .max_publishers(1)
                .max_subscribers(SUBSCRIBERS_MAX)
                .max_nodes(NODES_MAX)
                .history_size(history)
                .subscriber_max_buffer_size(topic.depth)
                .subscriber_max_borrowed_samples(topic.depth + BORROWED_SPARE)
                .enable_safe_overflow(!self.is_lossless(topic))
                .open_or_create()
        };
        retry(open, |cause| !is_incompatible(*cause)).map_err(|cause| {
            if is_incompatible(cause) {
                incompatible::<T>(name)
            } else {
                Error::shared_memory(format!("open topic '{name}'"), cause)
            }
        })
    }

    fn is_lossless<T: Message>(&self, topic: &Topic<T>) -> bool {
        let is_stream = topic.scope == Scope::Robot && topic.loss == Loss::KeepNewest;
        self.clock == Clock::Lockstep && is_stream
    }

    /// What the names of the robot's files in shared memory begin with.
    pub(crate) fn prefix(&self) -> &str {
        self.wakers.prefix()
    }
}

fn reader<T: Message>(
    topic: &Topic<T>,
    name: String,
    service: Service<T>,
    port: &str,
) -> Result<Subscriber<T>> {
    let history = usize::from(topic.loss == Loss::Latched);
    let wakes = is_woken(port);
    let port = service
        .subscriber_builder()
        .name(&port_name(port))
        .buffer_size(topic.depth)
        .history_request(history)
        .create()
        .map_err(|cause| Error::shared_memory(format!("read topic '{name}'"), cause))?;
    Ok(Subscriber::new(name, topic.loss, service, port, wakes))
}

/// A reader's queue is full, and nothing may be lost: give it time, but not for ever. One who only
/// looks on loses what does not fit, and holds nobody up.
fn await_reader<T: Message>(readers: &Service<T>, info: &BackpressureInfo) -> BackpressureAction {
    let is_over = READER_TIMEOUT < info.elapsed_time || 0 < signal::stop_requests();
    if is_over || (info.retries == 0 && is_observer(readers, info.receiver_port_id)) {
        return BackpressureAction::DiscardData;
    }
    rustix::thread::sched_yield();
    BackpressureAction::Retry
}

fn is_observer<T: Message>(readers: &Service<T>, port: u128) -> bool {
    let mut is_observer = false;
    readers.dynamic_config().list_subscribers(|reader| {
        if reader.subscriber_id.value() != port {
            return CallbackProgression::Continue;
        }
        is_observer = reader.subscriber_name.to_string().starts_with(OBSERVER);
        CallbackProgression::Stop
    });
    is_observer
}

/// Whether a reader is woken whose port has this name.
pub(crate) fn is_woken(port: &str) -> bool {
    !port.starts_with([QUIET, OBSERVER])
}

/// Who has the port of this name; `None` where he only looks on.
pub(crate) fn owner_of(port: &str) -> Option<&str> {
    (!port.starts_with(OBSERVER)).then(|| port.trim_start_matches(QUIET))
}

/// A topic that is held open without a port.
#[derive(Debug)]
pub struct Held(
    #[expect(dead_code, reason = "dropped, and that is its use")] Box<dyn std::fmt::Debug>,
);

fn is_incompatible(cause: PublishSubscribeOpenOrCreateError) -> bool {
    let PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(cause) = cause else {
        return false;
    };
    is_other(cause)
}

fn incompatible<T>(topic: String) -> Error {
    let message = std::any::type_name::<T>().rsplit("::").next().unwrap_or_default();
    Error::Incompatible { topic, message }
}

/// Whether the topic is there, and is another one.
const fn is_other(cause: PublishSubscribeOpenError) -> bool {
    matches!(
        cause,
        PublishSubscribeOpenError::IncompatibleTypes
            | PublishSubscribeOpenError::IncompatibleOverflowBehavior
            | PublishSubscribeOpenError::DoesNotSupportRequestedMinBufferSize
            | PublishSubscribeOpenError::DoesNotSupportRequestedMinHistorySize
            | PublishSubscribeOpenError::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfPublishers
            | PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfSubscribers
            | PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfNodes
    )
}

/// Another process may be just making or clearing away what we open: try again, but not for ever.
fn retry<T, E>(
    mut attempt: impl FnMut() -> std::result::Result<T, E>,
    is_passing: impl Fn(&E) -> bool,
) -> std::result::Result<T, E> {
    for _ in 1..OPEN_ATTEMPTS {
        match attempt() {
            Err(cause) if is_passing(&cause) => clock::nap(OPEN_PAUSE),
            outcome => return outcome,
        }
    }
    attempt()
}

fn service_name(name: &str) -> Result<ServiceName> {
    ServiceName::new(name).map_err(|_| Error::Name { name: name.to_owned() })
}

fn port_name(name: &str) -> PortName {
    PortName::new(name).unwrap_or_else(|_| PortName::new("").unwrap_or_else(|_| unreachable!()))
}

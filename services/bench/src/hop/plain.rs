//! iceoryx2 as its users have it: the same service, the same loan, without our layer.

use std::mem::MaybeUninit;
use std::time::Duration;

use hdrhistogram::Histogram;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    CallbackProgression, Config, FileName, Node, NodeBuilder, Path, PortFactory as _,
    SemanticString, ServiceName, SignalHandlingMode, WaitSet, WaitSetBuilder, ipc,
};
use interfaces::{Header, Stamp};
use node::{Error, Namespace, Result, clock};

use super::Way;
use super::side::{Arrival, Body, End, LIFE_MAX, Link, await_peer, check_time, look};
use crate::payload::{Words, expected, sum, word};
use crate::peers::Role;

/// [-] As our topics of the same purpose have them.
const DEPTH: usize = 4;
/// [-] Likewise.
const READERS_MAX: usize = 16;

/// However long nothing comes, a wait ends.
const WAIT_MAX: Duration = Duration::from_millis(50);

fn failed(cause: impl std::fmt::Debug) -> Error {
    Error::Fault(format!("plain iceoryx2 refuses: {cause:?}"))
}

fn join(namespace: &Namespace) -> Result<Node<ipc::Service>> {
    namespace.create_directory()?;
    let mut config = Config::default();
    let root = namespace.directory().as_os_str().as_encoded_bytes();
    config.global.set_root_path(&Path::new(root).map_err(failed)?);
    config.global.prefix = FileName::new(namespace.prefix().as_bytes()).map_err(failed)?;
    NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(failed)
}

fn name(name: &str) -> Result<ServiceName> {
    ServiceName::new(name).map_err(failed)
}

/// Which topics a side reads, and which it writes.
fn topics(end: &End<'_>) -> (Vec<String>, String) {
    let answer = |index| format!("answer{index}");
    match end.role {
        Role::Sender => ((0..end.hop.readers).map(answer).collect(), "question".to_owned()),
        Role::Reader(index) => (vec!["question".to_owned()], answer(index)),
    }
}

pub(super) fn with_link<T: Words>(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    let node = join(namespace)?;
    let until = clock::now().after(LIFE_MAX);
    let open = |topic: &str| {
        node.service_builder(&name(topic)?)
            .publish_subscribe::<T>()
            .max_publishers(1)
            .max_subscribers(READERS_MAX)
            .history_size(0)
            .subscriber_max_buffer_size(DEPTH)
            .subscriber_max_borrowed_samples(DEPTH + 2)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(failed)
    };
    let (read, written) = topics(end);
    let services = read.iter().map(|topic| open(topic)).collect::<Result<Vec<_>>>()?;
    let subscribers =
        services.iter().map(|service| service.subscriber_builder().buffer_size(DEPTH).create());
    let subscribers = subscribers.collect::<std::result::Result<Vec<_>, _>>().map_err(failed)?;
    let service = open(&written)?;
    let publisher = service.publisher_builder().max_loaned_samples(1).create().map_err(failed)?;
    let bell = Bell::new(&node, end)?;
    let waitset = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(failed)?;
    let _attached = waitset.attach_notification(&bell.listener).map_err(failed)?;
    let readers = if end.role == Role::Sender { end.hop.readers } else { 1 };
    await_peer(until, || {
        bell.is_heard()
            && service.dynamic_config().number_of_subscribers() == readers
            && services.iter().all(|service| service.dynamic_config().number_of_publishers() == 1)
    })?;
    let bell = (end.hop.way == Way::PlainBlock).then_some((&bell, &waitset));
    let yields = end.hop.way == Way::PlainYield;
    body(&mut Plain { publisher, subscribers, bell, yields, until, touched: end.hop.touched })
}

/// One process's way to wake and to be woken.
struct Bell {
    listener: Listener<ipc::Service>,
    notifiers: Vec<Notifier<ipc::Service>>,
    services: Vec<iceoryx2::service::port_factory::event::PortFactory<ipc::Service>>,
}

impl Bell {
    fn new(node: &Node<ipc::Service>, end: &End<'_>) -> Result<Self> {
        let open = |owner: &str| {
            let service = node.service_builder(&name(&format!("wake/{owner}"))?).event();
            service.max_notifiers(READERS_MAX).open_or_create().map_err(failed)
        };
        let others = match end.role {
            Role::Sender => (0..end.hop.readers).map(Role::Reader).collect(),
            Role::Reader(_) => vec![Role::Sender],
        };
        let services =
            others.iter().map(|other| open(&other.name())).collect::<Result<Vec<_>>>()?;
        let notifiers = services.iter().map(|service| service.notifier_builder().create());
        Ok(Self {
            listener: open(&end.role.name())?.listener_builder().create().map_err(failed)?,
            notifiers: notifiers.collect::<std::result::Result<_, _>>().map_err(failed)?,
            services,
        })
    }

    fn is_heard(&self) -> bool {
        self.services.iter().all(|service| service.dynamic_config().number_of_listeners() == 1)
    }
}

struct Plain<'a, T: Words> {
    publisher: Publisher<ipc::Service, T, ()>,
    subscribers: Vec<Subscriber<ipc::Service, T, ()>>,
    bell: Option<(&'a Bell, &'a WaitSet<ipc::Service>)>,
    yields: bool,
    until: Stamp,
    touched: bool,
}

impl<T: Words> Plain<'_, T> {
    fn find(&self) -> Result<Option<Arrival>> {
        for subscriber in &self.subscribers {
            let Some(sample) = subscriber.receive().map_err(failed)? else { continue };
            let header = sample.payload().header();
            let words = sample.payload().words();
            let intact = self.touched && sum(words) == expected(words.len(), header.sequence);
            return Ok(Some(Arrival { number: header.sequence, stamp: header.stamp, intact }));
        }
        Ok(None)
    }
}

impl<T: Words> Link for Plain<'_, T> {
    fn send(&mut self, number: u64, stamp: Stamp) -> Result {
        let mut sample = self.publisher.loan().map_err(failed)?;
        let payload = sample.payload_mut();
        *payload.header_mut() = Header { stamp, sequence: number, ..Header::default() };
        if self.touched {
            payload.words_mut().fill(word(number));
        }
        sample.send().map_err(failed)?;
        for notifier in self.bell.iter().flat_map(|(bell, _)| &bell.notifiers) {
            notifier.notify().map_err(failed)?;
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Arrival> {
        let Some((bell, waitset)) = self.bell else {
            return if self.yields {
                look(self.until, rustix::thread::sched_yield, || self.find())
            } else {
                look(self.until, std::hint::spin_loop, || self.find())
            };
        };
        loop {
            if let Some(arrival) = self.find()? {
                return Ok(arrival);
            }
            check_time(self.until)?;
            waitset
                .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, WAIT_MAX)
                .map_err(failed)?;
            // Down to zero, or iceoryx2 0.10.0 can lose a wake-up for good.
            while 0 < bell.listener.try_wait(|_| {}).map_err(failed)? {}
        }
    }
}

type Bare = [MaybeUninit<u8>];

/// The same with a slice that is sent as it lies: what the transport alone takes.
pub(super) fn with_bare_link(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    let node = join(namespace)?;
    let until = clock::now().after(LIFE_MAX);
    let bytes = end.hop.size.bytes() - size_of::<Header>();
    let open = |topic: &str| {
        node.service_builder(&name(topic)?)
            .publish_subscribe::<Bare>()
            .user_header::<Header>()
            .max_publishers(1)
            .max_subscribers(READERS_MAX)
            .history_size(0)
            .subscriber_max_buffer_size(DEPTH)
            .subscriber_max_borrowed_samples(DEPTH + 2)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(failed)
    };
    let (read, written) = topics(end);
    let question = open(&read[0])?;
    let subscriber = question.subscriber_builder().buffer_size(DEPTH).create().map_err(failed)?;
    let service = open(&written)?;
    let publisher = service.publisher_builder().initial_max_slice_len(bytes).max_loaned_samples(1);
    let publisher = publisher.create().map_err(failed)?;
    await_peer(until, || {
        service.dynamic_config().number_of_subscribers() == 1
            && question.dynamic_config().number_of_publishers() == 1
    })?;
    body(&mut BareLink { publisher, subscriber, bytes, until })
}

struct BareLink {
    publisher: Publisher<ipc::Service, Bare, Header>,
    subscriber: Subscriber<ipc::Service, Bare, Header>,
    bytes: usize,
    until: Stamp,
}

impl Link for BareLink {
    fn send(&mut self, number: u64, stamp: Stamp) -> Result {
        let sample = self.publisher.loan_slice_uninit(self.bytes).map_err(failed)?;
        let mut sample = sample.write_from_fn(|_| MaybeUninit::uninit());
        *sample.user_header_mut() = Header { stamp, sequence: number, ..Header::default() };
        sample.send().map_err(failed)?;
        Ok(())
    }

    fn receive(&mut self) -> Result<Arrival> {
        look(self.until, std::hint::spin_loop, || {
            let Some(sample) = self.subscriber.receive().map_err(failed)? else { return Ok(None) };
            let Header { stamp, sequence: number, .. } = *sample.user_header();
            Ok(Some(Arrival { number, stamp, intact: false }))
        })
    }
}

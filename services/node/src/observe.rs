//! Looking on: any topic of the table by its name, and how it does, for one who is no part of the
//! robot.
//!
//! One who looks on is not woken and holds nobody up: it looks whenever it likes, and samples that it
//! was too slow for are gaps. What it finds out of times is as exact as it looks often.

mod statistics;

use interfaces::topics::{self, Visitor};
use interfaces::{Described, Field, Header, Loss, Topic};

use crate::{Result, Sample, Session, Subscriber};

pub use statistics::{Ages, Period, Statistics};

/// What the topic table says of one topic, whatever its type.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// [-] The full name: `scan`, or `odometry/status`.
    pub name: String,
    /// [-] The type of its messages.
    pub message: &'static str,
    /// [byte] Of one message.
    pub size: usize,
    /// [-] Samples that a reader's queue holds.
    pub depth: usize,
    /// The age past which a sample says nothing any more.
    pub deadline: std::time::Duration,
    /// What happens where a queue is full.
    pub loss: Loss,
    /// [-] The only one who publishes, by role.
    pub publisher: &'static str,
    /// The fields of a message that says nothing: their names and units.
    pub fields: Vec<Field>,
}

/// What the table says of the topic called `name`; `None` where it has none.
pub fn row(name: &str) -> Option<Row> {
    struct Rows<'a>(&'a str);

    impl Visitor for Rows<'_> {
        type Output = Row;

        fn visit<T: Described>(self, topic: &'static Topic<T>, _owner: &str) -> Row {
            Row {
                name: self.0.to_owned(),
                message: T::NAME,
                size: size_of::<T>(),
                depth: topic.depth,
                deadline: topic.deadline,
                loss: topic.loss,
                publisher: topic.publisher,
                fields: T::default().fields(),
            }
        }
    }

    topics::find(name, Rows(name))
}

/// One who reads a topic of which only the name was known.
pub trait Observer {
    /// The oldest sample that is queued.
    fn receive(&mut self) -> Result<Option<Box<dyn Seen>>>;

    /// Whether somebody publishes the topic; see [`Subscriber::publishers`].
    fn publishers(&self) -> Vec<String>;

    /// Who reads the topic; see [`Subscriber::readers`].
    fn readers(&self) -> Vec<String>;
}

/// A sample of a topic of which only the name was known, borrowed from shared memory.
pub trait Seen {
    /// Its header.
    fn header(&self) -> Header;

    /// What it holds behind its header.
    fn fields(&self) -> Vec<Field>;
}

/// One who reads the topic called `name`. `None` where the table has none, or nobody has opened it.
pub fn topic(session: &Session, name: &str) -> Result<Option<Box<dyn Observer>>> {
    struct Open<'a>(&'a Session);

    impl Visitor for Open<'_> {
        type Output = Result<Option<Box<dyn Observer>>>;

        fn visit<T: Described>(self, topic: &'static Topic<T>, owner: &str) -> Self::Output {
            let observer = self.0.observer(topic, owner)?;
            Ok(observer.map(|observer| Box::new(observer) as Box<dyn Observer>))
        }
    }

    topics::find(name, Open(session)).unwrap_or(Ok(None))
}

impl<T: Described> Observer for Subscriber<T> {
    fn receive(&mut self) -> Result<Option<Box<dyn Seen>>> {
        let sample = Subscriber::receive(self)?;
        Ok(sample.map(|sample| Box::new(sample) as Box<dyn Seen>))
    }

    fn publishers(&self) -> Vec<String> {
        Subscriber::publishers(self)
    }

    fn readers(&self) -> Vec<String> {
        Subscriber::readers(self)
    }
}

impl<T: Described> Seen for Sample<T> {
    fn header(&self) -> Header {
        *(**self).header()
    }

    fn fields(&self) -> Vec<Field> {
        (**self).fields()
    }
}

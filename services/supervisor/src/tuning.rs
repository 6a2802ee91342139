//! Parameters that are changed while their node runs: asked for at the control socket, judged by the
//! node, and told as an event.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Duration;

use interfaces::topics::{PARAMETER_CHANGE, SET_PARAMETER};
use interfaces::{ParameterChange, SetParameter, Stamp, State, Text};
use node::{Clock, Publisher, Result, Session, Subscriber, clock};
use serde_json::{Value, json};

use crate::control::ClientId;
use crate::supervise::Supervisor;

/// A node that turns at all answers many times faster.
const PATIENCE: Duration = Duration::from_secs(1);

/// What is asked of the nodes' parameters, and by whom.
#[derive(Debug, Default)]
pub(crate) struct Tuning {
    /// By node; opened when somebody first asks.
    lines: BTreeMap<usize, Line>,
    waiting: Vec<Waiting>,
}

/// The two topics of a node by which its parameters are changed.
#[derive(Debug)]
struct Line {
    requests: Publisher<SetParameter>,
    answers: Subscriber<ParameterChange>,
    sent: u64,
    /// What was changed in this life of the node.
    epoch: u32,
    changed: BTreeMap<String, Value>,
}

#[derive(Debug)]
struct Waiting {
    client: ClientId,
    node: usize,
    request: u64,
    until: Stamp,
}

impl Tuning {
    /// What was changed of a node in life number `epoch`: key and value.
    pub(crate) fn changed(&self, node: usize, epoch: u32) -> Value {
        let line = self.lines.get(&node).filter(|line| line.epoch == epoch);
        line.map_or_else(|| json!({}), |line| json!(line.changed))
    }

    /// When somebody has waited for too long.
    pub(crate) fn next_deadline(&self) -> Option<Stamp> {
        self.waiting.iter().map(|waiting| waiting.until).min()
    }

    fn line(&mut self, session: &Session, node: usize, name: &str) -> Result<Option<&mut Line>> {
        let place = match self.lines.entry(node) {
            Entry::Occupied(line) => return Ok(Some(line.into_mut())),
            Entry::Vacant(place) => place,
        };
        // A node that has parameters to change has opened the topics by now; others never do.
        if session.observer(&PARAMETER_CHANGE, name)?.is_none() {
            return Ok(None);
        }
        let requests = session.publisher_to(&SET_PARAMETER, name)?;
        let answers = session.subscriber_to(&PARAMETER_CHANGE, name)?;
        let changed = BTreeMap::new();
        Ok(Some(place.insert(Line { requests, answers, sent: 0, epoch: 0, changed })))
    }
}

impl Supervisor<'_> {
    /// Passes on what `client` asks of a node's parameter, or says why not.
    pub(crate) fn ask_to_set(&mut self, client: ClientId, node: usize, key: &str, value: &Value) {
        let asked = typed(value).and_then(|value| self.send_to(node, key, &value));
        match asked {
            Ok(request) => {
                let until = clock::now().after(PATIENCE);
                self.tuning.waiting.push(Waiting { client, node, request, until });
            }
            Err(why) => self.desk.answer(client, &json!({ "error": why })),
        }
    }

    fn send_to(&mut self, node: usize, key: &str, value: &str) -> std::result::Result<u64, String> {
        let name = &self.names[node];
        if self.settings.clock() == Clock::Lockstep {
            return Err("in lock-step nothing is changed on the way, or the same launch file \
                        would not give the same bytes; write it there, or use --set"
                .to_owned());
        }
        if self.members[node].state() != State::Active {
            return Err(format!("{name} is not active; `teseo start {name}` brings it up"));
        }
        let epoch = self.members[node].epoch;
        let opened = self.tuning.line(&self.session, node, name);
        let Some(line) = opened.map_err(|error| error.to_string())? else {
            return Err(format!("{name} has no parameter that can be changed while it runs"));
        };
        if line.epoch != epoch {
            (line.epoch, line.changed) = (epoch, BTreeMap::new());
        }
        let request = line.sent;
        let sent = line.requests.send_with(|request| {
            request.header.stamp = clock::now();
            request.key = Text::new(key);
            request.value = Text::new(value);
        });
        sent.map_err(|error| error.to_string())?;
        line.sent += 1;
        Ok(request)
    }

    /// Takes in what nodes made of requests; tells whoever asked, and all who follow events.
    pub(crate) fn hear_of_parameters(&mut self, now: Stamp) -> Result {
        let nodes: Vec<_> = self.tuning.lines.keys().copied().collect();
        for node in nodes {
            while let Some(change) = self.next_change(node)? {
                self.tell_change(node, &change, now);
            }
        }
        let waiting = std::mem::take(&mut self.tuning.waiting);
        for one in waiting {
            if now < one.until {
                self.tuning.waiting.push(one);
            } else {
                let why = format!("{} does not answer", self.names[one.node]);
                self.desk.answer(one.client, &json!({ "error": why }));
            }
        }
        Ok(())
    }

    fn next_change(&mut self, node: usize) -> Result<Option<ParameterChange>> {
        let Some(line) = self.tuning.lines.get_mut(&node) else { return Ok(None) };
        let Some(change) = line.answers.receive()? else { return Ok(None) };
        if change.accepted == 1 && change.header.epoch == line.epoch {
            line.changed.insert(change.key.to_string(), meant(&change.value));
        }
        Ok(Some(*change))
    }

    fn tell_change(&mut self, node: usize, change: &ParameterChange, now: Stamp) {
        let text = sentence(change);
        let details = json!({
            "key": change.key.as_str(),
            "former": meant(&change.former),
            "value": meant(&change.value),
            "accepted": change.accepted == 1,
            "reason": change.reason.as_str(),
        });
        let epoch = change.header.epoch;
        let happening =
            self.history.add_parameter(node, epoch, text, details.clone(), now, clock::wall());
        self.desk.tell(happening);
        self.screen.tell_line(now, Some(&self.names[node]), &happening.text);
        let asked = |one: &Waiting| one.node == node && one.request == change.request;
        let (asked, others) = std::mem::take(&mut self.tuning.waiting).into_iter().partition(asked);
        self.tuning.waiting = others;
        for Waiting { client, .. } in asked {
            let answer = if change.accepted == 1 {
                json!({ "parameter": details })
            } else {
                json!({ "error": format!("`{}` {}", change.key, change.reason) })
            };
            self.desk.answer(client, &answer);
        }
    }
}

/// As somebody would type it.
fn typed(value: &Value) -> std::result::Result<String, String> {
    match value {
        Value::String(text) if text.len() <= Text::CAPACITY => Ok(text.clone()),
        Value::Number(_) | Value::Bool(_) => Ok(value.to_string()),
        _ => Err("a value is a number, a word, true or false".to_owned()),
    }
}

/// What it says: a number, true or false, nothing, or else a word.
fn meant(text: &Text) -> Value {
    let scalar = |value: &Value| value.is_number() || value.is_boolean();
    match text.as_str() {
        "" => Value::Null,
        text => serde_json::from_str(text).ok().filter(scalar).unwrap_or_else(|| text.into()),
    }
}

fn sentence(change: &ParameterChange) -> String {
    let (key, former, value) = (&change.key, &change.former, &change.value);
    if change.accepted == 1 {
        let former = if former.is_empty() { "nothing" } else { former.as_str() };
        format!("{key} {former} -> {value}")
    } else {
        format!("refused {key} = {value}, which {}", change.reason)
    }
}

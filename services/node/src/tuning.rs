//! Parameters that change while a node runs: which may, and the code that says whether a value may be.

use std::ops::RangeInclusive;

use interfaces::topics::{PARAMETER_CHANGE, SET_PARAMETER};
use interfaces::{ParameterChange, SetParameter, Text};

use crate::config::{self, Listable, suggestion};
use crate::{Node, Publisher, Result, Session, Subscriber, clock};

/// A parameter that may be changed while its node runs.
#[derive(Debug)]
pub struct Tunable {
    /// [-] Dotted, as in the parameter file.
    pub key: &'static str,
    /// [as the key says] What it may be changed to. Narrower than what a file may say: whoever types
    /// slips more easily.
    pub range: RangeInclusive<f64>,
}

/// The wires by which a node's parameters are changed, and what they are by now.
#[derive(Debug)]
pub struct Tuning<T> {
    parameters: T,
    tunables: &'static [Tunable],
    requests: Subscriber<SetParameter>,
    answers: Publisher<ParameterChange>,
}

impl<T: Listable> Tuning<T> {
    pub(crate) fn open(
        session: &Session,
        parameters: T,
        tunables: &'static [Tunable],
    ) -> Result<Self> {
        let requests = session.subscriber(&SET_PARAMETER)?;
        let answers = session.publisher(&PARAMETER_CHANGE)?;
        Ok(Self { parameters, tunables, requests, answers })
    }

    /// All parameters as they are from now on, if one was changed. What cannot be is refused, by the
    /// code that judges the parameter file too, and nothing changes. No file is read: what was
    /// written there since has no part in it.
    pub fn take(&mut self, node: &Node<'_>) -> Result<Option<&T>> {
        let mut is_changed = false;
        while let Some(request) = self.requests.receive()? {
            let former = config::number(&self.parameters, request.key.as_str());
            let outcome = tuned(&self.parameters, self.tunables, &request);
            self.answers.send_with(|answer| {
                answer.header.stamp = clock::now();
                answer.request = request.header.sequence;
                answer.former = former.unwrap_or_default();
                answer.value = request.value;
                answer.accepted = outcome.is_ok().into();
                answer.key = request.key;
                answer.reason = Text::new(outcome.as_ref().err().map_or("", String::as_str));
            })?;
            node.hint("PARAMETERS");
            if let Ok(parameters) = outcome {
                self.parameters = parameters;
                is_changed = true;
            }
        }
        Ok(is_changed.then_some(&self.parameters))
    }
}

/// The parameters with the one that is asked for, or why they cannot be.
fn tuned<T: Listable>(
    parameters: &T,
    tunables: &[Tunable],
    request: &SetParameter,
) -> std::result::Result<T, String> {
    let (key, value) = (request.key.as_str(), request.value);
    let Some(tunable) = tunables.iter().find(|tunable| tunable.key == key) else {
        let keys: Vec<_> = tunables.iter().map(|tunable| tunable.key).collect();
        let near = suggestion(key, &keys);
        // A list of all of them is too long for a message.
        let help = if near.starts_with("did") { &near } else { "`teseo param list` says what can" };
        return Err(format!("cannot be changed while the node runs; {help}"));
    };
    if !tunable.range.contains(&value) {
        let (min, max) = (tunable.range.start(), tunable.range.end());
        return Err(format!("is out of range; give {min} to {max}"));
    }
    config::changed(parameters, key, value)
}

//! Parameters that change while a node runs: which may, and the code that says whether a value may be.

use std::ops::RangeInclusive;

use interfaces::topics::{PARAMETER_CHANGE, SET_PARAMETER};
use interfaces::{ParameterChange, SetParameter, Text};
use serde_json::Value;

use crate::config::{self, Listable, suggestion, suggestion_or};
use crate::{Clock, Node, Publisher, Result, Session, Subscriber, clock};

/// A parameter that may be changed while its node runs.
#[derive(Debug)]
pub struct Tunable {
    /// [-] Dotted, as in the parameter file.
    pub key: &'static str,
    /// What it may be changed to.
    pub to: Choice,
}

/// What a parameter may be changed to.
#[derive(Debug)]
pub enum Choice {
    /// [as the key says] A number. Narrower than what a file may say: whoever types slips more easily.
    Number(RangeInclusive<f64>),
    /// One of these words.
    Word(&'static [&'static str]),
    /// True or false.
    Switch,
}

impl Tunable {
    /// A number that may be anything in `range`.
    pub const fn number(key: &'static str, range: RangeInclusive<f64>) -> Self {
        Self { key, to: Choice::Number(range) }
    }

    /// One of `words`.
    pub const fn word(key: &'static str, words: &'static [&'static str]) -> Self {
        Self { key, to: Choice::Word(words) }
    }

    /// True or false.
    pub const fn switch(key: &'static str) -> Self {
        Self { key, to: Choice::Switch }
    }
}

impl Choice {
    /// What `text` says, or why it may not be that.
    fn judge(&self, text: &str) -> std::result::Result<Value, String> {
        match self {
            Self::Number(range) => {
                let number: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
                let (min, max) = (range.start(), range.end());
                if range.contains(&number) {
                    Ok(number.into())
                } else {
                    Err(format!("is out of range; give {min} to {max}"))
                }
            }
            Self::Word(words) if words.contains(&text) => Ok(text.into()),
            Self::Word(words) => Err(format!("cannot be `{text}`; {}", suggestion(text, words))),
            Self::Switch => match text {
                "true" => Ok(true.into()),
                "false" => Ok(false.into()),
                _ => Err("is a switch; give true or false".to_owned()),
            },
        }
    }
}

/// The wires by which a node's parameters are changed, and what they are by now. In lock-step there are
/// none: the same launch file would not give the same bytes.
#[derive(Debug)]
pub struct Tuning<T> {
    parameters: T,
    tunables: &'static [Tunable],
    wires: Option<(Subscriber<SetParameter>, Publisher<ParameterChange>)>,
}

impl<T: Listable> Tuning<T> {
    pub(crate) fn open(
        session: &Session,
        parameters: T,
        tunables: &'static [Tunable],
    ) -> Result<Self> {
        let wires = match session.clock() {
            Clock::Lockstep => None,
            Clock::Realtime => {
                Some((session.subscriber(&SET_PARAMETER)?, session.publisher(&PARAMETER_CHANGE)?))
            }
        };
        Ok(Self { parameters, tunables, wires })
    }

    /// All parameters as they are from now on, if one was changed. What cannot be is refused, by the
    /// code that judges the parameter file too, and nothing changes. No file is read: what was
    /// written there since has no part in it.
    pub fn take(&mut self, node: &Node<'_>) -> Result<Option<&T>> {
        let Some((requests, answers)) = &mut self.wires else { return Ok(None) };
        let mut is_changed = false;
        while let Some(request) = requests.receive()? {
            let former = config::value(&self.parameters, request.key.as_str());
            let outcome = tuned(&self.parameters, self.tunables, &request);
            answers.send_with(|answer| {
                answer.header.stamp = clock::now();
                answer.request = request.header.sequence;
                answer.former = Text::new(&former.as_ref().map(written).unwrap_or_default());
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

/// As somebody would type it; nothing where there is no value.
fn written(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => number.as_f64().unwrap_or_default().to_string(),
        other => other.to_string(),
    }
}

/// The parameters with the one that is asked for, or why they cannot be.
fn tuned<T: Listable>(
    parameters: &T,
    tunables: &[Tunable],
    request: &SetParameter,
) -> std::result::Result<T, String> {
    let key = request.key.as_str();
    let Some(tunable) = tunables.iter().find(|tunable| tunable.key == key) else {
        let keys: Vec<_> = tunables.iter().map(|tunable| tunable.key).collect();
        let help = suggestion_or(key, &keys, "`teseo param list` says what can");
        return Err(format!("cannot be changed while the node runs; {help}"));
    };
    config::changed(parameters, key, tunable.to.judge(request.value.as_str())?)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_is_typed_becomes_a_value_of_its_kind_or_is_told_what_would() {
        let number = Choice::Number(0.1..=2.0);
        assert_eq!(number.judge("0.5"), Ok(json!(0.5)));
        for (text, why) in [("9", "give 0.1 to 2"), ("nan", "out of range"), ("fast", "no number")]
        {
            assert!(number.judge(text).is_err_and(|told| told.contains(why)), "{text}");
        }
        let word = Choice::Word(&["ideal", "gazebo"]);
        assert_eq!(word.judge("gazebo"), Ok(json!("gazebo")));
        assert!(word.judge("gazbo").is_err_and(|told| told.ends_with("did you mean `gazebo`?")));
        assert_eq!(Choice::Switch.judge("true"), Ok(json!(true)));
        assert!(Choice::Switch.judge("1").is_err_and(|told| told.contains("true or false")));
    }
}

//! What can be asked for at the control socket, and what is wrong where something else is.

use node::config::suggestion;
use node::control::Request;
use serde::Deserialize;
use serde_json::Value;

/// [byte] A longer line is no request.
const LINE_MAX: usize = 64 * 1024;

/// [character] Of what somebody sent, as much as is worth being told back.
const QUOTE_MAX: usize = 160;

/// How each of them is called.
const VERBS: [&str; 9] =
    ["ping", "status", "down", "events", "logs", "restart", "start", "stop", "set"];

/// The line of a request, as far as it has come.
#[derive(Debug, Default)]
pub(super) struct RequestLine(Vec<u8>);

impl RequestLine {
    /// Takes in what has come; returns the request once its line is whole, or what is wrong with it.
    pub(super) fn push(&mut self, bytes: &[u8]) -> Option<Result<Request, String>> {
        let end = bytes.iter().position(|&byte| byte == b'\n');
        let part = &bytes[..end.unwrap_or(bytes.len())];
        if LINE_MAX < self.0.len() + part.len() {
            let limit = LINE_MAX / 1024;
            return Some(Err(format!("the request is longer than {limit} KiB")));
        }
        self.0.extend_from_slice(part);
        end.map(|_| parse(&self.0))
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

fn parse(line: &[u8]) -> Result<Request, String> {
    let value: Value = serde_json::from_slice(line)
        .map_err(|cause| format!("the request is not JSON: {}", quote(&cause.to_string())))?;
    let Some(object) = value.as_object() else {
        return Err("the request is no JSON object, such as {\"verb\":\"status\"}".to_owned());
    };
    let Some(verb) = object.get("verb").and_then(Value::as_str) else {
        return Err(format!("the request has no \"verb\": {}", suggestion("", &VERBS)));
    };
    if !VERBS.contains(&verb) {
        let verb = quote(verb);
        return Err(format!("there is no verb `{verb}`; {}", suggestion(&verb, &VERBS)));
    }
    let request = Request::deserialize(&value)
        .map_err(|cause| format!("{verb}: {}", quote(&cause.to_string())))?;
    // The derived code accepts any field of a verb that has none of its own.
    let known = serde_json::to_value(&request).unwrap_or_default();
    match object.keys().find(|key| known.get(key).is_none()) {
        Some(unknown) => Err(format!("{verb}: unknown field `{}`", quote(unknown))),
        None => Ok(request),
    }
}

/// The beginning, as a terminal can be shown it.
fn quote(text: &str) -> String {
    text.chars().take(QUOTE_MAX).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;
    use node::control::LINES;

    fn parsed(text: &str) -> Result<Request, String> {
        RequestLine::default().push(format!("{text}\n").as_bytes()).unwrap()
    }

    #[test]
    fn what_is_serialized_is_understood() {
        let node = || Some("odometry".to_owned());
        for request in [
            Request::Ping,
            Request::Status,
            Request::Down,
            Request::Events { node: None, follow: false },
            Request::Logs { node: node(), follow: true, lines: 7 },
            Request::Restart { node: "odometry".to_owned() },
            Request::Start { node: "odometry".to_owned() },
            Request::Stop { node: "odometry".to_owned() },
        ] {
            let text = serde_json::to_string(&request).unwrap();
            assert_eq!(parsed(&text), Ok(request), "{text}");
        }
    }

    #[test]
    fn what_is_left_out_has_a_default() {
        let logs = Request::Logs { node: None, follow: false, lines: LINES };

        assert_eq!(parsed(r#"{"verb":"logs"}"#), Ok(logs));
        assert_eq!(
            parsed(r#"{"verb":"events"}"#),
            Ok(Request::Events { node: None, follow: false })
        );
    }

    #[test]
    fn what_is_no_request_is_told_what_is_wrong() {
        for (text, reason) in [
            ("", "not JSON: EOF"),
            ("{", "not JSON: EOF"),
            ("[]", "no JSON object"),
            ("{}", "no \"verb\": allowed: `ping`, `status`"),
            (r#"{"verb":7}"#, "no \"verb\""),
            (r#"{"verb":"destroy"}"#, "there is no verb `destroy`; allowed: `ping`"),
            (r#"{"verb":"statsu"}"#, "did you mean `status`?"),
            (r#"{"verb":"restart"}"#, "restart: missing field `node`"),
            (r#"{"verb":"stop","node":3}"#, "stop: invalid type: integer `3`"),
            (r#"{"verb":"ping","loud":true}"#, "ping: unknown field `loud`"),
            (r#"{"verb":"logs","tail":3}"#, "logs: unknown field `tail`"),
            (r#"{"verb":"logs","lines":-1}"#, "logs: invalid value: integer `-1`"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }

    #[test]
    fn a_line_may_come_in_pieces_and_what_follows_it_is_not_read() {
        let mut line = RequestLine::default();

        assert_eq!(line.push(b"{\"verb\":"), None);
        assert_eq!(line.push(b"\"ping\"}\n{\"verb\":\"down\"}\n"), Some(Ok(Request::Ping)));
    }

    #[test]
    fn a_line_without_end_is_refused_before_it_grows() {
        let mut line = RequestLine::default();
        let outcome = (0..100).find_map(|_| line.push(&[b' '; 1000]));

        assert!(outcome.unwrap().unwrap_err().contains("longer than 64 KiB"));
        assert!(line.0.len() <= LINE_MAX);
    }

    #[test]
    fn a_complaint_is_short_whatever_it_is_about() {
        let long = "x".repeat(60_000);
        for text in [
            format!(r#"{{"verb":"{long}"}}"#),
            format!(r#"{{"verb":"stop","node":["{long}"]}}"#),
            format!(r#"{{"verb":"logs","lines":"{long}"}}"#),
            format!(r#"{{"verb":"ping","{long}":1}}"#),
            "[".repeat(60_000),
        ] {
            let error = parsed(&text).unwrap_err();
            assert!(error.chars().count() < 400, "{error}");
        }
    }

    #[test]
    fn no_bytes_make_the_parser_panic_or_grow() {
        const SEED: u64 = 11;
        const PIECES: [&str; 12] = [
            "{",
            "}",
            "\"verb\"",
            ":",
            "\"logs\"",
            ",",
            "\"lines\"",
            "99999999999999999999",
            "null",
            "\\u0000",
            "\"node\"",
            "\n",
        ];
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        for round in 0..20_000 {
            let mut line = RequestLine::default();
            for _ in 0..random.next_u32() % 24 {
                let piece = if random.next_u32().is_multiple_of(3) {
                    random.next_u64().to_le_bytes().to_vec()
                } else {
                    PIECES[random.next_u32() as usize % PIECES.len()].as_bytes().to_vec()
                };
                if line.push(&piece).is_some() {
                    break;
                }
            }
            assert!(line.0.len() <= LINE_MAX, "SEED={SEED}: round {round}");
        }
    }
}

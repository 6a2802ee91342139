//! Who asks the supervisor for something, and who waits for an answer.

use interfaces::Stamp;
use node::control::Request;
use rustix::event::PollFd;
use serde_json::{Value, json};

use crate::control::{ClientId, Control};
use crate::history::Happening;
use crate::log_book::Line;
use crate::machine::Ask;
use crate::status;
use crate::supervise::Supervisor;
use crate::verdict::Verdict;

/// The control socket and those at it.
pub(crate) struct Desk {
    control: Control,
    waiting: Vec<Waiting>,
}

/// One who gets more than one answer.
struct Waiting {
    client: ClientId,
    wants: Wants,
}

enum Wants {
    /// What happens to a node, or to all.
    Events(Option<usize>),
    /// What a node writes, or all.
    Lines(Option<usize>),
    /// A node to come to where it was asked to; and what happens until then.
    Node { node: usize, goal: Goal },
    /// The end.
    End,
}

/// Where somebody wants a node.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal {
    /// Active, in this life or a later one.
    Active { epoch: u32 },
    /// Down.
    Down,
}

impl Desk {
    pub(crate) fn new(control: Control) -> Self {
        Self { control, waiting: Vec::new() }
    }

    /// What people ask for.
    pub(crate) fn requests(&mut self, now: Stamp) -> Vec<(ClientId, Request)> {
        let requests = self.control.turn(now);
        self.waiting.retain(|waiting| self.control.has(waiting.client));
        requests
    }

    pub(crate) fn fds(&self) -> Vec<PollFd<'_>> {
        self.control.fds()
    }

    pub(crate) fn next_deadline(&self) -> Option<Stamp> {
        self.control.next_deadline()
    }

    /// [-] What came and was no request.
    pub(crate) fn ignored(&self) -> u64 {
        self.control.ignored()
    }

    /// Tells those who follow what has happened.
    pub(crate) fn tell(&mut self, happening: &Happening) {
        for waiting in &self.waiting {
            let concerns = match waiting.wants {
                Wants::Events(node) => node.is_none() || node == happening.node,
                Wants::Node { .. } => true,
                Wants::Lines(_) | Wants::End => false,
            };
            if concerns {
                self.control.reply(waiting.client, &happening.line());
            }
        }
    }

    /// Tells those who follow what a node has written.
    pub(crate) fn tell_line(&mut self, name: &str, line: &Line) {
        for waiting in &self.waiting {
            if let Wants::Lines(node) = waiting.wants
                && node.is_none_or(|node| node == line.node)
            {
                self.control.reply(waiting.client, &written(name, line));
            }
        }
    }

    /// Answers those whose node stands where they want it, with what there is to say of it.
    pub(crate) fn settle(&mut self, stands: impl Fn(usize, Goal) -> Option<Value>) {
        for Waiting { client, wants } in std::mem::take(&mut self.waiting) {
            let answer = match wants {
                Wants::Node { node, goal } => stands(node, goal),
                Wants::Events(_) | Wants::Lines(_) | Wants::End => None,
            };
            match answer {
                Some(answer) => self.answer(client, &answer),
                None => self.waiting.push(Waiting { client, wants }),
            }
        }
    }

    /// Refuses those who wait for a node.
    pub(crate) fn refuse(&mut self, why: &str) {
        for Waiting { client, wants } in std::mem::take(&mut self.waiting) {
            if matches!(wants, Wants::Node { .. }) {
                self.answer(client, &json!({ "error": why }));
            } else {
                self.waiting.push(Waiting { client, wants });
            }
        }
    }

    /// Tells those who wait how the run ended.
    pub(crate) fn end(&mut self, verdict: &Verdict, code: u8) {
        let ended = json!({ "ended": { "code": code, "cause": verdict.cause } });
        let gone = json!({ "error": format!("the robot went down: {}", verdict.cause) });
        for Waiting { client, wants } in std::mem::take(&mut self.waiting) {
            let line = match wants {
                Wants::End => &ended,
                Wants::Node { .. } => &gone,
                Wants::Events(_) | Wants::Lines(_) => {
                    self.control.close(client);
                    continue;
                }
            };
            self.answer(client, line);
        }
        self.control.turn(node::clock::now());
    }

    fn wait(&mut self, client: ClientId, wants: Wants) {
        self.waiting.push(Waiting { client, wants });
    }

    /// The last line for this client.
    pub(crate) fn answer(&mut self, client: ClientId, line: &Value) {
        self.control.reply(client, line);
        self.control.close(client);
    }
}

impl Supervisor<'_> {
    /// Answers a request, now or as it comes; returns what it asks of the machine.
    pub(crate) fn answer(&mut self, client: ClientId, request: Request) -> Option<Ask> {
        match request {
            Request::Ping => self.desk.answer(client, &json!({ "ok": true })),
            Request::Status => {
                let status = status::status(self);
                self.desk.answer(client, &status);
            }
            Request::Down => {
                let line = json!({ "ok": true, "guardian": self.guardian });
                self.desk.control.reply(client, &line);
                self.desk.wait(client, Wants::End);
                return Some(Ask::Down);
            }
            Request::Events { follow, node } => self.answer_events(client, follow, node.as_deref()),
            Request::Logs { node, follow, lines } => {
                self.answer_logs(client, follow, node.as_deref(), lines);
            }
            Request::Restart { node } => {
                let next = |epoch| Goal::Active { epoch: epoch + 1 };
                return self.ask_for_node(client, &node, next, Ask::Restart);
            }
            Request::Start { node } => {
                let any = |epoch| Goal::Active { epoch };
                return self.ask_for_node(client, &node, any, Ask::Start);
            }
            Request::Set { node, key, value } => {
                if let Ok(Some(node)) = self.find(client, Some(&node)) {
                    self.ask_to_set(client, node, &key, &value);
                }
            }
            Request::Stop { node } => {
                return self.ask_for_node(client, &node, |_| Goal::Down, Ask::Stop);
            }
        }
        None
    }

    fn answer_events(&mut self, client: ClientId, follow: bool, node: Option<&str>) {
        let Ok(node) = self.find(client, node) else { return };
        for happening in self.history.of(node) {
            self.desk.control.reply(client, &happening.line());
        }
        if follow {
            self.desk.wait(client, Wants::Events(node));
        } else {
            self.desk.control.close(client);
        }
    }

    fn answer_logs(&mut self, client: ClientId, follow: bool, node: Option<&str>, lines: usize) {
        let Ok(node) = self.find(client, node) else { return };
        for line in self.log_book.last(node, lines) {
            self.desk.control.reply(client, &written(&self.names[line.node], &line));
        }
        if follow {
            self.desk.wait(client, Wants::Lines(node));
        } else {
            self.desk.control.close(client);
        }
    }

    fn ask_for_node(
        &mut self,
        client: ClientId,
        name: &str,
        goal: impl FnOnce(u32) -> Goal,
        ask: impl FnOnce(usize) -> Ask,
    ) -> Option<Ask> {
        let Ok(Some(node)) = self.find(client, Some(name)) else { return None };
        if self.settings.clock() == node::Clock::Lockstep {
            let why = "a robot in lock-step cannot go on without one of its nodes: what is under \
                       way would be lost; run it with --clock realtime";
            self.desk.answer(client, &json!({ "error": why }));
            return None;
        }
        let goal = goal(self.members[node].epoch);
        self.desk.wait(client, Wants::Node { node, goal });
        Some(ask(node))
    }

    /// The node called `name`; where there is none the client has been told.
    fn find(&mut self, client: ClientId, name: Option<&str>) -> Result<Option<usize>, ()> {
        let Some(name) = name else { return Ok(None) };
        if let Some(node) = self.names.iter().position(|known| known == name) {
            return Ok(Some(node));
        }
        let help = node::config::suggestion(name, &self.names);
        self.desk.answer(client, &json!({ "error": format!("there is no node `{name}`; {help}") }));
        Err(())
    }
}

fn written(name: &str, line: &Line) -> Value {
    json!({ "log": {
        "monotonic_s": line.at.seconds(),
        "wall": humantime::format_rfc3339_millis(line.wall).to_string(),
        "node": name,
        "epoch": line.epoch,
        "text": line.text,
    } })
}

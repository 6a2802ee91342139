//! Verbs facing a supervisor that only plays one: the control socket, and made-up answers.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use node::clock;
use node::control::{self, Connection, Heard};
use serde_json::{Value, json};

use super::*;
use crate::control::{ClientId, Control};

static ROBOTS: AtomicU32 = AtomicU32::new(0);

/// How long a supervisor's turn takes here.
const TURN: Duration = Duration::from_millis(1);

/// Runs `body` beside a supervisor that answers as `answer` does.
fn facing(
    mut answer: impl FnMut(&mut Control, ClientId, Request) + Send,
    body: impl FnOnce(&Namespace),
) {
    let number = ROBOTS.fetch_add(1, Ordering::Relaxed);
    let namespace = Namespace::new(&format!("verbs-{}-{number}", std::process::id())).unwrap();
    namespace.create_directory().unwrap();
    let mut control = Control::bind(&namespace.directory().join("control")).unwrap();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                for (client, request) in control.turn(clock::now()) {
                    answer(&mut control, client, request);
                }
                clock::nap(TURN);
            }
        });
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| body(&namespace)));
        is_over.store(true, Ordering::Relaxed);
        namespace.remove();
        outcome.unwrap();
    });
}

fn once(control: &mut Control, client: ClientId, answer: &Value) {
    control.reply(client, answer);
    control.close(client);
}

#[test]
fn a_robot_is_ready_when_it_says_so_under_the_guardian_that_is_meant() {
    let answer = json!({ "state": "ready", "guardian": 7 });
    facing(
        |control, client, _| once(control, client, &answer),
        |namespace| {
            assert!(is_ready(namespace, 7));
            assert!(!is_ready(namespace, 8));
        },
    );
    let absent = Namespace::new("verbs-nobody").unwrap();
    assert!(!is_ready(&absent, 7));
}

#[test]
fn the_exit_code_says_how_the_robot_is() {
    for (state, code) in [("ready", 0), ("degraded", 1)] {
        facing(
            |control, client, _| once(control, client, &json!({ "state": state })),
            |namespace| assert_eq!(status::once(namespace, true).unwrap(), code),
        );
    }
    let absent = Namespace::new("verbs-nobody").unwrap();
    assert_eq!(status::once(&absent, true).unwrap_err().code(), 3);
    assert_eq!(control::find(Some("../x")).unwrap_err().code(), 2);
}

#[test]
fn what_the_supervisor_refuses_ends_with_1() {
    let wait = Duration::from_secs(10);
    facing(
        |control, client, _| once(control, client, &json!({ "error": "there is no node `x`" })),
        |namespace| {
            let failure = steer::steer(namespace, "x", Goal::Stopped, wait).unwrap_err();
            assert!(matches!(&failure, Failure::Refused(why) if why.contains("no node `x`")));
            assert_eq!(failure.code(), 1);
        },
    );
}

#[test]
fn a_node_that_does_not_come_where_it_shall_ends_with_124() {
    facing(
        |control, client, _| control.reply(client, &json!({ "event": { "text": "started" } })),
        |namespace| {
            let wait = Duration::from_millis(30);
            let failure = steer::steer(namespace, "x", Goal::Started, wait).unwrap_err();
            assert_eq!(failure.code(), 124);
        },
    );
}

#[test]
fn down_ends_as_the_run_does() {
    let lines = [
        json!({ "ok": true, "guardian": 0 }),
        json!({ "ended": { "code": 6, "cause": "asked to stop; a node had to be killed" } }),
    ];
    facing(
        |control, client, request| {
            assert_eq!(request, Request::Down);
            for line in &lines {
                control.reply(client, line);
            }
            control.close(client);
        },
        |namespace| {
            let code = down::down(Some(namespace.robot()), Duration::from_secs(10));
            assert_eq!(code.unwrap(), 6);
        },
    );
    assert_eq!(down::down(Some("verbs-nobody"), Duration::ZERO).unwrap(), 0);
}

#[test]
fn an_answer_longer_than_any_buffer_arrives_whole() {
    let text = "x".repeat(1_000);
    facing(
        |control, client, _| {
            (0..2_000).for_each(|_| control.reply(client, &json!({ "log": { "text": text } })));
            control.close(client);
        },
        |namespace| {
            let request = Request::Logs { node: None, follow: false, lines: 2_000 };
            let mut connection = Connection::open(namespace, &request).unwrap();
            let mut lines = 0;
            while let Heard::Line(line) = connection.hear(None).unwrap() {
                assert!(text.len() < line.len());
                lines += 1;
            }
            assert_eq!(lines, 2_000);
        },
    );
}

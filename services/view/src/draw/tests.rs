use std::time::Duration;

use interfaces::{Header, LaserScan, NodeStatus, Odometry, Text, Value};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyCode, KeyEvent};
use serde_json::json;

use super::*;
use crate::keys::Action;
use crate::map::{Map, Pose};

const SECOND: interfaces::Stamp = interfaces::Stamp { nanoseconds: 1_000_000_000 };

/// A room of two by two metres, a robot in it that has driven half a metre, and what it is made of.
fn state() -> State {
    let mut state = State::new("burger");
    let node = |name: &str, state: &str, pid: Option<u32>| {
        json!({ "name": name, "state": state, "doing": "running", "pid": pid, "epoch": 2,
            "uptime_s": 61.0, "restarts": 1, "text": "", "topics": [] })
    };
    let pid = Some(u32::MAX);
    state.hear_status(
        SECOND,
        &json!({ "state": "ready", "clock": "realtime", "uptime_s": 61.0,
            "motion": { "permission": "armed", "cause": "none", "needs_person": false },
            "nodes": [node("pairing", "active", pid), node("controller", "inactive", None)] }),
    );
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let walls = (0..4).map(|side| [corners[side], corners[(side + 1) % 4]]).collect();
    state.set_map(Some(Map { walls, start: Pose { x: -0.5, y: 0.0, yaw: 0.0 } }));
    state.hear_node("pairing", &status(&[("pairs", 12.0), ("scan_too_old", 3.0)]));
    let ages = [("p50", 300.0), ("p99", 1_500.0), ("max", 2_500.0)];
    let ages = ages.map(|(name, us)| (format!("scan_to_command_{name}_us"), us));
    state.hear_node("controller", &status(&ages));
    let header = Header { epoch: 1, stamp: SECOND, ..Header::default() };
    let mut scan = LaserScan { header, length: 1, ..LaserScan::default() };
    (scan.range_max, scan.range[0]) = (3.5, 0.5);
    state.hear_scan(&scan);
    state.hear_sample(SECOND, "scan", &scan.header);
    for step in 0..=5_u64 {
        let stamp = SECOND.before(Duration::from_millis(500 - 100 * step));
        let header = Header { sequence: step, stamp, ..header };
        let x = 0.1 * step as f64;
        state.hear_odometry(&Odometry { header, x, linear: 0.2, ..Odometry::default() });
    }
    state.hear_event(&json!({ "wall": "2026-11-25T12:01:07.412Z", "node": "controller",
        "kind": "failed", "text": "failed: was killed by signal 9" }));
    state.settle(SECOND);
    state
}

fn status(figures: &[(impl AsRef<str>, f64)]) -> NodeStatus {
    let mut status = NodeStatus::default();
    for (slot, (key, value)) in status.value.iter_mut().zip(figures) {
        *slot = Value { key: Text::new(key.as_ref()), value: *value };
        status.value_count += 1;
    }
    status
}

fn drawn(width: u16, height: u16, desk: &Desk, look: Look) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, &state(), desk, look)).unwrap();
    terminal.backend().to_string()
}

fn assert_shows(screen: &str, texts: &[&str]) {
    for text in texts {
        assert!(screen.contains(text), "it does not show '{text}':\n{screen}");
    }
}

/// What stands on every screen that is large enough.
const ALWAYS: [&str; 11] = [
    " teseo  burger · ready · real time · up 1:01 min · armed · 0.20 m/s 0.00 rad/s",
    "map  x 0.00 y 0.00 m 0 deg",
    "controller",
    "inactive",
    "scan ",
    "pairs 12",
    "scan too old",
    "p50 0.30  p99 1.50",
    "12:01:07",
    "q quit",
    "e stop",
];

#[test]
fn the_smallest_screen_has_everything() {
    let screen = drawn(80, 24, &Desk::default(), Look::default());

    assert_shows(&screen, &ALWAYS);
    assert_shows(&screen, &["12:01:07 controller killed by"]);
    assert_eq!(screen.lines().count(), 24);
}

#[test]
fn a_large_screen_has_more_of_it() {
    let screen = drawn(160, 50, &Desk::default(), Look::default());

    assert_shows(&screen, &ALWAYS);
    assert_shows(
        &screen,
        &["pid", "readers", "max 2.50", "6events", "controller failed: was killed"],
    );
}

#[test]
fn every_size_in_between_is_drawn_and_every_panel() {
    for panel in Panel::ALL {
        let desk = Desk { panel, ..Desk::default() };
        for (width, height) in [(80, 24), (81, 60), (120, 30), (300, 24), (80, 100), (500, 200)] {
            let screen = drawn(width, height, &desk, Look::default());
            assert!(screen.contains("burger") && screen.contains("q quit"), "{panel:?} {width}");
        }
    }
}

#[test]
fn a_terminal_too_small_is_told_what_it_needs() {
    let screen = drawn(60, 20, &Desk::default(), Look::default());
    assert_shows(&screen, &["needs 80x24, has 60x20; q quits"]);
    for (width, height) in [(1, 1), (79, 24), (80, 23)] {
        drawn(width, height, &Desk::default(), Look::default());
    }
}

#[test]
fn ascii_is_nothing_else_and_plain_has_no_colours() {
    let look = Look { ascii: true, plain: true };
    for panel in Panel::ALL {
        let mut terminal = Terminal::new(TestBackend::new(100, 30)).unwrap();
        let desk = Desk { panel, ..Desk::default() };
        terminal.draw(|frame| draw(frame, &state(), &desk, look)).unwrap();
        let buffer = terminal.backend().buffer();
        for cell in &buffer.content {
            assert!(cell.symbol().is_ascii(), "{panel:?}: {}", cell.symbol());
            assert_eq!((cell.fg, cell.bg), (Color::Reset, Color::Reset), "{panel:?}");
        }
    }
}

#[test]
fn the_robot_its_trail_and_what_it_sees_are_where_they_are() {
    let look = Look { ascii: true, plain: true };
    let screen = drawn(80, 24, &Desk { panel: Panel::Map, ..Desk::default() }, look);
    let rows: Vec<_> = screen.lines().collect();
    let middle = rows.iter().find(|row| row.contains('>')).expect("no robot");
    let at = |what: char| middle.find(what);

    assert!(at('#') < at('.') && at('.') < at('>') && at('>') < at('*'), "{middle}");
    assert!(middle.rfind('*') < middle.rfind('#'), "{middle}");
}

#[test]
fn a_node_is_restarted_by_the_second_key_and_by_no_other() {
    let (state, mut desk) = (state(), Desk::default());
    let mut press = |key: char| desk.press(KeyEvent::from(KeyCode::Char(key)), &state);

    assert_eq!([press('r'), press('n'), press('r')], [None, None, None]);
    assert_eq!(press('r'), Some(Action::Restart("controller".to_owned())));
    assert_eq!(press('r'), None, "once");
    assert_eq!(press('q'), Some(Action::Quit));
}

//! The bench: what it says of itself, that it counts everything, and what it refuses to say.

use serde_json::{Value, json};

use crate::robot::Robot;

/// [-] Rounds of a quick look, and what each of them counts in a polled and in a sleeping way.
const ROUNDS: u64 = 2;
const POLLED: u64 = 1_000;
const SLEEPING: u64 = 40;

#[test]
fn the_card_is_whole_and_every_value_is_counted() {
    let robot = Robot::new();
    let ended =
        robot.start(&["bench", "hop", "--quick", "--only=a scan, one core", "--json"]).wait();
    ended.assert_code(0);
    let book: Value = serde_json::from_str(&ended.out).unwrap();
    for key in ["cpu", "governor", "kernel", "clock_source", "teseo", "iceoryx2", "rustc"] {
        let said = book["card"][key].as_str().unwrap_or_default();
        assert!(!said.is_empty(), "the card has no {key}\n{}", book["card"]);
    }
    for key in ["cores", "load_before", "load_after", "foreign", "steal"] {
        assert!(book["card"][key].is_number(), "the card has no {key}\n{}", book["card"]);
    }
    let figures = book["figures"].as_array().unwrap();
    assert!(7 < figures.len(), "{}", ended.story());
    for figure in figures {
        let name = figure["name"].as_str().unwrap();
        if name.contains("readers") {
            continue;
        }
        let samples = if name.contains("yield") { POLLED } else { SLEEPING };
        assert_eq!(figure["count"], ROUNDS * samples, "{figure}");
        let rounds = figure["rounds"].as_array().unwrap().iter();
        assert!(rounds.clone().all(|round| round["count"] == samples), "{figure}");
        let value = |key: &str| figure[key].as_f64().unwrap();
        let ladder = ["p50", "p90", "p99", "p999", "max"].map(value);
        assert!(0.0 < ladder[0] && ladder.is_sorted(), "{figure}");
    }
}

#[test]
fn a_whole_robot_is_measured_and_nothing_of_it_is_left() {
    let robot = Robot::new();
    let only = "--only=block, any core, 100 Hz";
    let ended = robot.start(&["bench", "loop", "--quick", only, "--csv"]).wait();
    ended
        .assert_code(0)
        .assert_says(&["loop,\"scan to wheel, block, any core, 100 Hz\",nanoseconds"]);
}

#[test]
fn the_bridge_is_measured_before_an_emulated_robot_and_nothing_of_either_is_left() {
    let robot = Robot::new();
    let ended = robot.start(&["bench", "bridge", "--quick", "--only=lds-02", "--csv"]).wait();
    ended.assert_code(0).assert_says(&[
        "bridge,\"command heard to bytes written, lds-02\",nanoseconds",
        "bridge,\"the bridge, share of a core, lds-02\",percent_of_a_core",
    ]);
}

#[test]
fn the_same_loop_runs_in_one_process_with_other_beams_walls_and_robots() {
    let robot = Robot::new();
    let ended =
        robot.start(&["bench", "lockstep", "--quick", "--only=one process", "--csv"]).wait();
    ended.assert_code(0).assert_says(&[
        "\"steps a second, one process, 240 beams\"",
        "\"steps a second, one process, 1440 beams\"",
        "\"steps a second, one process, 240 beams, 100000 more walls\"",
        "\"steps a second, one process, 240 beams, 16 robots in one world\"",
    ]);
}

#[test]
fn what_was_not_measured_is_told() {
    let robot = Robot::new();
    let ended = robot.start(&["bench", "hop", "--quick", "--only=nobody"]).wait();
    ended.assert_code(1).assert_says(&["nothing that is measured is called 'nobody'"]);
}

#[test]
fn a_run_does_not_differ_from_itself() {
    let robot = Robot::new();
    let file = robot.file("new.json", &book(1.0, false).to_string());
    let ended = robot.start(&["bench", "--from", &file, "--compare", &file]).wait();
    ended.assert_code(0).assert_says(&["no difference can be told"]);
}

#[test]
fn a_run_that_takes_twice_as_long_is_slower() {
    let robot = Robot::new();
    let new = robot.file("new.json", &book(1.0, false).to_string());
    let old = robot.file("old.json", &book(0.5, false).to_string());
    let slower = robot.start(&["bench", "--from", &new, "--compare", &old]).wait();
    slower.assert_code(0).assert_says(&["x 2.00  slower", "0 better, 2 worse"]);
    let faster = robot.start(&["bench", "--from", &old, "--compare", &new]).wait();
    faster.assert_code(0).assert_says(&["x 0.50  faster", "2 better, 0 worse"]);
}

#[test]
fn a_machine_that_was_too_busy_has_no_headline_and_no_verdict() {
    let robot = Robot::new();
    let busy = robot.file("busy.json", &book(1.0, true).to_string());
    let old = robot.file("old.json", &book(0.5, false).to_string());
    let ended = robot.start(&["bench", "--from", &busy, "--compare", &old]).wait();
    ended.assert_code(0).assert_says(&["too busy to say", "0 better, 0 worse"]);
    let believed = ["bench", "--from", &busy, "--contaminated-max=1"];
    let ended = robot.start(&believed).wait();
    ended.assert_code(0).assert_says(&["reached"]);
    assert!(!ended.out.contains("too busy"), "{}", ended.story());
}

/// A run of five rounds in which everything took `factor` times as long as usual.
fn book(factor: f64, contaminated: bool) -> Value {
    let others = json!({ "foreign": 0.0, "steal": 0.0, "contaminated": contaminated });
    let figure = |name: &str, usual: f64| {
        let rounds = [1.0, 1.01, 0.99, 1.02, 0.98].map(
            |noise| json!({ "value": usual * factor * noise, "count": 100, "others": others }),
        );
        json!({
            "row": "hop", "name": format!("{name}, 64 B, one core, back to back"),
            "unit": "nanoseconds", "count": 500, "p50": usual * factor, "p90": null, "p99": null,
            "p999": null, "max": 2.0 * usual * factor, "rounds": rounds,
        })
    };
    json!({
        "version": 1,
        "card": {
            "cpu": "a processor", "cores": 2, "governor": "unknown", "kernel": "6", "clock_source": "tsc",
            "virtual_machine": false, "load_before": 0.1, "load_after": 0.2, "foreign": 0.0,
            "steal": 0.0, "teseo": "0", "iceoryx2": "0", "rustc": "0",
        },
        "figures": [figure("teseo yield", 1000.0), figure("futex", 950.0)],
        "absent": [],
        "headline": { "refused": null, "ratios": [] },
    })
}

//! Files over defaults, and the command line over files.

use serde::Deserialize;

use super::super::{Layers, Parameters, Setting, Table};
use super::{Config, Drive, Limit, Wheel, layer, set, told};

#[test]
fn later_layers_win_key_by_key() {
    #[derive(Default, Deserialize)]
    #[serde(default)]
    struct Launch {
        parameters: Table,
    }
    impl Parameters for Launch {}

    let launch: Launch =
        layer("parameters = { seed = 3, drive.period_ms = 30, gains = [3] }").parse().unwrap();
    let parse = |settings: &[&str]| -> Config {
        layer("seed = 2\nretries = 2\ndrive = { period_ms = 20, wheel.radius = 2 }\ngains = [2, 2]")
            .table(&launch.parameters)
            .settings(&set(settings))
            .parse()
            .unwrap()
    };

    let config = parse(&["seed=4", "drive.wheel.radius=4"]);
    assert_eq!(config.seed, 4);
    assert_eq!(config.retries, 2);
    assert_eq!(config.drive, Drive { period_ms: 30, wheel: Wheel { radius: 4.0 } });
    assert_eq!(config.gains, [3.0]);
    assert_eq!(parse(&["seed=4", "seed=5"]).seed, 5);
    assert_eq!(parse(&[]).seed, 3);
}

#[test]
fn a_mistake_in_a_layer_below_does_not_matter_once_it_is_overridden() {
    let config: Config = layer("seed = 'x'").settings(&set(&["seed=4"])).parse().unwrap();

    assert_eq!(config.seed, 4);
}

#[test]
fn a_setting_is_a_toml_value_or_else_a_string() {
    let cases = [
        ("proportional_gain=2", Config { proportional_gain: 2.0, ..Config::default() }),
        ("name=inner corridor", Config { name: "inner corridor".to_owned(), ..Config::default() }),
        ("name=\"3\"", Config { name: "3".to_owned(), ..Config::default() }),
        ("name=a=b", Config { name: "a=b".to_owned(), ..Config::default() }),
        ("name=", Config { name: String::new(), ..Config::default() }),
        ("name=2024-01-01", Config { name: "2024-01-01".to_owned(), ..Config::default() }),
        ("limit=off", Config { limit: Limit::Off, ..Config::default() }),
        ("gains=[1, 2]", Config { gains: vec![1.0, 2.0], ..Config::default() }),
        ("enabled = false", Config { enabled: false, ..Config::default() }),
        (
            "drive.wheel={radius=2}",
            Config {
                drive: Drive { wheel: Wheel { radius: 2.0 }, ..Drive::default() },
                ..Config::default()
            },
        ),
    ];
    for (text, expected) in cases {
        let parsed = Layers::new().settings(&set(&[text])).parse::<Config>();
        assert_eq!(parsed, Ok(expected), "{text}");
    }
}

#[test]
fn a_mistake_in_a_setting_is_told_as_typed() {
    let cases = [
        ("drive.perod_ms=2", "drive.perod_ms | unknown key | did you mean `period_ms`?"),
        ("drive=2", "drive | expected a table, found 2 | write a table, such as `{ key = … }`"),
        (
            "seed=x",
            "seed | expected a whole number, 0 or more, found the string \"x\" | write a whole number, 0 or more, such as `3`",
        ),
        ("drive.period_ms=0", "drive.period_ms | must not be zero | such as 50"),
        (
            "seed=[1,",
            "seed | expected a whole number, 0 or more, found the string \"[1,\" | write a whole number, 0 or more, such as `3`",
        ),
        (
            "gains=[1, nan]",
            "gains[1] | expected a finite number, found nan | write a finite number, such as `1.5`",
        ),
    ];
    for (text, expected) in cases {
        let parsed = layer("[drive]\nperiod_ms = 3").settings(&set(&[text])).parse::<Config>();
        assert_eq!(told(parsed), [format!("--set {text} | {expected}")]);
    }
}

#[test]
fn an_unknown_key_is_told_where_it_was_written_last() {
    let parsed = layer("sed = 1").settings(&set(&["sed=2"])).parse::<Config>();

    assert_eq!(told(parsed), ["--set sed=2 | sed | unknown key | did you mean `seed`?"]);
}

#[test]
fn what_is_no_setting_is_refused() {
    let deep = ["a"; 100].join(".") + "=1";
    for text in ["", "a", "=1", "a..b=1", ".a=1", "a b=1", "a#b=1", "[a]\nb=1", deep.as_str()] {
        let parsed = text.parse::<Setting>();
        assert_eq!(parsed.unwrap_err().message, "not a setting", "{text:?}");
    }
}

#[test]
fn a_setting_is_meant_for_the_process_it_begins_with() {
    let setting: Setting = "controller.drive.period_ms=x".parse().unwrap();
    assert_eq!(setting.scope(), "controller");
    assert!(setting.within("odometry").is_none());

    let parsed = Layers::new().settings(&setting.within("controller")).parse::<Config>();
    assert_eq!(
        told(parsed),
        [
            "--set controller.drive.period_ms=x | controller.drive.period_ms | expected a whole number, 0 or more, \
          found the string \"x\" | write a whole number, 0 or more, such as `3`"
        ]
    );
    assert_eq!(
        setting.unknown(&["simulator", "controler"]).to_string(),
        "error: `controller`: unknown key\n  --> --set controller.drive.period_ms=x\n  = help: did you mean `controler`?"
    );
}

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{Error, Errors, FileName, Layers, Parameters, Place, Report, Setting, Table};

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    proportional_gain: f64,
    speed_max_m_s: f32,
    seed: u64,
    retries: u8,
    offset: i32,
    name: String,
    label: Option<String>,
    enabled: bool,
    limit: Limit,
    drive: Drive,
    gains: Vec<f64>,
    pose: [f64; 3],
    boxes: Vec<Box>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            proportional_gain: 1.0,
            speed_max_m_s: 0.22,
            seed: 1,
            retries: 3,
            offset: 0,
            name: "lab".to_owned(),
            label: None,
            enabled: true,
            limit: Limit::Hold,
            drive: Drive::default(),
            gains: vec![1.0],
            pose: [0.0; 3],
            boxes: Vec::new(),
        }
    }
}

impl Parameters for Config {
    fn check(&self, report: &mut Report<'_>) {
        if self.proportional_gain <= 0.0 {
            report.refuse("proportional_gain", "must be positive", "such as 2.0");
        }
        self.drive.check(&mut report.within("drive"));
        for (index, part) in self.boxes.iter().enumerate() {
            if part.width <= 0.0 {
                report.refuse(format!("boxes[{index}].width"), "must be positive", "such as 0.2");
            }
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Limit {
    Hold,
    ScaleDown,
    Off,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Drive {
    period_ms: u64,
    wheel: Wheel,
}

impl Default for Drive {
    fn default() -> Self {
        Self { period_ms: 50, wheel: Wheel::default() }
    }
}

impl Drive {
    fn check(&self, report: &mut Report<'_>) {
        if self.period_ms == 0 {
            report.refuse("period_ms", "must not be zero", "such as 50");
        }
    }
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Wheel {
    radius: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Box {
    width: f64,
    height: f64,
    name: Name,
}

/// A type of its own that not every string pleases.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "String")]
struct Name(String);

impl TryFrom<String> for Name {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        if text.is_empty() { Err("a name cannot be empty; write one") } else { Ok(Self(text)) }
    }
}

fn layer(text: impl AsRef<[u8]>) -> Layers {
    Layers::new().bytes(Path::new("a.toml"), text.as_ref().to_owned())
}

fn set(texts: &[&str]) -> Vec<Setting> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

/// One line per error.
fn told<T>(parsed: Result<T, Errors>) -> Vec<String> {
    let errors = parsed.err().unwrap_or_default();
    errors
        .iter()
        .map(|Error { place, key, message, help, .. }| {
            format!("{place} | {key} | {message} | {help}")
        })
        .collect()
}

fn refusals(text: impl AsRef<[u8]>) -> Vec<String> {
    told(layer(text).parse::<Config>())
}

/// Each text has one mistake, at this line and column, with this key, message and help.
fn refuses(cases: &[(&str, &str)]) {
    for (text, expected) in cases {
        assert_eq!(refusals(text), [format!("a.toml:{expected}")], "{text}");
    }
}

/// A directory of a test's own, gone when the test is.
struct Directory(PathBuf);

impl Directory {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("teseo-{}-{name}", std::process::id()));
        fs::create_dir_all(path.join("worlds")).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.join(name);
        fs::write(&path, text).unwrap();
        path
    }

    /// What is told, as if the test ran inside.
    fn told<T>(&self, parsed: Result<T, Errors>) -> Vec<String> {
        let inside = format!("{}/", self.0.display());
        let outside = self.0.display().to_string();
        told(parsed).iter().map(|line| line.replace(&inside, "").replace(&outside, ".")).collect()
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn an_empty_file_or_no_file_leaves_the_defaults() {
    assert_eq!(Layers::new().parse(), Ok(Config::default()));
    for text in ["", "\n", "\u{feff}", "# nothing\r\n"] {
        assert_eq!(layer(text).parse(), Ok(Config::default()), "{text:?}");
    }
}

#[test]
fn every_type_is_read() {
    let text = r#"
        proportional_gain = 2
        speed_max_m_s = 0.5
        seed = 0xffff_ffff_ffff_ffff
        offset = -7
        name = "Grüße"
        label = '2024'
        enabled = false
        limit = "scale-down"
        gains = [1, 2.5]
        pose = [1, 2, 3]
        drive.wheel.radius = 0.033

        [[boxes]]
        width = 1
        height = 2.0
        name = "first"

        [[boxes]]
        width = 3
        height = 4
        name = "second"
    "#;
    let boxed = |width, height, name: &str| Box { width, height, name: Name(name.to_owned()) };

    assert_eq!(
        layer(text).parse(),
        Ok(Config {
            proportional_gain: 2.0,
            speed_max_m_s: 0.5,
            seed: u64::MAX,
            retries: 3,
            offset: -7,
            name: "Grüße".to_owned(),
            label: Some("2024".to_owned()),
            enabled: false,
            limit: Limit::ScaleDown,
            drive: Drive { period_ms: 50, wheel: Wheel { radius: 0.033 } },
            gains: vec![1.0, 2.5],
            pose: [1.0, 2.0, 3.0],
            boxes: vec![boxed(1.0, 2.0, "first"), boxed(3.0, 4.0, "second")],
        })
    );
}

#[test]
fn an_unknown_word_is_told_with_the_one_that_was_meant() {
    refuses(&[
        (
            "proportional_gian = 2",
            "1:1 | proportional_gian | unknown key | did you mean `proportional_gain`?",
        ),
        ("speed_max = 2", "1:1 | speed_max | unknown key | did you mean `speed_max_m_s`?"),
        ("drive.perod_ms = 2", "1:7 | drive.perod_ms | unknown key | did you mean `period_ms`?"),
        ("[drive]\nzzz = 2", "2:1 | drive.zzz | unknown key | allowed: `period_ms`, `wheel`"),
        ("[drivee.wheel]\nradius = 1", "1:2 | drivee | unknown key | did you mean `drive`?"),
        (
            "drive.wheel.\"rad.ius\" = 1",
            "1:13 | drive.wheel.\"rad.ius\" | unknown key | did you mean `radius`?",
        ),
        ("limit = 'hodl'", "1:9 | limit | unknown value \"hodl\" | did you mean `hold`?"),
        (
            "limit = 'zzz'",
            "1:9 | limit | unknown value \"zzz\" | allowed: `hold`, `scale-down`, `off`",
        ),
    ]);
}

#[test]
fn a_value_of_the_wrong_type_is_told_with_the_right_one() {
    refuses(&[
        (
            "proportional_gain = \"fast\"",
            "1:21 | proportional_gain | expected a number, found the string \"fast\" | write a number, such as `1.5`",
        ),
        (
            "proportional_gain = '2.5'",
            "1:21 | proportional_gain | expected a number, found the string \"2.5\" | write it without quotes: `2.5`",
        ),
        (
            "proportional_gain = 'nan'",
            "1:21 | proportional_gain | expected a number, found the string \"nan\" | write a number, such as `1.5`",
        ),
        (
            "proportional_gain = [1]",
            "1:21 | proportional_gain | expected a number, found an array | write a number, such as `1.5`",
        ),
        ("name = 3", "1:8 | name | expected a string, found 3 | write it in quotes: `\"3\"`"),
        (
            "label = true",
            "1:9 | label | expected a string, found true | write it in quotes: `\"true\"`",
        ),
        (
            "gains = '0123456789012345678901234567890123456789012345678901234567890'",
            "1:9 | gains | expected an array, found a long string | write an array, such as `[…]`",
        ),
        (
            "enabled = 'yes'",
            "1:11 | enabled | expected true or false, found the string \"yes\" | write true or false, such as `true`",
        ),
        (
            "limit = true",
            "1:9 | limit | expected a name in quotes, found true | allowed: `hold`, `scale-down`, `off`",
        ),
        ("gains = 1", "1:9 | gains | expected an array, found 1 | write an array, such as `[…]`"),
        (
            "pose = [1, 2]",
            "1:8 | pose | expected an array of 3 values, found 2 | write 3 values in brackets",
        ),
        (
            "pose = 1",
            "1:8 | pose | expected an array of 3 values, found 1 | write 3 values in brackets",
        ),
        (
            "drive = 3",
            "1:9 | drive | expected a table, found 3 | write a table, such as `{ key = … }`",
        ),
        (
            "drive = [3, 4]",
            "1:9 | drive | expected a table, found an array | write a table, such as `{ key = … }`",
        ),
    ]);
}

#[test]
fn a_number_out_of_range_is_told_with_the_range() {
    refuses(&[
        (
            "proportional_gain = nan",
            "1:21 | proportional_gain | expected a finite number, found nan | write a finite number, such as `1.5`",
        ),
        (
            "proportional_gain = -inf",
            "1:21 | proportional_gain | expected a finite number, found -inf | write a finite number, such as `1.5`",
        ),
        (
            "gains = [1, 1e400]",
            "1:13 | gains[1] | expected a finite number, found inf | write a finite number, such as `1.5`",
        ),
        (
            "speed_max_m_s = 1e39",
            "1:17 | speed_max_m_s | expected a number below 3.4e38, found 1e39 | write a number below 3.4e38",
        ),
        (
            "seed = -1",
            "1:8 | seed | expected a whole number, 0 or more, found -1 | write a whole number, 0 or more, such as `3`",
        ),
        (
            "seed = 1.0",
            "1:8 | seed | expected a whole number, 0 or more, found 1.0 | write a whole number, 0 or more, such as `3`",
        ),
        (
            "retries = 256",
            "1:11 | retries | expected a whole number from 0 to 255, found 256 | write a whole number from 0 to 255, such as `3`",
        ),
        (
            "offset = 99999999999999999999999999999999999999999",
            "1:10 | offset | expected a whole number from -2147483648 to 2147483647, found 1e41 | write a whole number from -2147483648 to 2147483647, such as `3`",
        ),
    ]);
}

#[test]
fn a_value_that_is_missing_or_makes_no_sense_is_told() {
    refuses(&[
        (
            "boxes = [{ width = 1, name = 'a' }]",
            "1:10 | boxes[0].height | missing key | add `height = …`",
        ),
        (
            "boxes = [{ width = 1, height = 1, name = '' }]",
            "1:42 | boxes[0].name | a name cannot be empty | write one",
        ),
        ("proportional_gain = -2", "1:21 | proportional_gain | must be positive | such as 2.0"),
        ("drive.period_ms = 0", "1:19 | drive.period_ms | must not be zero | such as 50"),
    ]);
}

#[test]
fn syntax_errors_are_told_with_their_place_and_their_mending() {
    let cases = [
        (
            "seed = 1\nseed = 2",
            "2:1 | seed | duplicate key | remove it here or where it was first written",
        ),
        (
            "[drive]\n[drive]",
            "2:2 | drive | duplicate key | remove it here or where it was first written",
        ),
        ("seed =", "1:7 |  | a value is missing | write a value after `=`"),
        ("limit = hold", "1:9 |  | string values must be quoted | write it in quotes: \"hold\""),
        (
            "seed = 1__0",
            "1:9 |  | `_` may only go between digits | remove what does not belong here",
        ),
        ("name = \"lab\nseed = 1", "1:12 |  | invalid basic string | expected `\"`"),
        ("gains = [1\nseed = 1", "2:1 |  | missing comma between array elements | expected `,`"),
        (
            "gains = [1\nseed = 1\nretries = 2",
            "2:1 |  | missing comma between array elements | expected `,`",
        ),
        (
            "offset = 1 seed = 2",
            "1:10 |  | string values must be quoted | write it in quotes: \"1 seed\"",
        ),
        ("[drive", "1:7 |  | unclosed table | expected `]`"),
    ];
    refuses(&cases);
}

#[test]
fn all_mistakes_of_all_kinds_are_told_at_once_in_the_order_of_the_file() {
    let text = "\
seed = 1
seed = 2
proportional_gain = 'fast'
limit = 'hodl'
gains = ['a', 1, nan]
pose = [1, true, 'x']
unknown = 1

[drive]
period_ms = 0
wheel = { radus = 1, radius = inf }

[[boxes]]
height = true

[[boxes]]
width = -1
height = 1
name = ''
";
    let keys: Vec<_> = layer(text)
        .settings(&set(&["retries=-1", "offset=-1"]))
        .parse::<Config>()
        .unwrap_err()
        .into_iter()
        .map(|error| error.key)
        .collect();

    assert_eq!(
        keys,
        [
            "seed",
            "proportional_gain",
            "limit",
            "gains[0]",
            "gains[2]",
            "pose[1]",
            "pose[2]",
            "unknown",
            "drive.period_ms",
            "drive.wheel.radus",
            "drive.wheel.radius",
            "boxes[0].name",
            "boxes[0].width",
            "boxes[0].height",
            "boxes[1].name",
            "retries",
        ]
    );
}

#[test]
fn a_missing_key_of_any_type_does_not_hide_the_others() {
    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only what is missing matters")]
    struct Needy {
        boolean: bool,
        small: i8,
        large: u64,
        short: f32,
        long: f64,
        text: String,
        list: Vec<f64>,
        pose: [f64; 3],
        limit: Limit,
        boxed: Inner,
        table: Table,
        file: FileName,
        map: std::collections::BTreeMap<String, f64>,
        last: u8,
    }
    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "only what is missing matters")]
    struct Inner {
        width: f64,
    }
    impl Parameters for Needy {}

    let missing = layer("large = true").parse::<Needy>().unwrap_err();
    let mut keys: Vec<_> = missing.iter().map(|error| error.key.as_str()).collect();
    keys.sort_unstable();
    assert_eq!(
        keys,
        [
            "boolean", "boxed", "file", "large", "last", "limit", "list", "long", "map", "pose",
            "short", "small", "table", "text"
        ]
    );
}

#[test]
fn elements_behind_one_that_is_left_out_keep_their_index() {
    let told = refusals(
        "boxes = [\n{ width = 1, height = 1 },\n{ width = 1, height = 1, name = 'a' },\n\
         { width = -1, height = 1, name = 'b' },\n]",
    );

    assert_eq!(
        told,
        [
            "a.toml:2:1 | boxes[0].name | missing key | add `name = …`",
            "a.toml:4:11 | boxes[2].width | must be positive | such as 0.2",
        ]
    );
}

#[test]
fn a_column_counts_characters_and_no_byte_order_mark() {
    refuses(&[
        (
            "drive = { \"größe\" = { a = 1 } }",
            "1:11 | drive.\"größe\" | unknown key | allowed: `period_ms`, `wheel`",
        ),
        (
            "gains = ['größe', 1]  # é",
            "1:10 | gains[0] | expected a number, found the string \"größe\" | write a number, such as `1.5`",
        ),
        ("name = 'größe' ; x", "1:16 |  | unexpected key or value | expected newline, `#`"),
        ("\u{feff}sed = 1", "1:1 | sed | unknown key | did you mean `seed`?"),
        ("\r\n\r\nsed = 1\r\n", "3:1 | sed | unknown key | did you mean `seed`?"),
    ]);
}

#[test]
fn a_mistake_is_shown_in_its_line() {
    let shown = layer("[drive]\r\n\t\"größe\" = 'viel'\r\nperiod_ms = 'Grüße'\r\n")
        .settings(&set(&["gains=[1,'two']"]))
        .parse::<Config>()
        .unwrap_err()
        .to_string();

    let expected = "\
error: `drive.\"größe\"`: unknown key
  --> a.toml:2:2
  |
2 |  \"größe\" = 'viel'
  |  ^^^^^^^
  = help: allowed: `period_ms`, `wheel`

error: `drive.period_ms`: expected a whole number, 0 or more, found the string \"Grüße\"
  --> a.toml:3:13
  |
3 | period_ms = 'Grüße'
  |             ^^^^^^^
  = help: write a whole number, 0 or more, such as `3`

error: `gains[1]`: expected a number, found the string \"two\"
  --> --set gains=[1,'two']
  = help: write a number, such as `1.5`

3 errors";
    assert_eq!(shown, expected);
}

#[test]
fn a_long_line_is_cut_around_the_mistake() {
    let text = format!("gains = [{}'x', {}]", "1.0, ".repeat(100), "2.0, ".repeat(100));
    let shown = layer(text).parse::<Config>().unwrap_err().to_string();

    let mut lines = shown.lines().skip(3);
    let line = lines.next().unwrap();
    let marks = lines.next().unwrap();
    assert!(line.len() <= 100, "{line}");
    assert_eq!(line.find("'x'"), marks.find("^^^"), "{shown}");
}

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

#[test]
fn a_captured_table_keeps_its_places_and_is_read_by_someone_else() {
    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Launch {
        process: Vec<Process>,
    }
    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Process {
        name: String,
        #[serde(default)]
        after: Vec<String>,
        parameters: Option<Table>,
    }
    impl Parameters for Launch {
        fn check(&self, report: &mut Report<'_>) {
            let names: Vec<_> = self.process.iter().map(|process| &process.name).collect();
            for (index, process) in self.process.iter().enumerate() {
                for (at, name) in process.after.iter().enumerate() {
                    if !names.contains(&name) {
                        let help = super::suggestion(name, &names);
                        report.refuse(
                            format!("process[{index}].after[{at}]"),
                            "no such process",
                            help,
                        );
                    }
                }
            }
        }
    }

    let text = "\
[[process]]
name = 'simulator'
[[process]]
name = 'controller'
after = ['simulator', 'simulatr']
parameters.seed = true
[process.parameters.drive]
perod_ms = 3
";
    assert_eq!(
        told(layer(text).parse::<Launch>()),
        ["a.toml:5:23 | process[1].after[1] | no such process | did you mean `simulator`?"]
    );

    let launch: Launch = layer(text.replace(", 'simulatr'", "")).parse().unwrap();
    let names: Vec<_> = launch.process.iter().map(|process| process.name.as_str()).collect();
    assert_eq!(names, ["simulator", "controller"]);
    assert!(launch.process[0].parameters.is_none());
    let parameters = launch.process[1].parameters.as_ref().unwrap();
    assert_eq!(
        told(Layers::new().table(parameters).parse::<Config>()),
        [
            "a.toml:6:19 | process[1].parameters.seed | expected a whole number, 0 or more, found true | write a whole number, 0 or more, such as `3`",
            "a.toml:8:1 | process[1].parameters.drive.perod_ms | unknown key | did you mean `period_ms`?",
        ]
    );
    assert_eq!(
        told(layer("[[process]]\nname = 'a'\nparameters = 3").parse::<Launch>()),
        [
            "a.toml:3:14 | process[0].parameters | expected a table, found 3 | write a table, such as `{ key = … }`"
        ]
    );
    assert_eq!(
        told(layer("").parse::<Launch>()),
        ["a.toml:1:1 | process | missing key | add `process = …`"]
    );
}

#[test]
fn a_variant_may_have_values_of_its_own() {
    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(rename_all = "snake_case", deny_unknown_fields)]
    enum Noise {
        #[default]
        Ideal,
        Gaussian {
            sigma: f64,
        },
    }
    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Sensor {
        noise: Noise,
    }
    impl Parameters for Sensor {}

    let cases = [
        ("noise = 'ideal'", Noise::Ideal),
        ("[noise.gaussian]\nsigma = 0.01", Noise::Gaussian { sigma: 0.01 }),
    ];
    for (text, noise) in cases {
        assert_eq!(layer(text).parse(), Ok(Sensor { noise }));
    }
    assert_eq!(
        told(layer("noise.gaussian = { sigma = true, mu = 1 }").parse::<Sensor>()),
        [
            "a.toml:1:28 | noise.gaussian.sigma | expected a number, found true | write a number, such as `1.5`",
            "a.toml:1:34 | noise.gaussian.mu | unknown key | allowed: `sigma`",
        ]
    );
}

#[test]
fn a_struct_that_does_not_deny_unknown_keys_is_a_view_of_a_part() {
    #[derive(Debug, PartialEq, Deserialize)]
    struct View {
        seed: u64,
    }
    impl Parameters for View {}

    assert_eq!(layer("other = nan\nseed = 1").parse(), Ok(View { seed: 1 }));
}

#[test]
fn a_refused_default_is_told_as_such() {
    #[derive(Debug, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Bounds {
        low: f64,
        high: f64,
    }
    impl Default for Bounds {
        fn default() -> Self {
            Self { low: -1.0, high: 1.0 }
        }
    }
    impl Parameters for Bounds {
        fn check(&self, report: &mut Report<'_>) {
            if self.high <= self.low {
                report.refuse("high", "must be above `low`", "such as 2.0");
            }
        }
    }

    assert_eq!(
        told(layer("low = 1").parse::<Bounds>()),
        ["default value | high | must be above `low` | such as 2.0"]
    );
    assert_eq!(
        told(layer("low = 1\nhigh = true").parse::<Bounds>()),
        ["a.toml:2:8 | high | expected a number, found true | write a number, such as `1.5`"]
    );
    assert_eq!(
        told(layer("low = true\nhigh = -0.5").parse::<Bounds>()),
        ["a.toml:1:7 | low | expected a number, found true | write a number, such as `1.5`"],
        "the default stands in for what is wrong"
    );
}

#[test]
fn a_file_name_is_relative_to_the_file_it_is_written_in() {
    #[derive(Debug, Default, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Launch {
        world: FileName,
        parameter_file: Option<FileName>,
    }
    impl Parameters for Launch {}

    let directory = Directory::new("file-names");
    let path =
        directory.write("launch.toml", "world = 'worlds/lab.toml'\nparameter_file = 'b.tml'");
    directory.write("worlds/lab.toml", "seed = 7");
    directory.write("b.toml", "");
    directory.write("notes.txt", "");

    let launch: Launch = Layers::new().file(&path).parse().unwrap();
    assert_eq!(launch.world.path(), directory.0.join("worlds/lab.toml"));
    assert_eq!(Layers::new().named(&launch.world).parse::<Config>().unwrap().seed, 7);
    assert_eq!(
        directory.told(Layers::new().named(launch.parameter_file.as_ref()).parse::<Config>()),
        ["launch.toml:2:18 | parameter_file | no such file: `b.tml` | did you mean `b.toml`?"]
    );

    let set = Layers::new().file(&path).settings(&set(&["world=here.toml"]));
    assert_eq!(set.parse::<Launch>().unwrap().world.path(), Path::new("here.toml"));
    assert_eq!(
        told(layer("world = 3").parse::<Launch>()),
        [
            "a.toml:1:9 | world | expected a file name in quotes, found 3 | write a file name in quotes"
        ]
    );
}

#[test]
fn a_file_that_cannot_be_read_is_told_with_what_is_there() {
    let directory = Directory::new("missing-files");
    directory.write("simulation.toml", "");
    directory.write("robot.toml", "");
    directory.write("notes.txt", "");
    let refusal =
        |name: &str| directory.told(Layers::new().file(directory.0.join(name)).parse::<Config>());

    let cases = [
        ("simulaton.toml", "no such file: `simulaton.toml` | did you mean `simulation.toml`?"),
        ("zzz", "no such file: `zzz` | files in `.`: `robot.toml`, `simulation.toml`"),
        ("world/a.toml", "no such file: `world/a.toml` | did you mean `worlds`?"),
        ("worlds/a.toml", "no such file: `worlds/a.toml` | there are no TOML files in `worlds`"),
        ("worlds", "`worlds` is a directory | there are no TOML files in `worlds`"),
    ];
    for (name, expected) in cases {
        assert_eq!(refusal(name), [format!("{name} |  | {expected}")]);
    }
}

#[test]
fn text_that_is_not_utf8_is_told_with_its_place() {
    assert_eq!(
        refusals(b"seed = 1\nname = '\xff'"),
        ["a.toml:2:9 |  | not UTF-8 | save the file as UTF-8"]
    );
}

#[test]
fn a_layer_that_cannot_be_read_does_not_hide_the_mistakes_of_the_others() {
    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Needy {
        #[expect(dead_code, reason = "only its absence matters")]
        seed: u64,
    }
    impl Parameters for Needy {}

    assert_eq!(
        told(layer("seed =").settings(&set(&["sed=1"])).parse::<Needy>()),
        [
            "a.toml:1:7 |  | a value is missing | write a value after `=`",
            "--set sed=1 | sed | unknown key | did you mean `seed`?",
        ]
    );
    assert_eq!(told(Layers::new().file("/nowhere/a.toml").parse::<Needy>()).len(), 1);
}

#[test]
fn errors_of_two_readings_are_told_once() {
    let mut errors = Errors::default();
    for _ in 0..2 {
        errors.extend(layer("sed = 1").parse::<Config>().unwrap_err());
    }

    assert_eq!(errors.iter().count(), 1);
    assert!(matches!(errors.iter().next().unwrap().place, Place::Line { line: 1, column: 1, .. }));
}

/// Whatever is written, the answer is a configuration or errors, and never a panic.
#[test]
fn no_text_is_too_strange() {
    let seed = 42_u64;
    let mut state = seed;
    let mut next = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        usize::try_from(state >> 33).unwrap() % below
    };
    let pieces = [
        "seed",
        "drive",
        "boxes",
        "name",
        "pose",
        "gains",
        "limit",
        "=",
        "=",
        ".",
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        ",",
        "\n",
        "\n",
        "\r\n",
        " ",
        "'",
        "\"",
        "\"\"\"",
        "é",
        "\u{1f916}",
        "1",
        "-",
        "nan",
        "true",
        "#",
        "\\",
        "\0",
        "seed = 1\n",
        "[drive]\n",
        "[[boxes]]\n",
        "pose = [1, 'a']\n",
        "boxes = [{}]\n",
        "limit = {hold = 1}\n",
    ];
    for run in 0..20_000 {
        let text: String = (0..next(20)).map(|_| pieces[next(pieces.len())]).collect();
        if let Err(errors) = layer(&text).parse::<Config>() {
            assert!(!errors.is_empty(), "SEED={seed} run {run}: {text:?}");
            assert!(!errors.to_string().is_empty());
        }
    }
}

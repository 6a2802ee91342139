//! What is wrong in one file: where, what, and how it is mended.

use serde::Deserialize;

use super::super::{FileName, Parameters, Table};
use super::{Config, Limit, layer, refusals, refuses, set};

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

//! A sample as text, as JSON, and as a row of a table.

use interfaces::{Field, FieldValue, Header};
use serde_json::{Map, Value, json};

use crate::table::{WIDTH, cut, number};

/// [-] Of a longer list people are shown the beginning.
const LIST_SHOWN: usize = 6;

/// The header's fields before the others.
pub(super) fn all_fields(header: &Header, mut fields: Vec<Field>) -> Vec<Field> {
    let count = |name, unit, value| Field { name, unit, value: FieldValue::Count(value) };
    let mut all = vec![
        count("stamp", "ns", header.stamp.nanoseconds),
        count("sequence", "-", header.sequence),
        count("epoch", "-", header.epoch.into()),
    ];
    all.append(&mut fields);
    all
}

/// For people: a line for the header, one for each field, with what does not fit into it `in_full` or
/// left out.
pub(super) fn text(header: &Header, fields: &[Field], in_full: bool) -> String {
    let width = fields.iter().map(|field| field.name.len()).max().unwrap_or_default();
    let mut lines = vec![format!(
        "stamp {:.9} s, sequence {}, epoch {}",
        header.stamp.seconds(),
        header.sequence,
        header.epoch
    )];
    for field in fields {
        match &field.value {
            FieldValue::List(items) if matches!(items.first(), Some(FieldValue::Group(_))) => {
                lines.push(format!("  {}", field.name));
                lines.extend(items.iter().map(|item| format!("    {}", value(item))));
            }
            other => {
                let unit = if field.unit == "-" { "" } else { field.unit };
                let shown = if in_full { value(other) } else { short(other) };
                let text = format!("  {:<width$}  {shown} {unit}", field.name);
                lines.push(text.trim_end().to_owned());
            }
        }
    }
    if !in_full {
        lines = lines.iter().map(|line| cut(line, WIDTH)).collect();
    }
    lines.join("\n")
}

/// All of a value, in one line.
pub(super) fn value(value: &FieldValue) -> String {
    match value {
        FieldValue::Count(count) => count.to_string(),
        FieldValue::Integer(integer) => integer.to_string(),
        FieldValue::Real(real) => number(*real),
        FieldValue::Word(word) => (*word).to_owned(),
        FieldValue::Text(text) if text.is_empty() => "-".to_owned(),
        FieldValue::Text(text) => node::say::shown(text),
        FieldValue::List(items) => items.iter().map(self::value).collect::<Vec<_>>().join(" "),
        FieldValue::Group(fields) => {
            let named = |field: &Field| format!("{}={}", field.name, self::value(&field.value));
            fields.iter().map(named).collect::<Vec<_>>().join(" ")
        }
    }
}

/// The same, of a long list the beginning.
fn short(value: &FieldValue) -> String {
    match value {
        FieldValue::List(items) if LIST_SHOWN < items.len() => {
            let shown: Vec<_> = items.iter().take(LIST_SHOWN).map(self::value).collect();
            format!("{} .. ({} in all)", shown.join(" "), items.len())
        }
        other => self::value(other),
    }
}

/// One JSON object, a key for each field. JSON knows no NaN and no infinity: they are strings.
pub(super) fn object(fields: &[Field]) -> Value {
    let pairs = fields.iter().map(|field| (field.name.to_owned(), json_of(&field.value)));
    Value::Object(pairs.collect::<Map<_, _>>())
}

pub(super) fn json_of(value: &FieldValue) -> Value {
    match value {
        FieldValue::Count(count) => json!(count),
        FieldValue::Integer(integer) => json!(integer),
        FieldValue::Real(real) if real.is_finite() => json!(real),
        FieldValue::Real(real) => json!(real.to_string()),
        FieldValue::Word(word) => json!(word),
        FieldValue::Text(text) => json!(text),
        FieldValue::List(items) => items.iter().map(json_of).collect(),
        FieldValue::Group(fields) => object(fields),
    }
}

/// The cells of a row of a table, each with its title: `yaw [rad]`, `range_0 [m]`.
pub(super) fn cells(fields: &[Field]) -> Vec<(String, String)> {
    let mut cells = Vec::new();
    for field in fields {
        collect(field.name, field.unit, &field.value, &mut cells);
    }
    cells
}

fn collect(name: &str, unit: &str, value: &FieldValue, cells: &mut Vec<(String, String)>) {
    match value {
        FieldValue::List(items) => {
            for (index, item) in items.iter().enumerate() {
                collect(&format!("{name}_{index}"), unit, item, cells);
            }
        }
        FieldValue::Group(fields) => {
            for field in fields {
                collect(&format!("{name}.{}", field.name), field.unit, &field.value, cells);
            }
        }
        FieldValue::Text(text) => cells.push((name.to_owned(), quoted(text))),
        FieldValue::Real(real) => cells.push((titled(name, unit), real.to_string())),
        other => cells.push((titled(name, unit), self::value(other))),
    }
}

fn titled(name: &str, unit: &str) -> String {
    if unit == "-" { name.to_owned() } else { format!("{name} [{unit}]") }
}

/// As RFC 4180 has it, whatever a node has written.
fn quoted(text: &str) -> String {
    format!("\"{}\"", node::say::shown(text).replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use interfaces::{Described, LaserScan, NodeStatus, Odometry, PortStatus, Text};

    use super::*;

    #[test]
    fn a_sample_reads_like_this() {
        let mut odometry = Odometry { x: 1.5, yaw: -0.25, ..Odometry::default() };
        odometry.header.sequence = 7;

        assert_eq!(
            text(&odometry.header, &odometry.fields(), false),
            "\
stamp 0.000000000 s, sequence 7, epoch 0
  x        1.5 m
  y        0 m
  yaw      -0.25 rad
  linear   0 m/s
  angular  0 rad/s"
        );
    }

    #[test]
    fn what_json_has_no_number_for_is_a_word() {
        let mut scan = LaserScan { length: 3, ..LaserScan::default() };
        scan.ranges_mut().copy_from_slice(&[0.1, f32::INFINITY, f32::NAN]);

        assert_eq!(object(&scan.fields())["range"], json!([0.1, "inf", "NaN"]));
    }

    #[test]
    fn of_many_beams_people_are_shown_the_first_few_and_a_table_has_all() {
        let mut scan = LaserScan { length: 240, ..LaserScan::default() };
        scan.ranges_mut().fill(0.5);

        let text = text(&scan.header, &scan.fields(), false);
        assert!(text.contains("range            0.5 0.5 0.5 0.5 0.5 0.5 .. (240 in all) m"));
        let cells = cells(&scan.fields());
        assert!(cells.contains(&("range_239 [m]".to_owned(), "0.5".to_owned())));
    }

    #[test]
    fn what_a_node_has_written_steers_no_terminal_and_breaks_no_table() {
        let mut status = NodeStatus { port_count: 1, ..NodeStatus::default() };
        status.text = Text::new("a\x1b[2J \"b\",\nc");
        status.port[0] = PortStatus { topic: Text::new("scan"), samples: 3, ..status.port[0] };

        let shown = text(&status.header, &status.fields(), false);
        assert!(!shown.contains('\x1b'), "{shown}");
        assert!(shown.contains("  port\n    topic=scan publishes=0"), "{shown}");
        let cells = cells(&status.fields());
        let text = &cells.iter().find(|(name, _)| name == "text").unwrap().1;
        assert_eq!(text, "\"a\u{fffd}[2J \"\"b\"\",\u{fffd}c\"");
    }
}

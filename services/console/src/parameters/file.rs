//! A node's parameters as a file: printed, and read back.

use std::path::Path;

use node::control::Failure;
use node::say::{complain, say};
use serde_json::Value;

use super::{Parameter, check_tunable, find, set, shown};
use crate::robot::{Node, Robot};

/// As a file of parameters, a line for each. What is absent has none.
pub(super) fn dumped(all: &[Parameter]) -> String {
    let present = all.iter().filter(|parameter| !parameter.value.is_null());
    // What JSON has for text, numbers and lists TOML has too.
    let line = |parameter: &Parameter| format!("{} = {}", parameter.key, parameter.value);
    present.map(line).collect::<Vec<_>>().join("\n")
}

/// Changes what `file` says otherwise; the exit code is 1 where something of that is not to be.
pub(super) fn load(
    robot: &Robot,
    node: &Node,
    all: &[Parameter],
    file: &Path,
) -> Result<u8, Failure> {
    let failed = |cause: String| Failure::Refused(format!("{}: {cause}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|cause| failed(cause.to_string()))?;
    let tree: Value = toml::from_str(&text).map_err(|cause| failed(cause.message().to_owned()))?;
    let mut wanted = Vec::new();
    flatten(&tree, String::new(), &mut wanted);
    let (mut code, mut changes) = (0, 0);
    for (key, value) in wanted {
        let outcome = find(all, &node.name, &key).and_then(|parameter| {
            if same(&parameter.value, &value) {
                return Ok(None);
            }
            check_tunable(robot, node, parameter)?;
            set(robot, &node.name, &key, &shown(&value)).map(Some)
        });
        match outcome {
            Ok(None) => {}
            Ok(Some(told)) => {
                changes += 1;
                say(&told)?;
            }
            Err(failure @ Failure::Refused(_)) => {
                complain(&failure);
                code = failure.code();
            }
            Err(failure) => return Err(failure),
        }
    }
    if changes == 0 && code == 0 {
        say(&format!("{} goes by that already", node.name))?;
    }
    Ok(code)
}

/// The keys of a tree, dotted, with their values.
fn flatten(tree: &Value, key: String, all: &mut Vec<(String, Value)>) {
    match tree {
        Value::Object(table) => {
            for (step, value) in table {
                let dot = if key.is_empty() { "" } else { "." };
                flatten(value, format!("{key}{dot}{step}"), all);
            }
        }
        value => all.push((key, value.clone())),
    }
}

/// Whether the two say the same: `2` is `2.0`.
fn same(one: &Value, other: &Value) -> bool {
    one == other || one.as_f64().zip(other.as_f64()).is_some_and(|(a, b)| a.total_cmp(&b).is_eq())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::From;
    use super::*;

    #[test]
    fn what_is_dumped_is_a_file_of_parameters() {
        let parameter = |key: &str, value: Value| Parameter {
            key: key.to_owned(),
            default: value.clone(),
            value,
            from: From::Change,
            tunable: None,
        };
        let all = [
            parameter("algorithm", json!("wall_following")),
            parameter("wall_following.angular_max_rad_s", Value::Null),
            parameter("wall_following.speed_m_s", json!(0.15)),
        ];
        let text = dumped(&all);
        assert_eq!(text, "algorithm = \"wall_following\"\nwall_following.speed_m_s = 0.15");
        let mut keys = Vec::new();
        flatten(&toml::from_str(&text).unwrap(), String::new(), &mut keys);
        assert_eq!(keys[1], ("wall_following.speed_m_s".to_owned(), json!(0.15)));
        assert!(same(&json!(2), &json!(2.0)) && !same(&json!("2"), &json!(2)));
    }
}

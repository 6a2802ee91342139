//! Parameters key by key: what each is, what it would be by default, and who says so.

use serde::Serialize;

use super::error::Place;
use super::report::{Parameters, Report};
use super::value::{Step, Value};

/// Parameters that can be shown key by key.
pub trait Listable: Parameters + Serialize + Default {}

impl<T: Parameters + Serialize + Default> Listable for T {}

/// One parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Listed {
    /// [-] Dotted, with its unit at the end.
    pub key: String,
    /// What it is; null where an optional one is absent.
    pub value: serde_json::Value,
    /// What it would be if nobody had written it.
    pub default: serde_json::Value,
    /// Where it was written.
    pub place: Place,
}

/// Every key of `parsed`, which was read from `merged`.
pub(super) fn listed<T: Listable>(merged: &Value, parsed: &T) -> Vec<Listed> {
    let tree = |value: &T| serde_json::to_value(value).unwrap_or_default();
    let mut all = Vec::new();
    walk(merged, &mut Vec::new(), &tree(parsed), &tree(&T::default()), &mut all);
    all
}

/// `parameters` with another value at `key`, or why that cannot be. What serde skips is as by
/// default.
pub(crate) fn changed<T: Listable>(
    parameters: &T,
    key: &str,
    value: serde_json::Value,
) -> Result<T, String> {
    let mut tree = serde_json::to_value(parameters).map_err(|cause| cause.to_string())?;
    *find(&mut tree, key).ok_or("there is no such key")? = value;
    let changed: T = serde_json::from_value(tree).map_err(|cause| cause.to_string())?;
    let (nowhere, mut errors) = (Value::table(None), Vec::new());
    changed.check(&mut Report::new(&nowhere, &mut errors));
    errors.first().map_or(Ok(changed), |error| Err(error.message.clone()))
}

/// The value at `key`, if there is one.
pub(crate) fn value<T: Listable>(parameters: &T, key: &str) -> Option<serde_json::Value> {
    find(&mut serde_json::to_value(parameters).ok()?, key).cloned()
}

fn find<'a>(tree: &'a mut serde_json::Value, key: &str) -> Option<&'a mut serde_json::Value> {
    key.split('.').try_fold(tree, |tree, key| tree.get_mut(key))
}

fn walk(
    merged: &Value,
    path: &mut Vec<Step>,
    value: &serde_json::Value,
    default: &serde_json::Value,
    all: &mut Vec<Listed>,
) {
    if let Some(table) = value.as_object() {
        for (key, value) in table {
            path.push(Step::Key(key.clone()));
            walk(merged, path, value, &default[key], all);
            path.pop();
        }
        return;
    }
    let written = merged.along(path).nth(path.len()).and_then(|value| value.origin.as_ref());
    all.push(Listed {
        key: super::value::dotted("", path),
        value: value.clone(),
        default: default.clone(),
        place: written.map_or(Place::Default, super::source::Origin::place),
    });
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::{FileName, Layers, Setting};
    use super::*;

    #[derive(Debug, Default, serde::Deserialize, Serialize)]
    #[serde(default, deny_unknown_fields)]
    struct Robot {
        drive: Drive,
        name: Option<String>,
        world: FileName,
    }

    #[derive(Debug, Default, serde::Deserialize, Serialize)]
    #[serde(default, deny_unknown_fields)]
    struct Drive {
        speed_m_s: f64,
        gain: f64,
    }

    impl Parameters for Robot {
        fn check(&self, report: &mut Report<'_>) {
            if self.drive.speed_m_s < 0.0 {
                report.refuse("drive.speed_m_s", "must not be negative", "give 0 or more");
            }
        }
    }

    #[test]
    fn one_value_is_changed_where_the_parameters_own_check_allows_it() {
        let slow = Robot::default();

        let fast = changed(&slow, "drive.speed_m_s", json!(0.2)).unwrap();
        assert_eq!(value(&fast, "drive.speed_m_s"), Some(json!(0.2)));
        assert_eq!(value(&fast, "drive.gain"), Some(json!(0.0)));
        let refusal = changed(&slow, "drive.speed_m_s", json!(-1.0)).unwrap_err();
        assert_eq!(refusal, "must not be negative");
        assert!(changed(&slow, "drive.sped", json!(1.0)).is_err());
        assert!(changed(&slow, "drive", json!(1.0)).is_err());
        // What was absent may come.
        let named = changed(&slow, "name", json!("burger")).unwrap();
        assert_eq!(named.name.as_deref(), Some("burger"));
        // A file's name stays what it is, whole as it is.
        let placed = Robot { world: "worlds/lab.toml".into(), ..Robot::default() };
        let faster = changed(&placed, "drive.speed_m_s", json!(0.3)).unwrap();
        assert_eq!(faster.world, placed.world);
    }

    #[test]
    fn every_key_has_its_value_its_default_and_the_place_where_it_was_written() {
        let set: Setting = "drive.speed_m_s=0.2".parse().unwrap();
        let all = Layers::new().settings([&set]).listed::<Robot>().unwrap();

        let keys: Vec<_> = all.iter().map(|one| one.key.as_str()).collect();
        assert_eq!(keys, ["drive.gain", "drive.speed_m_s", "name", "world"]);
        assert_eq!((all[1].value.as_f64(), all[1].default.as_f64()), (Some(0.2), Some(0.0)));
        assert_eq!(all[1].place, Place::Setting("drive.speed_m_s=0.2".to_owned()));
        assert_eq!((&all[0].place, &all[2].value), (&Place::Default, &serde_json::Value::Null));
    }
}

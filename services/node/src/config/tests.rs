mod files;
mod layers;
mod mistakes;
mod parts;
mod values;

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{Error, Errors, Layers, Parameters, Report, Setting};

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

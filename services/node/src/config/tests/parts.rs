//! Tables that somebody else reads, and structs that read a part.

use serde::Deserialize;

use super::super::{Layers, Parameters, Report, Table};
use super::{Config, layer, told};

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
                        let help = super::super::suggestion(name, &names);
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

//! Files that are named in files, and files that cannot be read.

use std::path::Path;

use serde::Deserialize;

use super::super::{Errors, FileName, Layers, Parameters, Place};
use super::{Config, Directory, layer, refusals, set, told};

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
fn a_name_that_is_typed_instead_of_one_in_a_file_is_looked_for_beside_that() {
    #[derive(Debug, Default, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Launch {
        world: FileName,
    }
    impl Parameters for Launch {}

    let directory = Directory::new("typed-names");
    let path = directory.write("launch.toml", "world = 'worlds/lab.toml'");
    directory.write("worlds/lab.toml", "");
    directory.write("worlds/loop.toml", "");
    let help = |typed: &str| {
        let sets = set(&["world=before.toml", &format!("world={typed}")]);
        let launch: Launch = Layers::new().file(&path).settings(&sets).parse().unwrap();
        let errors = Layers::new().named(&launch.world).parse::<Config>().unwrap_err();
        errors[0].help.replace(directory.0.to_str().unwrap(), "~")
    };

    let all = "files in `~/worlds`: `lab.toml`, `loop.toml`";
    for (typed, expected) in [
        ("maze", all),
        ("maze.toml", all),
        ("worlds/maze.toml", all),
        ("loop", "did you mean `~/worlds/loop.toml`?"),
        ("worlds/lab.toml", "did you mean `~/worlds/lab.toml`?"),
    ] {
        assert_eq!(help(typed), expected, "{typed}");
    }
    // Beside where it was looked for is nearer.
    let near = directory.0.join("worlds/lob.toml");
    assert_eq!(help(near.to_str().unwrap()), "did you mean `~/worlds/lab.toml`?");
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

//! The rules that neither Cargo nor clippy checks, each with the way to mend what breaks it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use interfaces::{Field, topics};

/// Crates that every service may depend on; the others are services.
const COMMON: [&str; 2] = ["interfaces", "node"];

/// Packages that only one service may use, by the beginning of their names.
const OWNED: [(&str, &str); 4] = [
    ("parry", "simulator"),
    ("ctrlc", "node"),
    ("serialport", "turtlebot3"),
    ("tokio-serial", "turtlebot3"),
];

/// What reads a clock or sleeps.
const CLOCKS: [&str; 5] =
    ["Instant::now", "SystemTime::now", "thread::sleep", "clock_gettime", "nanosleep"];

/// Files that write down what people's clocks say, for people.
const WRITERS: [&str; 7] = [
    "services/console/src/parameters.rs",
    "services/node/src/clock.rs",
    "services/supervisor/src/history.rs",
    "services/supervisor/src/last_words.rs",
    "services/supervisor/src/log_book.rs",
    "services/supervisor/src/supervise.rs",
    "services/supervisor/src/tuning.rs",
];

/// Structs in messages that are made of fields with units of their own.
const COMPOSITES: [&str; 3] = ["Header", "PortStatus", "Value"];

/// Structs that are read leniently, and why.
const LENIENT: [(&str, &str); 4] = [
    ("Place", "looks at a few keys of a process that checks all of them itself"),
    ("Ports", "looks at two keys of a process that checks all of them itself"),
    ("Stream", "recorded by other programs, which may say more"),
    ("Event", "recorded by other programs, which may say more"),
];

/// [-] Lines of a function that can be read at once.
const FUNCTION_LINES_MAX: usize = 70;

/// [-] Lines of a file with a `main`, which only says who does the work.
const MAIN_LINES_MAX: usize = 60;

#[test]
fn no_service_depends_on_another() {
    let services = services();
    for service in &services {
        for dependency in dependencies(&format!("services/{service}/Cargo.toml")) {
            let is_service = services.contains(&dependency);
            assert!(
                !is_service || COMMON.contains(&dependency.as_str()),
                "services/{service} depends on {dependency}: services meet on topics only; \
                 what both need belongs into `interfaces` or `node`"
            );
        }
    }
}

#[test]
fn the_interfaces_depend_on_no_service() {
    let services = services();
    let dependencies = dependencies("interfaces/Cargo.toml");
    let service = dependencies.iter().find(|dependency| services.contains(*dependency));
    assert_eq!(service, None, "interfaces is what services agree on: it knows none of them");
}

#[test]
fn geometry_signals_and_serial_ports_have_one_owner_each() {
    let manifests = services().into_iter().map(|name| format!("services/{name}/Cargo.toml"));
    for manifest in manifests.chain(["Cargo.toml".into(), "interfaces/Cargo.toml".into()]) {
        for dependency in dependencies(&manifest) {
            for (package, owner) in OWNED {
                assert!(
                    !dependency.starts_with(package) || manifest.contains(owner),
                    "{manifest} depends on {dependency}, which is {owner}'s alone: \
                     let {owner} do what needs it"
                );
            }
        }
    }
}

#[test]
fn only_node_reads_the_clock_or_sleeps() {
    for source in sources().iter().filter(|source| !source.path.starts_with("services/node")) {
        for (number, line) in source.code() {
            for clock in CLOCKS {
                assert!(
                    !line.contains(clock) || source.path.starts_with("tests/house_rules.rs"),
                    "{}:{number} uses {clock}: take `now` from `Node::tick` or `node::clock`",
                    source.path
                );
            }
        }
    }
}

#[test]
fn nothing_but_text_is_made_of_the_wall_clock() {
    let uses = ["clock::wall", "SystemTime"];
    for source in sources().iter().filter(|source| !source.is_test()) {
        for (number, line) in source.code() {
            let is_used = uses.iter().any(|using| line.contains(using));
            assert!(
                !is_used || WRITERS.contains(&source.path.as_str()),
                "{}:{number} reads the wall clock, which people may set: take `clock::now`, or name \
                 the file in WRITERS if it only writes the time down",
                source.path
            );
        }
    }
}

#[test]
fn every_crate_forbids_unsafe_code() {
    let roots = sources().into_iter().filter(Source::is_crate_root);
    let roots: Vec<_> = roots.collect();
    assert!(services().len() < roots.len(), "crate roots are looked for in the wrong place");
    for root in roots {
        assert!(
            root.text.contains("\n#![forbid(unsafe_code)]\n"),
            "{} lacks #![forbid(unsafe_code)] after its first comment",
            root.path
        );
    }
}

#[test]
fn every_file_begins_with_a_sentence_that_says_what_it_is() {
    for source in sources().iter().filter(|source| !source.is_test()) {
        assert!(
            source.text.starts_with("//! "),
            "{}: begin with a line `//! …` that a newcomer understands",
            source.path
        );
    }
}

#[test]
fn every_field_of_a_message_has_its_unit_first() {
    let mut fields = 0;
    for source in sources().iter().filter(|source| source.path.starts_with("interfaces/src")) {
        for (number, field, message_type, doc) in message_fields(&source.text) {
            fields += 1;
            let base = message_type.trim_start_matches('[');
            let is_composite = COMPOSITES.iter().any(|composite| {
                base.strip_prefix(composite)
                    .is_some_and(|rest| !rest.starts_with(char::is_alphabetic))
            });
            assert!(
                is_composite || (doc.starts_with('[') && doc.contains("] ")),
                "{}:{number}: begin the comment of `{field}` with its unit: `/// [m] …`, \
                 or `/// [-] …` where it has none",
                source.path
            );
        }
    }
    assert!(20 < fields, "fields of messages are looked for in the wrong place");
}

#[test]
fn functions_can_be_read_at_once() {
    for source in sources() {
        for (number, name, lines) in functions(&source.text) {
            assert!(
                lines <= FUNCTION_LINES_MAX,
                "{}:{number}: `{name}` has {lines} lines, more than {FUNCTION_LINES_MAX}: \
                 give its parts names of their own",
                source.path
            );
        }
    }
}

#[test]
fn a_main_only_says_who_does_the_work() {
    let mains = sources()
        .into_iter()
        .filter(|source| source.path.ends_with("main.rs") && !source.path.starts_with("tests"));
    for main in mains {
        let lines = main.text.lines().count();
        assert!(
            lines <= MAIN_LINES_MAX,
            "{} has {lines} lines, more than {MAIN_LINES_MAX}: move the work into a library",
            main.path
        );
    }
}

#[test]
fn nothing_is_left_to_do() {
    // In halves, so that this file does not find itself.
    let marks = [["FIX", "ME"], ["XX", "X"], ["to", "do!("], ["unimplement", "ed!("]];
    for source in sources() {
        for mark in marks.map(|halves| halves.concat()) {
            assert!(
                !source.text.contains(&mark),
                "{} contains {mark}: do it, or open an issue",
                source.path
            );
        }
    }
}

#[test]
fn no_test_is_switched_off_or_content_with_a_panic() {
    let marks = [["#[ign", "ore"], ["should_", "panic"]];
    for source in sources() {
        for mark in marks.map(|halves| halves.concat()) {
            assert!(
                !source.text.contains(&mark),
                "{} contains {mark}: mend the test, or assert what exactly is refused",
                source.path
            );
        }
    }
}

#[test]
fn nobody_can_learn_the_ground_truth_from_the_interfaces() {
    for source in sources().iter().filter(|source| source.path.starts_with("interfaces")) {
        let text = source.text.to_lowercase();
        for word in ["ground truth", "ground_truth", "true pose", "true_pose", "clearance"] {
            assert!(
                !text.contains(word),
                "{} says '{word}': what only a simulator knows is no message",
                source.path
            );
        }
    }
}

#[test]
fn odometry_and_controller_do_not_read_the_simulator_s_status() {
    let cheats = ["STATUS", "NodeStatus", "subscriber_to", "TRANSITION_EVENT"];
    for source in sources() {
        let is_player = ["services/odometry/src", "services/controller/src"]
            .iter()
            .any(|service| source.path.starts_with(service));
        if !is_player {
            continue;
        }
        for (number, line) in source.code() {
            for cheat in cheats {
                assert!(
                    !line.contains(cheat),
                    "{}:{number} uses {cheat}: the simulator's status tells the truth, \
                     which a robot does not have",
                    source.path
                );
            }
        }
    }
}

#[test]
fn every_parameter_struct_refuses_unknown_keys() {
    let mut structs = 0;
    for source in sources().iter().filter(|source| !source.is_test()) {
        for (number, name, attributes) in deserialized_structs(source) {
            structs += 1;
            let is_lenient = LENIENT.iter().any(|(lenient, _)| *lenient == name);
            assert!(
                is_lenient || attributes.contains("deny_unknown_fields"),
                "{}:{number}: `{name}` swallows misspelt keys: add \
                 #[serde(deny_unknown_fields)], or name it in LENIENT with the reason",
                source.path
            );
        }
    }
    assert!(8 < structs, "parameter structs are looked for in the wrong place");
}

#[test]
fn the_topic_table_in_the_documentation_is_the_one_in_the_code() {
    let text = read("interfaces/src/topics.rs");
    let documented: BTreeSet<_> = text
        .lines()
        .filter_map(|line| line.strip_prefix("//! | `"))
        .filter_map(|row| row.split_once('`'))
        .map(|(name, _)| name.trim_start_matches("~/"))
        .collect();
    let defined: BTreeSet<_> =
        text.split("Topic::new(\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(5 < defined.len(), "topics are looked for in the wrong place");
    assert_eq!(documented, defined, "mend the table at the top of interfaces/src/topics.rs");
}

#[test]
fn every_topic_can_be_found_by_its_name() {
    let text = read("interfaces/src/topics.rs");
    let defined: BTreeSet<_> = text
        .split("Topic::new(\"")
        .skip(1)
        .filter_map(|rest| rest.split('"').next())
        .map(str::to_owned)
        .collect();
    let (robot, node) = (topics::names(), topics::names_of_each_node());
    let found: BTreeSet<_> = robot.into_iter().chain(node).map(str::to_owned).collect();
    assert_eq!(found, defined, "mend the `table!` at the end of interfaces/src/topics.rs");
}

#[test]
fn every_field_is_shown_with_the_unit_of_its_comment() {
    let commented: BTreeSet<_> = sources()
        .iter()
        .filter(|source| source.path.starts_with("interfaces/src"))
        .flat_map(|source| message_fields(&source.text))
        .filter_map(|(_, field, _, doc)| {
            let (unit, _) = doc.strip_prefix('[')?.split_once(']')?;
            Some((field, unit.to_owned()))
        })
        .collect();
    let names = topics::names().into_iter().map(str::to_owned);
    let of_nodes = topics::names_of_each_node().into_iter().map(|name| format!("node/{name}"));
    let mut fields = 0;
    for topic in names.chain(of_nodes) {
        for Field { name, unit, .. } in node::observe::row(&topic).unwrap().fields {
            fields += 1;
            let is_composite = topic == "node/status" && (name == "port" || name == "value");
            assert!(
                is_composite || commented.contains(&(name.to_owned(), unit.to_owned())),
                "{topic}: no comment in interfaces/src says that `{name}` is in [{unit}]; \
                 mend interfaces/src/fields.rs"
            );
        }
    }
    assert!(60 < fields, "only {fields} fields are shown");
}

#[test]
fn the_architecture_names_every_service() {
    let text = read("ARCHITECTURE.md");
    for service in services() {
        assert!(
            text.contains(&format!("{service}/")) || text.contains(&format!("`{service}`")),
            "ARCHITECTURE.md does not name services/{service}: say what it does and what it \
             does not"
        );
    }
}

#[test]
fn the_readme_s_test_command_is_the_one_that_is_run() {
    let script = read("scripts/check");
    let command = script.lines().find(|line| line.starts_with("cargo test"));
    let command = command.expect("scripts/check runs no tests");
    assert!(
        read("README.md").contains(command),
        "README.md tells another test command than scripts/check runs, which is `{command}`"
    );
    let ci = read(".ci/run");
    let runs_check = ci.contains("exec scripts/check") || ci.contains(command);
    assert!(runs_check, ".ci/run does not run `{command}`");
}

#[test]
fn every_fault_has_a_row_in_the_readme_and_every_test_that_a_row_names_is_there() {
    let readme = read("README.md");
    let table = readme.split("faults -->").nth(1).expect("README.md has no table of faults");
    for number in (1..=19).chain([22]).chain(24..=28) {
        let row = format!("\n| F{number} |");
        assert!(table.contains(&row), "README.md's table of faults has no row F{number}");
    }
    let sources = sources();
    let names = table.split('`').skip(1).step_by(2).filter_map(|name| name.split_once("::"));
    let names: Vec<_> = names.collect();
    assert!(20 < names.len(), "tests are looked for in the wrong place");
    for (place, name) in names {
        let file = format!("tests/{place}.rs");
        let is_whole = sources.iter().any(|source| source.path == file);
        let may_be = |source: &&Source| {
            if is_whole { source.path == file } else { source.path.contains(place) }
        };
        let test = format!("#[test]\nfn {name}(");
        let is_there = |source: &Source| source.text.replace("    ", "").contains(&test);
        assert!(
            sources.iter().filter(may_be).any(is_there),
            "README.md's table of faults names {place}::{name}, which is no test: say which shows it"
        );
    }
}

/// One Rust file of the project.
struct Source {
    /// From the project's root.
    path: String,
    text: String,
}

impl Source {
    /// Its lines by number, without comments.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines = self.text.lines().map(|line| line.split("//").next().unwrap_or_default());
        (1..).zip(lines)
    }

    fn is_crate_root(&self) -> bool {
        let roots = ["src/lib.rs", "src/main.rs", "services/main.rs", "tests/main.rs"];
        roots.iter().any(|root| self.path.ends_with(root))
    }

    fn is_test(&self) -> bool {
        self.path.contains("/tests") || self.path.starts_with("tests")
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|cause| panic!("{path}: {cause}"))
}

/// The directories in services/.
fn services() -> BTreeSet<String> {
    let entries = fs::read_dir(root().join("services")).unwrap().flatten();
    let directories = entries.filter(|entry| entry.path().is_dir());
    directories.map(|entry| entry.file_name().into_string().unwrap()).collect()
}

/// Everything that a package depends on, for whatever purpose.
fn dependencies(manifest: &str) -> BTreeSet<String> {
    let manifest: toml::Table = read(manifest).parse().unwrap();
    ["dependencies", "dev-dependencies", "build-dependencies"]
        .iter()
        .filter_map(|kind| manifest.get(*kind)?.as_table())
        .flat_map(toml::Table::keys)
        .cloned()
        .collect()
}

fn sources() -> Vec<Source> {
    let mut sources = Vec::new();
    let mut folders = ["interfaces", "services", "tests"].map(|name| root().join(name)).to_vec();
    while let Some(folder) = folders.pop() {
        let mut paths: Vec<PathBuf> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned();
                sources.push(Source { path, text });
            }
        }
    }
    sources
}

/// Line, name, type and first line of the comment of each public field of a struct in shared memory.
fn message_fields(text: &str) -> Vec<(usize, String, String, String)> {
    let mut fields = Vec::new();
    let mut is_message = false;
    let mut doc: Option<&str> = None;
    for (number, line) in (1..).zip(text.lines()) {
        is_message = (is_message || line == "#[repr(C)]") && line != "}";
        let trimmed = line.trim();
        if let Some(comment) = trimmed.strip_prefix("/// ") {
            doc.get_or_insert(comment);
        } else if let Some((name, kind)) =
            trimmed.strip_prefix("pub ").and_then(|field| field.split_once(": "))
            && is_message
        {
            let first = doc.take().unwrap_or_default().to_owned();
            fields.push((number, name.to_owned(), kind.to_owned(), first));
        } else if !trimmed.starts_with("#[") {
            doc = None;
        }
    }
    fields
}

/// First line, name and number of lines of each function, as rustfmt lays them out.
fn functions(text: &str) -> Vec<(usize, String, usize)> {
    let lines: Vec<_> = text.lines().collect();
    let mut functions = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let is_function = ["fn ", "pub fn ", "const fn ", "pub const fn "]
            .iter()
            .any(|start| code.starts_with(start))
            || (code.starts_with("pub(") && code.contains(" fn "));
        if !is_function || line.ends_with('}') || line.ends_with(';') {
            continue;
        }
        let end = format!("{}}}", &line[..line.len() - code.len()]);
        let length = lines[index..].iter().position(|line| *line == end).map(|last| last + 1);
        let name = code.split("fn ").nth(1).and_then(|rest| rest.split(['(', '<']).next());
        functions.extend(length.map(|length| (index + 1, name.unwrap_or(code).to_owned(), length)));
    }
    functions
}

/// Line, name and attributes of each struct that is read from a file, outside of unit tests.
fn deserialized_structs(source: &Source) -> Vec<(usize, String, String)> {
    let mut structs = Vec::new();
    let mut attributes = String::new();
    for (number, line) in source.code() {
        let line = line.trim();
        if line == "mod tests {" {
            break;
        }
        if line.starts_with("#[") {
            attributes.push_str(line);
        } else if let Some((_, rest)) = line.split_once("struct ") {
            let name = rest.split(|letter: char| !letter.is_alphanumeric()).next();
            if attributes.contains("Deserialize") && line.ends_with('{') {
                structs.push((number, name.unwrap_or(rest).to_owned(), attributes.clone()));
            }
            attributes.clear();
        } else if !line.is_empty() {
            attributes.clear();
        }
    }
    structs
}

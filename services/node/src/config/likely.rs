//! What somebody probably meant who wrote a word that means nothing.

/// [-] More names than that are no help in a sentence.
const LISTED_MAX: usize = 12;

/// [-] So many that are equally like a word are all named.
const EQUALS_MAX: usize = 3;

/// [character] A shorter word is the beginning of too many.
const BEGINNING_MIN: usize = 3;

/// What to do about a name that is none of `allowed`: the one that was probably meant, or else all that
/// there are.
pub fn suggestion<S: AsRef<str>>(word: &str, allowed: &[S]) -> String {
    if allowed.is_empty() {
        return "remove it: nothing is allowed here".to_owned();
    }
    suggestion_or(word, allowed, &format!("allowed: {}", quoted(allowed)))
}

/// The same, with something else to say where nothing is like it and there are too many to be named.
pub fn suggestion_or<S: AsRef<str>>(word: &str, allowed: &[S], otherwise: &str) -> String {
    let likely: Vec<_> = likely(word, allowed).iter().map(|name| format!("`{name}`")).collect();
    if !likely.is_empty() {
        return format!("did you mean {}?", likely.join(" or "));
    }
    if (1..=LISTED_MAX).contains(&allowed.len()) {
        return format!("allowed: {}", quoted(allowed));
    }
    otherwise.to_owned()
}

/// The names most like `word`: none if none is like it at all, several if they are equally like it.
pub fn likely<'a, S: AsRef<str>>(word: &str, names: &'a [S]) -> Vec<&'a str> {
    let word = word.to_lowercase();
    let rated = names.iter().map(AsRef::as_ref);
    let rated: Vec<_> =
        rated.filter_map(|name| Some((likeness(&word, &name.to_lowercase())?, name))).collect();
    let best = rated.iter().map(|(likeness, _)| *likeness).max();
    let equal = rated.iter().filter(|(likeness, _)| Some(*likeness) == best);
    let equal: Vec<_> = equal.map(|(_, name)| *name).collect();
    if EQUALS_MAX < equal.len() { Vec::new() } else { equal }
}

pub(super) fn quoted<S: AsRef<str>>(names: &[S]) -> String {
    let quoted: Vec<_> = names.iter().map(|name| format!("`{}`", name.as_ref())).collect();
    quoted.join(", ")
}

/// [1/1000] How like `name` is to `word`; nothing where nobody would have meant it.
fn likeness(word: &str, name: &str) -> Option<usize> {
    let split = |text: &str| {
        text.rsplit_once(['.', '/']).map(|(head, tail)| (head.to_owned(), tail.to_owned()))
    };
    match (split(word), split(name)) {
        // Each part for itself: a long table that is right must not make up for a wrong key.
        (Some((word_head, word)), Some((name_head, name))) => {
            Some(likeness(&word_head, &name_head)?.min(like(&word, &name)?))
        }
        // One whose table was forgotten is less like it than one that is like it as it stands.
        (None, Some((_, tail))) => like(word, &tail).map(|likeness| likeness * 9 / 10),
        (_, None) => like(word, name),
    }
}

/// The same of words without parts.
fn like(word: &str, name: &str) -> Option<usize> {
    let plain = |text: &str| text.replace(['_', '-', ' '], "");
    if plain(word) == plain(name) {
        return Some(1000);
    }
    let (length, name_length) = (word.chars().count(), name.chars().count());
    let (shorter, longer) = (length.min(name_length), length.max(name_length));
    if shorter < BEGINNING_MIN {
        return None;
    }
    let slips = strsim::damerau_levenshtein(word, name);
    let begins_alike = word.chars().next() == name.chars().next();
    // One slip in three letters, and more than one only in a word that begins as it should.
    if slips == 1 || (begins_alike && 3 * slips <= shorter + 1) {
        return Some(1000 - 1000 * slips / (1 + shorter));
    }
    let share = 100 * shorter / longer;
    let is_beginning = name.starts_with(word) || (word.starts_with(name) && 50 <= share);
    if is_beginning {
        return Some(600 + share);
    }
    // A whole word of several: `battery` for `robot_battery`.
    let is_part = name.split(['_', '-']).any(|part| part == word);
    is_part.then_some(500 + share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERBS: [&str; 24] = [
        "up",
        "check",
        "pair",
        "units",
        "doctor",
        "clear",
        "down",
        "status",
        "logs",
        "restart",
        "stop",
        "start",
        "events",
        "estop",
        "arm",
        "why",
        "topic",
        "node",
        "lifecycle",
        "param",
        "graph",
        "report",
        "teleop",
        "view",
    ];
    const TOPICS: [&str; 8] = [
        "scan",
        "joint_states",
        "odom",
        "cmd_vel",
        "battery_state",
        "sensor_pair",
        "controller/status",
        "odometry/status",
    ];
    const KEYS: [&str; 6] = [
        "input_age_max_s",
        "wall_following.speed_m_s",
        "wall_following.turn_speed_rad_s",
        "wall_following.front_threshold_m",
        "corridor_following.speed_m_s",
        "corridor_following.track_m",
    ];

    #[test]
    fn what_is_suggested_is_what_a_person_may_have_meant() {
        for (names, word, meant) in [
            (&VERBS[..], "topics", &["topic"][..]),
            (&VERBS, "tpoic", &["topic"]),
            (&VERBS, "stpo", &["stop"]),
            (&VERBS, "estpo", &["estop"]),
            (&VERBS, "e-stop", &["estop"]),
            (&VERBS, "staus", &["status"]),
            (&VERBS, "parm", &["param"]),
            (&VERBS, "log", &["logs"]),
            (&VERBS, "life", &["lifecycle"]),
            (&VERBS, "restat", &["restart"]),
            (&VERBS, "doctr", &["doctor"]),
            (&VERBS, "nodes", &["node"]),
            (&VERBS, "quit", &[]),
            (&VERBS, "echo", &[]),
            (&VERBS, "list", &[]),
            (&VERBS, "record", &["report"]),
            (&VERBS, "pause", &[]),
            (&VERBS, "monitor", &[]),
            (&VERBS, "watch", &[]),
            (&VERBS, "x", &[]),
            (&TOPICS, "scna", &["scan"]),
            (&TOPICS, "scans", &["scan"]),
            (&TOPICS, "Scan", &["scan"]),
            (&TOPICS, "jointstates", &["joint_states"]),
            (&TOPICS, "joint_state", &["joint_states"]),
            (&TOPICS, "odometry", &["odom"]),
            (&TOPICS, "cmdvel", &["cmd_vel"]),
            (&TOPICS, "cmd", &["cmd_vel"]),
            (&TOPICS, "battery", &["battery_state"]),
            (&TOPICS, "contoller/status", &["controller/status"]),
            (&TOPICS, "image", &[]),
            (&TOPICS, "map", &[]),
            (&TOPICS, "tf", &[]),
            (&KEYS, "wall_following.sped_m_s", &["wall_following.speed_m_s"]),
            (&KEYS, "wall_following.speed", &["wall_following.speed_m_s"]),
            (&KEYS, "wal_following.speed_m_s", &["wall_following.speed_m_s"]),
            (&KEYS, "speed_m_s", &["wall_following.speed_m_s", "corridor_following.speed_m_s"]),
            (&KEYS, "track", &["corridor_following.track_m"]),
            (&KEYS, "wall_following.nonsense", &[]),
            (&KEYS, "wall_following.gain", &[]),
            (&KEYS, "nonsense.speed_m_s", &[]),
        ] {
            assert_eq!(likely(word, names), meant, "{word}");
        }
    }

    #[test]
    fn a_few_names_are_listed_and_many_are_not() {
        assert_eq!(suggestion("zzz", &["a", "b"]), "allowed: `a`, `b`");
        assert_eq!(suggestion_or("zzz", &TOPICS[..2], "look"), "allowed: `scan`, `joint_states`");
        assert_eq!(suggestion_or("zzz", &VERBS, "look"), "look");
        assert_eq!(suggestion::<&str>("zzz", &[]), "remove it: nothing is allowed here");
    }
}

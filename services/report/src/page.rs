//! The page: the story of a run from top to bottom.

use std::fmt::Write as _;

use serde_json::Value;

use crate::Wall;
use crate::chart::{self, duration};
use crate::run::Run;

const STYLE: &str = "
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fafafa; margin: 0 auto; padding: 24px; max-width: 960px; }
h1 { font-size: 24px; margin: 0; } h2 { font-size: 17px; margin: 36px 0 8px; } h3 { font-size: 14px; margin: 12px 0 0; font-weight: 600; }
p { margin: 4px 0 12px; color: #555; } svg { max-width: 100%; height: auto; background: #fff; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; } td, th { padding: 2px 14px 2px 0; text-align: left; vertical-align: top; }
th { font-weight: 600; border-bottom: 1px solid #ccc; } td.n, th.n { text-align: right; }
.good { color: #00795a; } .bad { color: #b34700; } .pair { display: grid; grid-template-columns: 1fr 1fr; gap: 8px; }
.key { display: inline-block; width: 18px; height: 4px; margin: 0 6px 3px 10px; }
pre { background: #fff; padding: 12px; overflow-x: auto; font-size: 13px; } .map { text-align: center; }
";

/// The whole page.
pub(crate) fn page(run: &Run, walls: &[Wall]) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n",
        escaped(&title(run))
    );
    head(run, &mut page);
    way(run, walls, &mut page);
    motion(run, &mut page);
    latencies(run, &mut page);
    topics(run, &mut page);
    figures(run, &mut page);
    events(run, &mut page);
    parameters(run, &mut page);
    page.push_str("</body>\n</html>\n");
    page
}

fn title(run: &Run) -> String {
    let text = |key: &str| run.receipt[key].as_str().unwrap_or_default().to_owned();
    format!("{}: {}", text("robot"), text("config"))
}

/// How it ended, and what the run was.
fn head(run: &Run, page: &mut String) {
    let receipt = &run.receipt;
    let code = receipt["exit"]["code"].as_u64().unwrap_or_default();
    let cause = receipt["exit"]["cause"].as_str().unwrap_or_default();
    let class = if code == 0 { "good" } else { "bad" };
    let _ = write!(
        page,
        "<h1>{}</h1>\n<p class=\"{class}\">{} (exit {code})</p>\n<table>\n",
        escaped(&title(run)),
        escaped(cause)
    );
    let closes = receipt["counters_close"].as_bool() == Some(true);
    let rows = [
        ("world", plain(&receipt["world"])),
        ("start", plain(&receipt["start"])),
        ("clock", plain(&receipt["clock"])),
        ("seed", plain(&receipt["seed"])),
        ("time", time(receipt)),
        ("distance", unit(&receipt["distance_m"], "m")),
        ("least clearance", unit(&receipt["clearance_min_m"], "m")),
        ("collisions", short(&receipt["collisions"])),
        ("counters", if closes { "close" } else { "do not close" }.to_owned()),
        ("digest", plain(&receipt["digest"])),
    ];
    for (name, value) in rows.iter().filter(|(_, value)| !value.is_empty()) {
        let _ = writeln!(page, "<tr><td>{name}</td><td>{}</td></tr>", escaped(value));
    }
    page.push_str("</table>\n");
}

fn time(receipt: &Value) -> String {
    let wall = receipt["wall_s"].as_f64().unwrap_or_default();
    match (receipt["simulated_s"].as_f64(), receipt["real_time_factor"].as_f64()) {
        (Some(simulated), Some(factor)) => {
            format!("{simulated:.2} s in {wall:.2} s, {factor:.0} times real time")
        }
        _ => format!("{wall:.2} s"),
    }
}

/// Where it drove.
fn way(run: &Run, walls: &[Wall], page: &mut String) {
    let true_way = run.track("simulator");
    let believed = run.believed();
    let tracks: Vec<_> =
        [("where it was", true_way), ("where odometry believed it to be", believed)]
            .into_iter()
            .filter(|(_, track)| !track.is_empty())
            .collect();
    if tracks.is_empty() {
        return;
    }
    page.push_str("<h2>The way</h2>\n<p>In metres; from the green point to the red one.</p>\n");
    page.push_str(&chart::legend(&tracks));
    if let Some(svg) = chart::map(walls, &tracks) {
        let _ = writeln!(page, "<div class=\"map\">{svg}</div>");
    }
}

/// What it did, over the robot's own time.
fn motion(run: &Run, page: &mut String) {
    page.push_str("<h2>Over time</h2>\n<p>In seconds of the robot's own time.</p>\n");
    let of =
        |node: &'static str, name: &'static str, key: &'static str| (name, run.series(node, key));
    let charts = [
        (
            "Clearance: from the robot's rim to the nearest wall",
            "m",
            vec![of("simulator", "clearance", "clearance_m")],
        ),
        (
            "Distance of the walls that the LiDAR sees",
            "m",
            vec![
                of("controller", "left", "left_m"),
                of("controller", "ahead", "front_m"),
                of("controller", "right", "right_m"),
            ],
        ),
        (
            "Speed",
            "m/s",
            vec![
                of("simulator", "driven", "linear_m_s"),
                of("controller", "commanded", "linear_m_s"),
            ],
        ),
        (
            "Turning speed",
            "rad/s",
            vec![
                of("simulator", "driven", "angular_rad_s"),
                of("controller", "commanded", "angular_rad_s"),
            ],
        ),
    ];
    for (name, unit, mut lines) in charts {
        lines.retain(|(_, points)| !points.is_empty());
        if let Some(svg) = chart::over_time(unit, &lines) {
            let _ = writeln!(page, "<h3>{name}</h3>\n{}{svg}", chart::legend(&lines));
        }
    }
    let names = run.states("controller", "activity");
    if let Some(svg) = chart::states(&names, &run.series("controller", "activity")) {
        let _ = writeln!(page, "<h3>What the follower does</h3>\n{svg}");
    }
}

/// How long things took.
fn latencies(run: &Run, page: &mut String) {
    let mut charts = String::new();
    for ((node, name), values) in &run.latencies {
        let count: u64 = values.iter().map(|(_, count)| count).sum();
        let max = values.iter().map(|(value, _)| *value).fold(0.0, f64::max);
        if let Some(svg) = chart::histogram(values) {
            let _ = writeln!(
                charts,
                "<div><h3>{}: {}</h3>\n{count} times, at most {}\n{svg}</div>",
                escaped(node),
                escaped(&name.replace('_', " ")),
                duration(max)
            );
        }
    }
    if !charts.is_empty() {
        let _ =
            writeln!(page, "<h2>How long things took</h2>\n<div class=\"pair\">\n{charts}</div>");
    }
}

/// That every sample is accounted for.
fn topics(run: &Run, page: &mut String) {
    let Some(topics) = run.receipt["topics"].as_object() else { return };
    page.push_str("<h2>Samples</h2>\n<table>\n<tr><th>topic</th><th>from</th><th class=\"n\">sent</th><th class=\"n\">received</th><th class=\"n\">lost</th><th class=\"n\">unread</th></tr>\n");
    for (name, topic) in topics {
        let readers = topic["readers"].as_object().is_some_and(|readers| !readers.is_empty());
        if topic["sent"].as_u64() == Some(0) && !readers {
            continue;
        }
        let _ = write!(
            page,
            "<tr><td>{}</td><td>{}</td>",
            escaped(name),
            escaped(&plain(&topic["publisher"]))
        );
        for key in ["sent", "received", "lost", "unread"] {
            let _ = write!(page, "<td class=\"n\">{}</td>", plain(&topic[key]));
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</table>\n");
}

/// What each node says of itself.
fn figures(run: &Run, page: &mut String) {
    let Some(nodes) = run.receipt["nodes"].as_object() else { return };
    page.push_str("<h2>Figures</h2>\n<table>\n");
    for (node, figures) in nodes {
        let figures = figures.as_object().into_iter().flatten();
        let told: Vec<_> = figures
            .filter(|(_, value)| value.as_f64().is_some_and(|value| value != 0.0))
            .map(|(key, value)| format!("{key} {}", short(value)))
            .collect();
        let told = escaped(&told.join(", "));
        let _ = writeln!(page, "<tr><td>{}</td><td>{told}</td></tr>", escaped(node));
    }
    page.push_str("</table>\n");
}

/// What has happened.
fn events(run: &Run, page: &mut String) {
    let Some(first) = run.events.first() else { return };
    let begin = first["monotonic_s"].as_f64().unwrap_or_default();
    page.push_str("<h2>Events</h2>\n<p>In seconds since the first.</p>\n<table>\n");
    for event in &run.events {
        let since = event["monotonic_s"].as_f64().unwrap_or_default() - begin;
        let node = event["node"].as_str().unwrap_or("robot");
        let text = plain(&event["text"]);
        let (node, text) = (escaped(node), escaped(&text));
        let _ = writeln!(
            page,
            "<tr><td class=\"n\">{since:.3}</td><td>{node}</td><td>{text}</td></tr>"
        );
    }
    page.push_str("</table>\n");
}

/// What it was started with.
fn parameters(run: &Run, page: &mut String) {
    let sets: Vec<_> = run.receipt["sets"].as_array().into_iter().flatten().map(plain).collect();
    if !sets.is_empty() {
        let _ = writeln!(
            page,
            "<h2>On the command line</h2>\n<pre>{}</pre>",
            escaped(&sets.join("\n"))
        );
    }
    if !run.launch.is_empty() {
        let _ = writeln!(page, "<h2>Launch file</h2>\n<pre>{}</pre>", escaped(&run.launch));
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

fn unit(value: &Value, unit: &str) -> String {
    value.as_f64().map(|value| format!("{value:.3} {unit}")).unwrap_or_default()
}

fn short(value: &Value) -> String {
    let value = value.as_f64().unwrap_or_default();
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// As HTML text, whatever it contains.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

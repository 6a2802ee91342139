//! The robot as it stands, for whoever asks.

use std::path::Path;
use std::time::Duration;

use interfaces::{PortStatus, Stamp};
use node::{clock, process};
use serde_json::{Value, json};

use crate::member::Member;
use crate::report::clock_label;
use crate::supervise::Supervisor;

/// Everything, as the control socket tells it.
pub(crate) fn status(supervisor: &Supervisor<'_>) -> Value {
    let now = clock::now();
    let uptime = now.since(supervisor.started);
    let launch = supervisor.settings.launch();
    let memory = supervisor.namespace.shared_memory();
    let nodes: Vec<_> =
        (0..supervisor.members.len()).map(|node| of_node(supervisor, node, now)).collect();
    json!({
        "robot": launch.robot,
        "state": state(supervisor),
        "config": supervisor.options.config.display().to_string(),
        "directory": std::env::current_dir().ok().map(|path| path.display().to_string()),
        "sets": supervisor.options.sets(),
        "world": supervisor.place.world.as_ref().map(|world| absolute(world.path())),
        "start": supervisor.place.start,
        "clock": clock_label(launch.clock),
        "seed": launch.seed,
        "guardian": supervisor.guardian,
        "supervisor": std::process::id(),
        "uptime_s": uptime.as_secs_f64(),
        "ready_after_s": supervisor.ready_after.map(|after| after.as_secs_f64()),
        "memory_kib": process::memory_kib(std::process::id(), "VmRSS:"),
        "cpu_percent": cpu_percent(uptime),
        "shared_memory": {
            "files": memory.files,
            "bytes": memory.bytes,
            "need": node::Namespace::need(launch),
            "free": node::Namespace::free().ok(),
        },
        "ignored": { "notify": supervisor.notify.ignored(), "control": supervisor.desk.ignored() },
        "log": {
            "dropped": supervisor.log_book.dropped(),
            "disk": supervisor.log_book.disk_errors().map(|(count, why)| format!("{count} lines lost: {why}")),
        },
        "motion": supervisor.motion.status(),
        "nodes": nodes,
    })
}

/// For one who stands in another directory.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

fn state(supervisor: &Supervisor<'_>) -> &'static str {
    let machine = &supervisor.machine;
    if machine.is_ending() {
        "ending"
    } else if machine.is_ready() {
        "ready"
    } else if supervisor.ready_after.is_none() {
        "starting"
    } else {
        "degraded"
    }
}

fn of_node(supervisor: &Supervisor<'_>, node: usize, now: Stamp) -> Value {
    let member = &supervisor.members[node];
    let view = supervisor.machine.node(node);
    let topics: Vec<_> = member
        .flow
        .rates()
        .map(|(topic, rate)| json!({ "topic": topic, "hz": rate.map(|rate| (rate * 10.0).round() / 10.0) }))
        .collect();
    let failure = supervisor.last_failures[node].as_ref();
    json!({
        "name": member.name,
        "state": view.state.label(),
        "doing": view.doing.describe(now),
        "pid": pid(member),
        "epoch": view.epoch,
        "uptime_s": member.lives().then(|| now.since(view.since).as_secs_f64()),
        "restarts": view.restarts,
        "stalled": member.flow.stalled(now),
        "topics": topics,
        "ports": member.status.ports().iter().map(of_port).collect::<Vec<_>>(),
        "values": values(member),
        "changed": supervisor.tuning.changed(node, view.epoch),
        "text": text(member),
        "last_failure": failure.map(|(at, what)| json!({ "what": what, "ago_s": now.since(*at).as_secs_f64() })),
    })
}

/// What it publishes and reads, in this life or the last one.
fn of_port(port: &PortStatus) -> Value {
    json!({
        "topic": port.topic.as_str(),
        "publishes": port.publishes == 1,
        "samples": port.samples,
        "lost": port.lost,
        "unread": port.unread,
        "stale": port.stale,
    })
}

/// What it says about itself in figures; JSON knows no NaN and no infinity, and says null.
fn values(member: &Member) -> Value {
    let values = member.status.values().iter();
    values.map(|value| (value.key.to_string(), json!(value.value))).collect()
}

/// Its process; a node in a thread has the supervisor's.
fn pid(member: &Member) -> Option<u32> {
    member.pid().or_else(|| member.lives().then(std::process::id))
}

fn text(member: &Member) -> &str {
    if member.says.is_empty() { member.status.text.as_str() } else { &member.says }
}

/// [%] Of one processor, since the supervisor's start.
fn cpu_percent(uptime: Duration) -> f64 {
    let used = process::processor_s(std::process::id()).unwrap_or_default();
    let percent = used / uptime.as_secs_f64().max(1e-3) * 100.0;
    (percent * 100.0).round() / 100.0
}

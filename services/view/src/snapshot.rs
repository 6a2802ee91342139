//! Everything that the screen knows, as JSON: for programs.

use std::time::Duration;

use serde_json::{Value, json};

use crate::state::{Event, NodeRow, State, TopicRow};

/// One look at the robot. What is not known is null; durations are in milliseconds where the key says
/// so.
pub(crate) fn snapshot(state: &State) -> Value {
    let supervisor = &state.supervisor;
    let motion = &state.motion;
    let place = &state.place;
    let odometry = place.odometry();
    let unmatched = state
        .unmatched()
        .into_iter()
        .map(|(topic, reason, count)| json!({ "topic": topic, "reason": reason, "count": count }));
    json!({
        "robot": state.robot,
        "state": supervisor.state,
        "clock": supervisor.clock.map(|clock| match clock {
            node::Clock::Lockstep => "lockstep",
            node::Clock::Realtime => "realtime",
        }),
        "config": supervisor.config,
        "uptime_s": supervisor.uptime_s,
        "shared_memory": { "files": supervisor.files, "bytes": supervisor.bytes },
        "motion": {
            "permission": motion.permission,
            "cause": motion.cause,
            "needs_person": motion.needs_person,
            "emergency_stop": motion.emergency_stop,
            "trips": motion.trips,
        },
        "pose": place.pose().map(|pose| json!({
            "x_m": pose.x,
            "y_m": pose.y,
            "yaw_rad": pose.yaw,
            "is_known": place.is_known(),
        })),
        "linear_m_s": odometry.map(|odometry| odometry.linear),
        "angular_rad_s": odometry.map(|odometry| odometry.angular),
        "walls": place.map.as_ref().map_or(0, |map| map.walls.len()),
        "returns": place.returns.len(),
        "nodes": state.nodes.iter().map(node).collect::<Vec<_>>(),
        "topics": state.topics().iter().map(topic).collect::<Vec<_>>(),
        "pairing": { "pairs": state.pairs(), "unmatched": unmatched.collect::<Vec<_>>() },
        "scan_to_wheel": state.age().map(|age| json!({
            "p50_us": age.p50,
            "p99_us": age.p99,
            "max_us": age.max,
            "lately": state.ages.steps().into_iter().map(|(bound, count)| {
                json!({ "up_to_us": bound, "count": count })
            }).collect::<Vec<_>>(),
        })),
        "events": state.events.iter().map(event).collect::<Vec<_>>(),
    })
}

fn node(node: &NodeRow) -> Value {
    json!({
        "name": node.name,
        "state": node.state,
        "doing": node.doing,
        "pid": node.pid,
        "epoch": node.epoch,
        "uptime_s": node.uptime_s,
        "restarts": node.restarts,
        "cpu_percent": node.cpu_percent,
        "memory_kib": node.memory_kib,
        "last_failure": node.last_failure,
    })
}

fn topic(topic: &TopicRow) -> Value {
    let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
    json!({
        "name": topic.name,
        "publisher": topic.publisher,
        "readers": topic.readers,
        "hz": topic.rate,
        "age_ms": topic.age.map(milliseconds),
        "jitter_ms": topic.jitter.map(milliseconds),
        "sent": topic.sent,
        "lost": topic.lost,
        "unread": topic.unread,
        "stale": topic.stale,
    })
}

fn event(event: &Event) -> Value {
    json!({ "time": event.time, "node": event.node, "kind": event.kind, "text": event.text })
}

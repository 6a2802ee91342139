//! In which order processes start, and why there may be none.

use super::Process;
use crate::config::{self, Report};

/// The processes by index, each after all that it names, else in the order of the file.
pub(super) fn start_order(processes: &[Process]) -> Vec<usize> {
    let mut order = Vec::with_capacity(processes.len());
    while order.len() < processes.len() {
        let is_ready = |index: &usize| {
            !order.contains(index)
                && named_by(&processes[*index])
                    .filter_map(|name| index_of(processes, name))
                    .all(|before| order.contains(&before))
        };
        let next = (0..processes.len()).find(is_ready);
        // Without one there is a cycle, which a launch file that was checked does not have.
        let Some(next) = next else { return (0..processes.len()).collect() };
        order.push(next);
    }
    order
}

/// Refuses names that nobody has, and cycles, which are told as a path.
pub(super) fn check(processes: &[Process], report: &mut Report<'_>) {
    for (index, process) in processes.iter().enumerate() {
        for (key, names) in [("after", &process.after), ("requires", &process.requires)] {
            for (position, name) in names.iter().enumerate() {
                if index_of(processes, name).is_none() {
                    let others = processes.iter().map(|process| process.name.as_str());
                    let others: Vec<_> = others.filter(|other| *other != process.name).collect();
                    let help = config::suggestion(name, &others);
                    let message = format!("there is no process `{name}`");
                    report.refuse(format!("process[{index}].{key}[{position}]"), message, help);
                }
            }
        }
    }
    if let Some(cycle) = find_cycle(processes) {
        let first = cycle[0];
        let path: Vec<_> = cycle.iter().map(|&index| processes[index].name.as_str()).collect();
        let path = format!("{} -> {}", path.join(" -> "), processes[first].name);
        let next = &processes[*cycle.get(1).unwrap_or(&first)].name;
        let position = |names: &[String]| names.iter().position(|name| name == next);
        let key = match (position(&processes[first].after), position(&processes[first].requires)) {
            (Some(position), _) => format!("after[{position}]"),
            (None, Some(position)) => format!("requires[{position}]"),
            (None, None) => unreachable!("each in a cycle names the next"),
        };
        let message = format!("nobody can be first: {path} (each starts after the next)");
        let help = "take one of these names out of an `after` or `requires`";
        report.refuse(format!("process[{first}].{key}"), message, help);
    }
}

/// Processes each of which starts after the next, and the last after the first.
fn find_cycle(processes: &[Process]) -> Option<Vec<usize>> {
    let mut done = vec![false; processes.len()];
    (0..processes.len()).find_map(|start| visit(start, processes, &mut Vec::new(), &mut done))
}

fn visit(
    index: usize,
    processes: &[Process],
    path: &mut Vec<usize>,
    done: &mut [bool],
) -> Option<Vec<usize>> {
    if let Some(begin) = path.iter().position(|&before| before == index) {
        return Some(path[begin..].to_vec());
    }
    if done[index] {
        return None;
    }
    path.push(index);
    let mut before = named_by(&processes[index]).filter_map(|name| index_of(processes, name));
    let cycle = before.find_map(|before| visit(before, processes, path, done));
    path.pop();
    done[index] = true;
    cycle
}

fn named_by(process: &Process) -> impl Iterator<Item = &str> {
    process.after.iter().chain(&process.requires).map(String::as_str)
}

fn index_of(processes: &[Process], name: &str) -> Option<usize> {
    processes.iter().position(|process| process.name == name)
}

//! The nodes: state, processor, memory, restarts, epoch.

use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Text;
use ratatui::widgets::{Row, Table};

use super::{Look, span_of};
use crate::keys::Desk;
use crate::state::{NodeRow, State};

/// [character] What the table needs, its frame included.
pub(super) const WIDTH: u16 = 46;

/// [character] What the table of everything needs.
pub(super) const WIDTH_FULL: u16 = 84;

/// [character] Lines of the table, its frame included.
pub(super) fn height(state: &State) -> u16 {
    u16::try_from(state.nodes.len()).unwrap_or(u16::MAX).saturating_add(3)
}

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, state: &State, desk: &Desk, look: Look) {
    let head = ["node", "state", "cpu%", "MiB", "rst", "ep"].map(right_but(2));
    let rows = state.nodes.iter().enumerate().map(|(index, node)| {
        let cells = [
            Text::from(node.name.clone()),
            Text::styled(node.state.clone(), of_state(&node.state, look)),
            right(cpu(node, look)),
            right(memory(node, look)),
            right(node.restarts.to_string()),
            right(node.epoch.to_string()),
        ];
        Row::new(cells).style(of_chosen(index, desk))
    });
    let widths = [
        Constraint::Min(11),
        Constraint::Length(10),
        Constraint::Length(5),
        Constraint::Length(6),
        Constraint::Length(3),
        Constraint::Length(3),
    ];
    let table = Table::new(rows, widths)
        .header(Row::new(head).style(look.faint()))
        .block(look.block("nodes"))
        .column_spacing(1);
    frame.render_widget(table, area);
}

/// The same with everything else that is known of each.
pub(super) fn draw_in_full(
    frame: &mut Frame<'_>,
    area: Rect,
    state: &State,
    desk: &Desk,
    look: Look,
) {
    let head = ["node", "state", "pid", "up", "cpu%", "MiB", "rst", "ep", "says"];
    let rows = state.nodes.iter().enumerate().map(|(index, node)| {
        let said = node.last_failure.as_ref().filter(|_| node.text.is_empty());
        let cells = [
            Text::from(node.name.clone()),
            Text::styled(node.state.clone(), of_state(&node.state, look)),
            right(node.pid.map_or(look.none().to_owned(), |pid| pid.to_string())),
            right(node.uptime_s.map_or(look.none().to_owned(), span_of)),
            right(cpu(node, look)),
            right(memory(node, look)),
            right(node.restarts.to_string()),
            right(node.epoch.to_string()),
            Text::from(said.unwrap_or(&node.text).clone()),
        ];
        Row::new(cells).style(of_chosen(index, desk))
    });
    let widths = [
        Constraint::Length(11),
        Constraint::Length(12),
        Constraint::Length(7),
        Constraint::Length(9),
        Constraint::Length(5),
        Constraint::Length(5),
        Constraint::Length(3),
        Constraint::Length(3),
        Constraint::Fill(1),
    ];
    let table = Table::new(rows, widths)
        .header(Row::new(head.map(right_from_to(2, 8))).style(look.faint()))
        .block(look.block("nodes"));
    frame.render_widget(table, area);
}

fn cpu(node: &NodeRow, look: Look) -> String {
    node.cpu_percent.map_or(look.none().to_owned(), |percent| format!("{percent:.1}"))
}

fn memory(node: &NodeRow, look: Look) -> String {
    node.memory_kib.map_or(look.none().to_owned(), |kib| format!("{:.1}", kib as f64 / 1024.0))
}

pub(super) fn right(text: String) -> Text<'static> {
    Text::from(text).right_aligned()
}

/// Heads over numbers stand to the right: those from this column on.
fn right_but(texts: usize) -> impl FnMut(&'static str) -> Text<'static> {
    right_from_to(texts, usize::MAX)
}

pub(super) fn right_from_to(first: usize, end: usize) -> impl FnMut(&'static str) -> Text<'static> {
    let mut column = 0;
    move |head| {
        let is_number = (first..end).contains(&column);
        column += 1;
        if is_number { Text::from(head).right_aligned() } else { Text::from(head) }
    }
}

fn of_state(state: &str, look: Look) -> Style {
    match state {
        "active" => look.colour(Color::Green),
        "unknown" | "finalized" => look.colour(Color::Red),
        _ => look.colour(Color::Yellow),
    }
}

fn of_chosen(index: usize, desk: &Desk) -> Style {
    if index == desk.node { Style::new().add_modifier(Modifier::BOLD) } else { Style::new() }
}

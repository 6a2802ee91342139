//! What has happened, the newest at the bottom.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::Look;
use crate::state::{Event, State};

/// [character] From here on there is room for the time's milliseconds, and for what is routine.
const WIDE: u16 = 70;

/// Kinds of events that every start of a node has. A node is back within a tenth of a second: where
/// there is room for a few lines only, these would hide why it had to come back.
const ROUTINE: [&str; 3] = ["spawned", "changed", "flowing"];

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, state: &State, look: Look) {
    let block = look.block("events");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let room = usize::from(inner.height);
    let is_told = |event: &&Event| WIDE <= inner.width || !ROUTINE.contains(&event.kind.as_str());
    let mut lines: Vec<_> = state.events.iter().rev().filter(is_told).take(room).collect();
    lines.reverse();
    let lines: Vec<_> = lines.into_iter().map(|event| line(event, inner.width, look)).collect();
    frame.render_widget(Paragraph::new(lines), inner);
}

fn line(event: &Event, width: u16, look: Look) -> Line<'static> {
    let cut = if WIDE <= width { event.time.len() } else { "12:34:56".len() };
    let time = event.time.get(..cut).unwrap_or(&event.time);
    // Where there is little room, the cause comes first.
    let text = match event.text.strip_prefix("failed: was ") {
        Some(cause) if width < WIDE => cause,
        Some(_) | None => &event.text,
    };
    let text: String = text.chars().filter(|character| !character.is_control()).collect();
    let text = if look.ascii { text.replace(|c: char| !c.is_ascii(), "?") } else { text };
    Line::from(vec![
        Span::styled(format!("{time} "), look.faint()),
        Span::raw(format!("{} ", event.node)),
        Span::styled(text, of_kind(&event.kind, look)),
    ])
}

fn of_kind(kind: &str, look: Look) -> Style {
    match kind {
        "failed" | "stalled" | "signalled" | "refused" => look.colour(Color::Red),
        "ready" => look.colour(Color::Green),
        "motion" | "restarting" | "taking-down" | "going-down" => look.colour(Color::Yellow),
        _ => Style::new(),
    }
}

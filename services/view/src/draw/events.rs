//! What has happened, the newest at the bottom.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::Look;
use crate::state::{Event, State};

/// [character] From here on there is room for the date's milliseconds.
const WIDE: u16 = 70;

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, state: &State, look: Look) {
    let block = look.block("events");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let room = usize::from(inner.height);
    let newest = state.events.iter().skip(state.events.len().saturating_sub(room));
    let lines: Vec<_> = newest.map(|event| line(event, inner.width, look)).collect();
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

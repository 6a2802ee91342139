//! The topics: rate, age, jitter, loss.

use std::time::Duration;

use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Style};
use ratatui::text::Text;
use ratatui::widgets::{Row, Table};

use super::Look;
use super::nodes::{right, right_from_to};
use crate::state::TopicRow;

/// [character] Lines of the table, its frame included.
pub(super) fn height(topics: &[TopicRow]) -> u16 {
    u16::try_from(topics.len()).unwrap_or(u16::MAX).saturating_add(3)
}

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, topics: &[TopicRow], look: Look) {
    let head = ["topic", "Hz", "age ms", "jit ms", "lost"].map(right_from_to(1, usize::MAX));
    let rows = topics.iter().map(|topic| {
        Row::new([
            Text::from(topic.name.clone()),
            right(rate(topic, look)),
            right(milliseconds(topic.age, look)),
            right(milliseconds(topic.jitter, look)),
            right(topic.lost.to_string()).style(of_loss(topic.lost, look)),
        ])
    });
    let widths = [
        Constraint::Min(13),
        Constraint::Length(7),
        Constraint::Length(7),
        Constraint::Length(7),
        Constraint::Length(6),
    ];
    let table = Table::new(rows, widths)
        .header(Row::new(head).style(look.faint()))
        .block(look.block("topics"));
    frame.render_widget(table, area);
}

/// The same with who reads it, and what came of its samples.
pub(super) fn draw_in_full(frame: &mut Frame<'_>, area: Rect, topics: &[TopicRow], look: Look) {
    let head = ["topic", "Hz", "age ms", "jit ms", "sent", "lost", "unread", "stale", "readers"];
    let rows = topics.iter().map(|topic| {
        let readers = topic.readers.join(" ");
        Row::new([
            Text::from(topic.name.clone()),
            right(rate(topic, look)),
            right(milliseconds(topic.age, look)),
            right(milliseconds(topic.jitter, look)),
            right(topic.sent.to_string()),
            right(topic.lost.to_string()).style(of_loss(topic.lost, look)),
            right(topic.unread.to_string()),
            right(topic.stale.to_string()),
            Text::from(readers),
        ])
    });
    let widths = [
        Constraint::Length(16),
        Constraint::Length(6),
        Constraint::Length(6),
        Constraint::Length(6),
        Constraint::Length(8),
        Constraint::Length(5),
        Constraint::Length(6),
        Constraint::Length(5),
        Constraint::Fill(1),
    ];
    let table = Table::new(rows, widths)
        .header(Row::new(head.map(right_from_to(1, 8))).style(look.faint()))
        .block(look.block("topics"));
    frame.render_widget(table, area);
}

fn rate(topic: &TopicRow, look: Look) -> String {
    topic.rate.map_or(look.none().to_owned(), |rate| format!("{rate:.1}"))
}

fn milliseconds(duration: Option<Duration>, look: Look) -> String {
    let Some(duration) = duration else { return look.none().to_owned() };
    let milliseconds = duration.as_secs_f64() * 1e3;
    match milliseconds {
        small if small < 10.0 => format!("{small:.2}"),
        medium if medium < 1e3 => format!("{medium:.0}"),
        large if large < 1e6 => format!("{:.0} s", large / 1e3),
        _ => ">1000 s".to_owned(),
    }
}

fn of_loss(lost: u64, look: Look) -> Style {
    if lost == 0 { Style::new() } else { look.colour(Color::Red) }
}

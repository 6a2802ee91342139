//! What found a partner and what did not, and how old the data at the wheels is.

use std::fmt::Write;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Color;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::Look;
use crate::state::State;

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, state: &State, look: Look) {
    let pairs = state.pairs().map_or(look.none().to_owned(), |pairs| format!("{pairs:.0}"));
    let block = look.block(&format!("pairs {pairs}"));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let lines = state.unmatched().into_iter().map(|(topic, reason, count)| {
        let count = format!("{count:.0}");
        let width = usize::from(inner.width).saturating_sub(count.len() + 1);
        let label: String = format!("{topic} {reason}").chars().take(width).collect();
        let style = if count == "0" { look.faint() } else { look.colour(Color::Yellow) };
        Line::from(Span::styled(format!("{label:<width$} {count}"), style))
    });
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()), inner);
}

/// From the scan to the wheels.
pub(super) fn draw_age(frame: &mut Frame<'_>, area: Rect, state: &State, look: Look) {
    let block = look.block("scan to wheel, ms");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let Some(age) = state.age() else {
        let nothing = Span::styled("no command yet", look.faint());
        return frame.render_widget(Paragraph::new(nothing), inner);
    };
    let [p50, p99, max] = [age.p50, age.p99, age.max].map(|us| format!("{:.2}", us / 1e3));
    let mut figures = format!("p50 {p50}  p99 {p99}");
    if figures.len() + max.len() + 6 <= usize::from(inner.width) {
        let _ = write!(figures, "  max {max}");
    }
    let mut lines = vec![Line::from(figures)];
    lines.extend(bars(&state.ages.steps(), inner.width, inner.height.saturating_sub(2), look));
    frame.render_widget(Paragraph::new(lines), inner);
}

/// A column for each step, by the logarithm of its commands: the few that are late are what matters.
fn bars(steps: &[(Option<f64>, f64)], width: u16, rows: u16, look: Look) -> Vec<Line<'static>> {
    let Some(each) = usize::from(width).checked_div(steps.len()).filter(|each| 0 < *each) else {
        return Vec::new();
    };
    let height = |count: f64| libm::log2(1.0 + count.max(0.0));
    let highest = steps.iter().map(|(_, count)| height(*count)).fold(1.0, f64::max);
    let eighths = 8.0 * f64::from(rows) / highest;
    let mut lines = Vec::new();
    for row in (0..usize::from(rows)).rev() {
        let mut line = String::new();
        for (_, count) in steps {
            let below = 8 * row;
            let bar = look.bar(whole(height(*count) * eighths).saturating_sub(below));
            // Between two bars is a gap, where there is room for one.
            let thick = each.saturating_sub(usize::from(2 < each));
            line.extend(std::iter::repeat_n(bar, thick));
            line.extend(std::iter::repeat_n(' ', each - thick));
        }
        lines.push(Line::from(Span::styled(line, look.colour(Color::Cyan))));
    }
    let mut axis = String::new();
    for (index, (bound, _)) in steps.iter().enumerate() {
        let label = match bound {
            // One of three: 0.1, 1, 10, 100.
            Some(us) if index % 3 == 0 => format!("{}", us / 1e3).replace("0.", "."),
            Some(_) => String::new(),
            None => ">".to_owned(),
        };
        while axis.len() < index * each {
            axis.push(' ');
        }
        axis.push_str(&label);
    }
    lines.push(Line::from(Span::styled(axis, look.faint())));
    lines
}

fn whole(number: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let whole = number.ceil() as usize;
    whole
}

//! From what is known to a frame: pure, the same state is the same frame.

mod events;
mod looks;
mod map;
mod nodes;
mod pairing;
mod topics;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Color;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use crate::keys::{Desk, Panel};
use crate::state::State;
pub use looks::Look;

/// [character] The least that everything has room in.
pub(crate) const SIZE_MIN: (u16, u16) = (80, 24);

/// [character] From here on there is room for all panels beside the map.
const TALL: u16 = 36;

/// Draws the whole screen.
pub fn draw(frame: &mut Frame<'_>, state: &State, desk: &Desk, look: Look) {
    let area = frame.area();
    if area.width < SIZE_MIN.0 || area.height < SIZE_MIN.1 {
        return too_small(frame, area);
    }
    let [head, body, foot] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)])
            .areas(area);
    header(frame, head, state, desk, look);
    match desk.panel {
        Panel::Overview => overview(frame, body, state, desk, look),
        Panel::Map => map::draw(frame, body, state, look),
        Panel::Nodes => nodes::draw_in_full(frame, body, state, desk, look),
        Panel::Topics => topics::draw_in_full(frame, body, &state.topics(), look),
        Panel::Pairing => {
            let [left, right] = Layout::horizontal([Constraint::Fill(1); 2]).areas(body);
            pairing::draw(frame, left, state, look);
            pairing::draw_age(frame, right, state, look);
        }
        Panel::Events => events::draw(frame, body, state, look),
    }
    footer(frame, foot, state, desk, look);
}

fn too_small(frame: &mut Frame<'_>, area: Rect) {
    let (width, height) = SIZE_MIN;
    let text = format!("needs {width}x{height}, has {}x{}; q quits", area.width, area.height);
    frame.render_widget(Paragraph::new(text).wrap(ratatui::widgets::Wrap { trim: true }), area);
}

/// The map to the left, tables to the right, and below what has happened. Where there is room, what
/// else there is to count is to the right as well.
fn overview(frame: &mut Frame<'_>, body: Rect, state: &State, desk: &Desk, look: Look) {
    let is_tall = TALL <= body.height;
    let low = if is_tall { body.height / 4 } else { 5 };
    let [high, low] = Layout::vertical([Constraint::Fill(1), Constraint::Length(low)]).areas(body);
    // As wide as high, in dots, and never so wide that the tables are cut.
    let square = 2 * (high.height - 2) + 2;
    let map = Constraint::Length(square.min(high.width - nodes::WIDTH));
    let [left, right] = Layout::horizontal([map, Constraint::Fill(1)]).areas(high);
    map::draw(frame, left, state, look);
    let topics = state.topics();
    let [upper, middle, lower] = Layout::vertical([
        Constraint::Length(nodes::height(state).min(high.height / 2)),
        if is_tall { Constraint::Length(topics::height(&topics)) } else { Constraint::Fill(1) },
        if is_tall { Constraint::Fill(1) } else { Constraint::Length(0) },
    ])
    .areas(right);
    if nodes::WIDTH_FULL <= right.width {
        nodes::draw_in_full(frame, upper, state, desk, look);
        topics::draw_in_full(frame, middle, &topics, look);
    } else {
        nodes::draw(frame, upper, state, desk, look);
        topics::draw(frame, middle, &topics, look);
    }
    let (events, reasons, ages) = if is_tall {
        let [reasons, ages] =
            Layout::horizontal([Constraint::Fill(2), Constraint::Fill(3)]).areas(lower);
        (low, reasons, ages)
    } else {
        let widths = [Constraint::Fill(1), Constraint::Length(20), Constraint::Length(26)];
        let [events, reasons, ages] = Layout::horizontal(widths).areas(low);
        (events, reasons, ages)
    };
    events::draw(frame, events, state, look);
    pairing::draw(frame, reasons, state, look);
    pairing::draw_age(frame, ages, state, look);
}

fn header(frame: &mut Frame<'_>, area: Rect, state: &State, desk: &Desk, look: Look) {
    let supervisor = &state.supervisor;
    let gap = look.gap();
    let mut spans = vec![
        Span::styled(" teseo ", Look::title()),
        Span::styled(format!(" {}", state.robot), Look::strong()),
    ];
    if desk.is_paused {
        spans.extend([Span::raw(" "), Span::styled(" PAUSED ", Look::title())]);
    }
    spans.push(Span::raw(gap));
    let name = if supervisor.state.is_empty() { "not heard yet" } else { &supervisor.state };
    let colour = match name {
        "ready" => Color::Green,
        "gone" | "degraded" => Color::Red,
        _ => Color::Yellow,
    };
    spans.push(Span::styled(name.to_owned(), look.colour(colour)));
    if let Some(clock) = supervisor.clock {
        let clock = match clock {
            node::Clock::Lockstep => "lock-step",
            node::Clock::Realtime => "real time",
        };
        spans.push(Span::raw(format!("{gap}{clock}{gap}up {}", span_of(supervisor.uptime_s))));
    }
    spans.extend(motion(state, look));
    if let Some(odometry) = state.place.odometry() {
        let (linear, angular) = (odometry.linear, odometry.angular);
        spans.push(Span::raw(format!("{gap}{linear:.2} m/s {angular:.2} rad/s")));
    }
    frame.render_widget(Paragraph::new(Line::from(spans)), area);
}

/// Whether it may move.
fn motion(state: &State, look: Look) -> Vec<Span<'static>> {
    let motion = &state.motion;
    if motion.permission.is_empty() {
        return Vec::new();
    }
    let (colour, text) = match motion.permission.as_str() {
        "armed" => (Color::Green, "armed".to_owned()),
        other if motion.needs_person => (Color::Red, format!("{other}: {}, a arms", motion.cause)),
        other => (Color::Red, format!("{other}: {}", motion.cause)),
    };
    vec![Span::raw(look.gap()), Span::styled(text, look.colour(colour))]
}

fn footer(frame: &mut Frame<'_>, area: Rect, state: &State, desk: &Desk, look: Look) {
    let keys = if desk.note.is_empty() && state.supervisor.state == "gone" {
        " the robot is down; q leaves, and a new run of it is shown here".to_owned()
    } else if desk.note.is_empty() {
        let stop = if state.motion.emergency_stop { "c clear stop" } else { "e stop" };
        format!(" q quit  p pause  tab panel  n node  r restart  a arm  {stop}")
    } else {
        format!(" {}", desk.note)
    };
    let style = if desk.note.is_empty() { look.faint() } else { look.colour(Color::Yellow) };
    frame.render_widget(Paragraph::new(Span::styled(keys, style)), area);
    let panels: Vec<_> = (1..)
        .zip(Panel::ALL)
        .map(|(number, panel)| (panel, format!("{number}{} ", panel.label())))
        .collect();
    let width: usize = panels.iter().map(|(_, text)| text.len()).sum();
    let width = u16::try_from(width).unwrap_or(u16::MAX);
    // Where there is room for both.
    if area.width < 72 + width {
        return;
    }
    let right = Rect { x: area.right() - width, width, ..area };
    let spans = panels.into_iter().map(|(panel, text)| {
        let style = if panel == desk.panel { Look::strong() } else { look.faint() };
        Span::styled(text, style)
    });
    frame.render_widget(Paragraph::new(spans.collect::<Line<'_>>()), right);
}

/// [s] As people write it.
fn span_of(seconds: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let whole = seconds as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{}:{:02} min", whole / 60, whole % 60),
        _ => format!("{}:{:02} h", whole / 3600, whole / 60 % 60),
    }
}

#[cfg(test)]
mod tests;

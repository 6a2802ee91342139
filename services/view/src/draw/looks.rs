//! What things look like: with colours or without, in Unicode or in ASCII.

use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::border;
use ratatui::text::Span;
use ratatui::widgets::Block;

use crate::raster::Ink;

/// How a terminal can be drawn on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Look {
    /// Nothing but ASCII.
    pub ascii: bool,
    /// No colours.
    pub plain: bool,
}

const ASCII_BORDER: border::Set<'_> = border::Set {
    top_left: "+",
    top_right: "+",
    bottom_left: "+",
    bottom_right: "+",
    vertical_left: "|",
    vertical_right: "|",
    horizontal_top: "-",
    horizontal_bottom: "-",
};

impl Look {
    /// As the environment has it: `NO_COLOR`, and a locale that is not UTF-8.
    pub fn of_environment(ascii: bool) -> Self {
        let of = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let locale = of("LC_ALL").or_else(|| of("LC_CTYPE")).or_else(|| of("LANG"));
        let locale = locale.unwrap_or_default().to_lowercase();
        let is_utf8 = locale.contains("utf-8") || locale.contains("utf8");
        Self { ascii: ascii || !is_utf8, plain: of("NO_COLOR").is_some() }
    }

    pub(crate) fn colour(self, colour: Color) -> Style {
        if self.plain { Style::new() } else { Style::new().fg(colour) }
    }

    pub(crate) fn strong() -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    pub(crate) fn faint(self) -> Style {
        self.colour(Color::DarkGray)
    }

    pub(crate) fn title() -> Style {
        Style::new().add_modifier(Modifier::REVERSED | Modifier::BOLD)
    }

    pub(crate) fn ink(self, ink: Ink) -> Style {
        match ink {
            Ink::Wall => self.colour(Color::Gray),
            Ink::Trail => self.colour(Color::Blue),
            Ink::Return => self.colour(Color::Red),
            Ink::Robot => self.colour(Color::Green).add_modifier(Modifier::BOLD),
        }
    }

    /// Between two words of a line.
    pub(crate) const fn gap(self) -> &'static str {
        if self.ascii { " - " } else { " · " }
    }

    /// What stands for a number that there is not.
    pub(crate) const fn none(self) -> &'static str {
        if self.ascii { "-" } else { "–" }
    }

    /// A frame with something written into its upper edge.
    pub(crate) fn block<'a>(self, title: &str) -> Block<'a> {
        let set = if self.ascii { ASCII_BORDER } else { border::ROUNDED };
        Block::bordered()
            .border_set(set)
            .border_style(self.faint())
            .title(Span::styled(format!(" {title} "), Self::strong().fg(Color::Reset)))
    }

    /// A bar of so many eighths of a character's height.
    pub(crate) fn bar(self, eighths: usize) -> char {
        let eighths = eighths.min(8);
        if self.ascii {
            [' ', '.', '.', ':', ':', '|', '|', '#', '#'][eighths]
        } else {
            [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'][eighths]
        }
    }
}

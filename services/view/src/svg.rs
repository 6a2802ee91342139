//! A frame as a picture: what a terminal would show, as SVG, without any font for its drawings.

use std::fmt::Write;

use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};

/// [px] Of a character.
const WIDTH: f64 = 8.0;
const HEIGHT: f64 = 16.0;

/// [px] Around everything.
const MARGIN: f64 = 8.0;

/// By row and column of a character's dots: its bit in a braille pattern.
const BITS: [[u32; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

const BACKGROUND: &str = "#14171c";
const FOREGROUND: &str = "#d6d9de";

/// Draws `buffer`. Dots, lines and bars are drawn as such: no font has them all, and none that has
/// them has them as wide as its letters.
pub(crate) fn svg(buffer: &Buffer) -> String {
    let (columns, rows) = (buffer.area.width, buffer.area.height);
    let width = f64::from(columns) * WIDTH + 2.0 * MARGIN;
    let height = f64::from(rows) * HEIGHT + 2.0 * MARGIN;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans Mono, Menlo, Consolas, \
         monospace\" font-size=\"13\" xml:space=\"preserve\">\n\
         <rect width=\"{width}\" height=\"{height}\" rx=\"6\" fill=\"{BACKGROUND}\"/>\n"
    );
    for row in 0..rows {
        let cells: Vec<_> = (0..columns).map(|column| &buffer[(column, row)]).collect();
        let y = f64::from(row) * HEIGHT + MARGIN;
        let mut column = 0;
        while column < cells.len() {
            let x = column as f64 * WIDTH + MARGIN;
            let length = same(&cells[column..]);
            run(&mut svg, &cells[column..column + length], x, y);
            column += length;
        }
    }
    svg.push_str("</svg>\n");
    svg
}

/// [-] How many cells from the first on look alike; a drawing is alone.
fn same(cells: &[&Cell]) -> usize {
    let first = cells[0];
    if is_drawn(first) {
        return 1;
    }
    let is_same = |cell: &&&Cell| {
        !is_drawn(cell) && (cell.fg, cell.bg, cell.modifier) == (first.fg, first.bg, first.modifier)
    };
    cells.iter().take_while(is_same).count()
}

fn is_drawn(cell: &Cell) -> bool {
    character(cell).is_some_and(|character| ('\u{2500}'..='\u{28ff}').contains(&character))
}

fn character(cell: &Cell) -> Option<char> {
    cell.symbol().chars().next()
}

fn run(svg: &mut String, cells: &[&Cell], x: f64, y: f64) {
    let first = cells[0];
    let (mut ink, mut paper) = (colour(first.fg, FOREGROUND), colour(first.bg, BACKGROUND));
    if first.modifier.contains(Modifier::REVERSED) {
        (ink, paper) = (paper, ink);
    }
    let width = cells.len() as f64 * WIDTH;
    if paper != BACKGROUND {
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{HEIGHT}\" fill=\"{paper}\"/>"
        );
    }
    if is_drawn(first) {
        return drawing(svg, character(first).unwrap_or(' '), x, y, ink);
    }
    let text: String = cells.iter().map(|cell| cell.symbol()).collect();
    let start = text.chars().take_while(|character| *character == ' ').count();
    let text = text.trim();
    if text.is_empty() {
        return;
    }
    let bold = first.modifier.contains(Modifier::BOLD);
    let weight = if bold { " font-weight=\"bold\"" } else { "" };
    let (x, length) = (x + start as f64 * WIDTH, text.chars().count() as f64 * WIDTH);
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let baseline = y + 12.5;
    let _ = writeln!(
        svg,
        "<text x=\"{x}\" y=\"{baseline}\" style=\"white-space: pre\" textLength=\"{length}\" \
         lengthAdjust=\"spacingAndGlyphs\" fill=\"{ink}\"{weight}>{text}</text>"
    );
}

/// Lines, bars and dots.
fn drawing(svg: &mut String, character: char, x: f64, y: f64, ink: &str) {
    let mut rect = |x: f64, y: f64, width: f64, height: f64| {
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{ink}\"/>"
        );
    };
    let code = u32::from(character);
    if (0x2800..=0x28ff).contains(&code) {
        for (row, bits) in BITS.iter().enumerate() {
            for (column, bit) in bits.iter().enumerate() {
                if code & bit != 0 {
                    rect(x + column as f64 * 4.0 + 0.75, y + row as f64 * 4.0 + 0.75, 2.5, 2.5);
                }
            }
        }
    } else if (0x2581..=0x2588).contains(&code) {
        let height = f64::from(code - 0x2580) * HEIGHT / 8.0;
        rect(x, y + HEIGHT - height, WIDTH, height);
    } else if character == '━' {
        rect(x, y + 5.5, WIDTH, 5.0);
    } else {
        let (left, right, up, down) = arms(character);
        let (middle_x, middle_y) = (x + 3.5, y + 7.5);
        if left || right {
            let from = if left { x } else { middle_x };
            let to = if right { x + WIDTH } else { middle_x + 1.0 };
            rect(from, middle_y, to - from, 1.0);
        }
        if up || down {
            let from = if up { y } else { middle_y };
            let to = if down { y + HEIGHT } else { middle_y + 1.0 };
            rect(middle_x, from, 1.0, to - from);
        }
    }
}

/// Where a line goes from the middle of its character: left, right, up, down.
const fn arms(character: char) -> (bool, bool, bool, bool) {
    match character {
        '─' => (true, true, false, false),
        '│' => (false, false, true, true),
        '╭' | '┌' => (false, true, false, true),
        '╮' | '┐' => (true, false, false, true),
        '╰' | '└' => (false, true, true, false),
        '╯' | '┘' => (true, false, true, false),
        _ => (false, false, false, false),
    }
}

fn colour(colour: Color, default: &'static str) -> &'static str {
    match colour {
        Color::Black => "#000000",
        Color::Red | Color::LightRed => "#f2777a",
        Color::Green | Color::LightGreen => "#8fd18b",
        Color::Yellow | Color::LightYellow => "#f0c674",
        Color::Blue | Color::LightBlue => "#6ea8fe",
        Color::Magenta | Color::LightMagenta => "#c39ac9",
        Color::Cyan | Color::LightCyan => "#6fd0d0",
        Color::Gray => "#b4b8c0",
        Color::DarkGray => "#7a808a",
        Color::White => "#ffffff",
        _ => default,
    }
}

#[cfg(test)]
mod tests {
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;

    #[test]
    fn letters_are_text_and_drawings_are_drawn() {
        let mut buffer = Buffer::empty(Rect::new(0, 0, 6, 1));
        buffer.set_string(0, 0, "a<b", Style::new().fg(Color::Red));
        buffer.set_string(4, 0, "⠉│", Style::new());
        let svg = svg(&buffer);

        assert!(svg.contains("fill=\"#f2777a\">a&lt;b</text>"), "{svg}");
        assert_eq!(svg.matches("<rect").count(), 1 + 2 + 1, "{svg}");
        assert_eq!(svg.matches("<text").count(), 1, "{svg}");
    }
}

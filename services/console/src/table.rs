//! Plain text in columns, and numbers as people read them.

use interfaces::topics::Loss;
use node::observe;
pub(crate) use node::say::WIDTH;

/// Rows under a title, each column as wide as its widest cell; what does not fit is cut.
pub(crate) fn table(title: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain([title[column].len()]).max().unwrap_or_default()
    };
    let widths: Vec<_> = (0..title.len()).map(width).collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let padded: Vec<_> =
            cells.zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        cut(padded.join("  ").trim_end(), WIDTH)
    };
    let mut text = line(&mut title.iter().copied());
    for row in rows {
        text.push('\n');
        text.push_str(&line(&mut row.iter().map(String::as_str)));
    }
    text
}

/// The beginning of `text`, and a mark where it goes on.
pub(crate) fn cut(text: &str, width: usize) -> String {
    const MARK: &str = "..";
    if text.chars().count() <= width {
        return text.to_owned();
    }
    text.chars().take(width.saturating_sub(MARK.len())).chain(MARK.chars()).collect()
}

/// A measurement to nine digits, without those that say nothing.
pub(crate) fn number(value: f64) -> String {
    let magnitude = value.abs();
    if !value.is_finite() || magnitude == 0.0 {
        return value.to_string();
    }
    if !(1e-4..1e9).contains(&magnitude) {
        return format!("{value:.3e}");
    }
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A rate: `20.0 Hz`.
pub(crate) fn hertz(rate: f64) -> String {
    format!("{rate:.1} Hz")
}

/// The rate of a topic that is published: one that is latched is sent by occasion, where a rate says
/// nothing.
pub(crate) fn rate(topic: &str, rate: Option<f64>) -> Option<String> {
    let is_latched = observe::row(topic).is_some_and(|row| row.loss == Loss::Latched);
    if is_latched { Some("latched".to_owned()) } else { rate.map(hertz) }
}

/// Several names, or a dash where there is none.
pub(crate) fn listed<T: AsRef<str>>(names: &[T]) -> String {
    if names.is_empty() {
        return "-".to_owned();
    }
    names.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_under_their_titles_and_no_line_is_too_long() {
        let rows = [vec!["scan".to_owned(), "20.0 Hz".to_owned(), "x".repeat(200)]];
        let text = table(&["TOPIC", "RATE", "READERS"], &rows);

        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[0], "TOPIC  RATE     READERS");
        assert!(lines[1].starts_with("scan   20.0 Hz  xxx"), "{text}");
        assert_eq!((lines[1].len(), lines[1].ends_with("..")), (WIDTH, true));
    }

    #[test]
    fn numbers_have_no_digits_that_say_nothing() {
        for (value, text) in [
            (0.0, "0"),
            (0.15, "0.15"),
            (0.1 + 0.2, "0.3"),
            (-2.0, "-2"),
            (1e-7, "1.000e-7"),
            (1e12, "1.000e12"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}

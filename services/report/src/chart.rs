//! Charts, as SVG: values over time, states over time, the way over the map, how long things took.

use std::collections::BTreeMap;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::Wall;

/// One line of a chart: its name and its points.
pub(crate) type Line<'a> = (&'a str, Vec<(f64, f64)>);

/// [px] Of a chart of the page's width.
const WIDTH: u32 = 920;

/// Told apart by whoever sees no red or no green (Okabe and Ito 2008, Color Universal Design).
const COLOURS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

/// What walls and letters are drawn with.
const INK: RGBColor = RGBColor(60, 60, 60);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Values [`unit`] over time [s]; nothing where there is none.
pub(crate) fn over_time(unit: &str, lines: &[Line<'_>]) -> Option<String> {
    let points =
        || lines.iter().flat_map(|(_, points)| points).filter(|(_, value)| value.is_finite());
    let time = range(points().map(|(time, _)| *time), 0.0)?;
    let values = range(points().map(|(_, value)| *value), 0.08)?;
    svg(WIDTH, 190, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(6)
            .set_label_area_size(LabelAreaPosition::Left, 52)
            .set_label_area_size(LabelAreaPosition::Bottom, 28)
            .build_cartesian_2d(time.clone(), values)?;
        chart.configure_mesh().light_line_style(TRANSPARENT).y_desc(unit).x_labels(12).draw()?;
        for ((_, points), colour) in lines.iter().zip(COLOURS) {
            // A gap is a gap: nothing is drawn across what was not measured.
            for piece in points.split(|(_, value)| !value.is_finite()) {
                let line = LineSeries::new(piece.iter().copied(), colour.stroke_width(1));
                chart.draw_series(line)?;
            }
        }
        Ok(())
    })
}

/// Which of `states` a value names, over time [s].
pub(crate) fn states(states: &[&str], points: &[(f64, f64)]) -> Option<String> {
    let time = range(points.iter().map(|(time, _)| *time), 0.0)?;
    let height = 50 + 22 * u32::try_from(states.len()).unwrap_or(1);
    svg(WIDTH, height, |area| {
        let rows = states.len() as f64;
        let mut chart = ChartBuilder::on(area)
            .margin(6)
            .set_label_area_size(LabelAreaPosition::Left, 92)
            .set_label_area_size(LabelAreaPosition::Bottom, 28)
            .build_cartesian_2d(time.clone(), rows..0.0)?;
        chart.configure_mesh().disable_mesh().disable_y_axis().x_labels(12).draw()?;
        for (row, name) in states.iter().enumerate() {
            let middle = chart.backend_coord(&(time.start, row as f64 + 0.5));
            let (_, top) = area.get_base_pixel();
            let style = ("sans-serif", 12).into_font().color(&INK);
            area.draw_text(name, &style, (6, middle.1 - top - 6))?;
        }
        let ends = points.iter().skip(1).map(|(time, _)| *time).chain([time.end]);
        chart.draw_series(points.iter().zip(ends).map(|((begin, state), end)| {
            let colour = COLOURS[whole(*state) as usize % COLOURS.len()];
            Rectangle::new([(*begin, *state + 0.12), (end, *state + 0.88)], colour.filled())
        }))?;
        Ok(())
    })
}

/// The way of the robot [m] over the map.
pub(crate) fn map(walls: &[Wall], tracks: &[Line<'_>]) -> Option<String> {
    let ends = || walls.iter().flatten().map(|[x, y]| (*x, *y));
    let points = || ends().chain(tracks.iter().flat_map(|(_, track)| track.iter().copied()));
    let x = range(points().map(|(x, _)| x), 0.05)?;
    let y = range(points().map(|(_, y)| y), 0.05)?;
    // A metre is as long in either direction.
    let height = 560.0;
    let width = (height * (x.end - x.start) / (y.end - y.start)).clamp(280.0, f64::from(WIDTH));
    svg(whole(width) + 70, whole(height) + 50, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(6)
            .set_label_area_size(LabelAreaPosition::Left, 44)
            .set_label_area_size(LabelAreaPosition::Bottom, 28)
            .build_cartesian_2d(x, y)?;
        chart.configure_mesh().disable_mesh().y_desc("m").draw()?;
        chart.draw_series(walls.iter().map(|wall| {
            PathElement::new(wall.map(|[x, y]| (x, y)).to_vec(), INK.stroke_width(2))
        }))?;
        // The first one shows beneath the others.
        for (((_, track), colour), width) in tracks.iter().zip(COLOURS).zip([5, 1, 1, 1, 1]) {
            let line = LineSeries::new(track.iter().copied(), colour.stroke_width(width));
            chart.draw_series(line)?;
        }
        if let Some((_, track)) = tracks.first() {
            let ends = track.first().into_iter().chain(track.last());
            chart.draw_series(
                ends.zip([COLOURS[2], COLOURS[1]])
                    .map(|(place, colour)| Circle::new(*place, 5, colour.filled())),
            )?;
        }
        Ok(())
    })
}

/// How often something took how long: values [us] and counts, in buckets of a tenth of a decade.
pub(crate) fn histogram(values: &[(f64, u64)]) -> Option<String> {
    const PER_DECADE: f64 = 10.0;
    // From a tenth of a microsecond on, which is what is told apart.
    let bucket = |value: f64| whole((value.max(0.1).log10() + 1.0) * PER_DECADE);
    let edge = |bucket: u32| 10_f64.powf(f64::from(bucket) / PER_DECADE - 1.0);
    let mut counts = BTreeMap::<u32, u64>::new();
    for (value, count) in values {
        *counts.entry(bucket(*value)).or_default() += count;
    }
    let (first, last) =
        (counts.first_key_value()?.0.saturating_sub(1), counts.last_key_value()?.0 + 2);
    let most = counts.values().copied().max()? as f64;
    svg(440, 170, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(6)
            .set_label_area_size(LabelAreaPosition::Left, 48)
            .set_label_area_size(LabelAreaPosition::Bottom, 28)
            .build_cartesian_2d((edge(first)..edge(last)).log_scale(), 0.0..most * 1.05)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_label_formatter(&|us| duration(*us))
            .draw()?;
        chart.draw_series(counts.iter().map(|(bucket, count)| {
            let corners = [(edge(*bucket), 0.0), (edge(bucket + 1), *count as f64)];
            Rectangle::new(corners, COLOURS[0].filled())
        }))?;
        Ok(())
    })
}

/// A duration [us] with the unit that suits it.
pub(crate) fn duration(us: f64) -> String {
    match us {
        us if us < 1e3 => {
            format!("{us:.3}").trim_end_matches('0').trim_end_matches('.').to_owned() + " us"
        }
        us if us < 1e6 => format!("{:.1} ms", us / 1e3),
        us => format!("{:.1} s", us / 1e6),
    }
}

/// Which line is which, as HTML; a chart of one line needs none.
pub(crate) fn legend(lines: &[Line<'_>]) -> String {
    let keys = lines.iter().zip(COLOURS).map(|((name, _), RGBColor(red, green, blue))| {
        format!(
            "<span class=\"key\" style=\"background: rgb({red}, {green}, {blue})\"></span>{name}"
        )
    });
    let keys: Vec<_> = keys.collect();
    if keys.len() < 2 { String::new() } else { format!("<p>{}</p>\n", keys.join(" ")) }
}

/// From the least to the greatest, and a little beyond; nothing where there is none.
fn range(values: impl Iterator<Item = f64>, margin: f64) -> Option<Range<f64>> {
    let (least, greatest) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), value| {
            (least.min(value), greatest.max(value))
        });
    let width = (greatest - least).max(1e-3);
    (least <= greatest).then_some(least - margin * width..least + width * (1.0 + margin))
}

/// The whole part, to count with; nothing is less than none.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates")]
fn whole(value: f64) -> u32 {
    value as u32
}

/// What `draw` draws; nothing where it cannot be drawn.
fn svg(width: u32, height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn) -> Option<String> {
    let mut text = String::new();
    let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
    draw(&area).and_then(|()| area.present()).ok()?;
    drop(area);
    Some(text)
}

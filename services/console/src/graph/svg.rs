//! The graph as a picture: a lane for each process, a line across for each topic. Lanes are never
//! crossed by anything but lines at right angles, so there is no layout to go wrong.

use std::fmt::Write;

use super::{Edge, Graph, Process};

/// [px] Of a lane, and of the box at its top.
const LANE: usize = 160;
const BOX: (usize, usize) = (136, 44);

/// [px] Between two topics.
const ROW: usize = 40;

/// [px] Around everything, and room for the title.
const MARGIN: usize = 24;
const TITLE: usize = 40;

/// One file that needs no other.
pub(super) fn draw(graph: &Graph) -> String {
    let top = MARGIN + TITLE + BOX.1;
    let width = 2 * MARGIN + LANE * graph.processes.len().max(2);
    let height = top + ROW * (graph.edges.len() + 1) + MARGIN;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
         <text x=\"{MARGIN}\" y=\"{}\" font-size=\"17\" fill=\"#1f2933\">{}</text>\n",
        MARGIN + 16,
        escaped(&graph.title)
    );
    let foot = height - MARGIN;
    for (index, process) in graph.processes.iter().enumerate() {
        draw_lane(&mut svg, process, middle(index), top, foot);
    }
    for (index, edge) in graph.edges.iter().enumerate() {
        draw_edge(&mut svg, graph, edge, top + ROW * (index + 1));
    }
    svg.push_str("</svg>");
    svg
}

const fn middle(index: usize) -> usize {
    MARGIN + LANE * index + LANE / 2
}

fn draw_lane(svg: &mut String, process: &Process, x: usize, top: usize, foot: usize) {
    let (width, height) = BOX;
    let (left, y) = (x - width / 2, top - height);
    let colour = match process.state.as_str() {
        "active" => "#2e7d32",
        "inactive" | "guest" => "#1565c0",
        "unconfigured" | "finalized" | "unknown" => "#757575",
        _ => "#ef6c00",
    };
    let _ = write!(
        svg,
        "<line x1=\"{x}\" y1=\"{top}\" x2=\"{x}\" y2=\"{foot}\" stroke=\"#d5dbe1\" \
         stroke-width=\"2\"/>\n\
         <rect x=\"{left}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"6\" \
         fill=\"#f5f7fa\" stroke=\"{colour}\" stroke-width=\"2\"/>\n\
         <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" fill=\"#1f2933\">{}</text>\n\
         <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" font-size=\"11\" fill=\"{colour}\">{}</text>\n",
        y + 19,
        escaped(&process.name),
        y + 35,
        escaped(&process.state),
    );
}

/// A dot where a topic is published, an arrow where it is read.
fn draw_edge(svg: &mut String, graph: &Graph, edge: &Edge, y: usize) {
    let lane = |name: &String| {
        graph.processes.iter().position(|process| process.name == *name).map(middle)
    };
    let from = edge.publisher.as_ref().and_then(lane);
    let readers: Vec<_> = edge.readers.iter().filter_map(lane).collect();
    let ends = readers.iter().chain(&from).copied();
    let (Some(left), Some(right)) = (ends.clone().min(), ends.max()) else { return };
    let dash = if from.is_some() { "" } else { " stroke-dasharray=\"4 4\"" };
    let colour = if from.is_some() { "#37474f" } else { "#9aa5b1" };
    let _ = writeln!(
        svg,
        "<line x1=\"{left}\" y1=\"{y}\" x2=\"{right}\" y2=\"{y}\" stroke=\"{colour}\" \
         stroke-width=\"1.5\"{dash}/>"
    );
    for x in readers {
        // It points the way that the sample comes.
        let tail = if from.is_some_and(|from| x < from) { x + 9 } else { x.saturating_sub(9) };
        let _ = writeln!(
            svg,
            "<polygon points=\"{x},{y} {tail},{} {tail},{}\" fill=\"{colour}\"/>",
            y - 5,
            y + 5
        );
    }
    if let Some(x) = from {
        let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"5\" fill=\"{colour}\"/>");
    }
    // Where nothing goes to the right there may be no room there either.
    let goes_left = from.is_some_and(|from| from == right && left < from);
    let (start, anchor) =
        if goes_left { (right - 10, "end") } else { (from.unwrap_or(left) + 10, "start") };
    let rate = edge.label();
    let _ = writeln!(
        svg,
        "<text x=\"{start}\" y=\"{}\" text-anchor=\"{anchor}\" fill=\"#1f2933\" stroke=\"#ffffff\" stroke-width=\"4\" \
         paint-order=\"stroke\">{} <tspan fill=\"#616e7c\" font-size=\"11\">{rate}</tspan></text>",
        y - 7,
        escaped(&edge.topic)
    );
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::super::tests::graph;
    use super::*;

    #[test]
    fn everything_is_in_the_picture_and_nothing_is_fetched() {
        let svg = draw(&graph());

        for text in ["burger is ready", ">simulator<", ">controller<", ">scan <", "20.0 Hz"] {
            assert!(svg.contains(text), "{text}\n{svg}");
        }
        let addresses = svg.matches("http").count();
        assert_eq!(addresses, 1, "the name space and nothing else:\n{svg}");
        assert_eq!(svg.matches('<').count(), svg.matches('>').count());
    }

    #[test]
    fn names_cannot_end_the_text_that_they_are_in() {
        assert_eq!(escaped("a<b>&\"c"), "a&lt;b&gt;&amp;&quot;c");
    }
}

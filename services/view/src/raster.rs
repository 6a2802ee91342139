//! A picture of dots, eight to a character: braille, or ASCII where there is none.

/// What a dot belongs to; the later lies on top where several meet in one character.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Ink {
    Wall,
    Trail,
    Return,
    Robot,
}

/// [-] Dots of a character, across and down.
const DOTS: (usize, usize) = (2, 4);

/// By row and column of a character's dots: its bit in a braille pattern.
const BITS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// Characters of dots over a piece of the plane.
#[derive(Debug)]
pub(crate) struct Raster {
    columns: usize,
    rows: usize,
    cells: Vec<(u8, Option<Ink>)>,
    /// [m] What is in the middle.
    centre: [f64; 2],
    /// [1/m] Dots.
    scale: f64,
}

impl Raster {
    /// So many characters over the box between two corners; what is left over is on all sides.
    pub(crate) fn new(columns: u16, rows: u16, low: [f64; 2], high: [f64; 2]) -> Self {
        let (columns, rows) = (usize::from(columns), usize::from(rows));
        let (width, height) = ((high[0] - low[0]).max(1e-3), (high[1] - low[1]).max(1e-3));
        // One dot less: a wall on the very edge is inside.
        let across = ((columns * DOTS.0) as f64 - 1.0) / width;
        let down = ((rows * DOTS.1) as f64 - 1.0) / height;
        Self {
            columns,
            rows,
            cells: vec![(0, None); columns * rows],
            centre: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
            scale: across.min(down).max(0.0),
        }
    }

    /// [dot] From the upper left corner.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let middle =
            [self.columns * DOTS.0, self.rows * DOTS.1].map(|dots| 0.5 * dots as f64 - 0.5);
        [
            middle[0] + (x - self.centre[0]) * self.scale,
            middle[1] - (y - self.centre[1]) * self.scale,
        ]
    }

    pub(crate) fn dot(&mut self, point: [f64; 2], ink: Ink) {
        let [x, y] = self.place(point);
        self.set(x, y, ink);
    }

    /// A straight line.
    pub(crate) fn line(&mut self, from: [f64; 2], to: [f64; 2], ink: Ink) {
        let ([x, y], [to_x, to_y]) = (self.place(from), self.place(to));
        let longest = (to_x - x).abs().max((to_y - y).abs());
        // Nothing is larger than what is drawn many times over; NaN draws its beginning.
        let steps = longest.ceil().clamp(1.0, 10_000.0);
        let mut step = 0.0;
        while step <= steps {
            let share = step / steps;
            self.set(x + share * (to_x - x), y + share * (to_y - y), ink);
            step += 1.0;
        }
    }

    /// A circle, of some dots at least.
    pub(crate) fn circle(&mut self, centre: [f64; 2], radius: f64, ink: Ink) {
        for degrees in (0..360_u32).step_by(5) {
            let (sine, cosine) = libm::sincos(f64::from(degrees).to_radians());
            self.dot([centre[0] + radius * cosine, centre[1] + radius * sine], ink);
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
    fn set(&mut self, x: f64, y: f64, ink: Ink) {
        let (x, y) = (x.round(), y.round());
        let is_inside = (0.0..(self.columns * DOTS.0) as f64).contains(&x)
            && (0.0..(self.rows * DOTS.1) as f64).contains(&y);
        if !is_inside {
            return;
        }
        let (x, y) = (x as usize, y as usize);
        let (dots, top) = &mut self.cells[y / DOTS.1 * self.columns + x / DOTS.0];
        *dots |= BITS[y % DOTS.1][x % DOTS.0];
        *top = (*top).max(Some(ink));
    }

    /// The character in which a point is, where it is in the picture.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
    pub(crate) fn cell(&self, point: [f64; 2]) -> Option<(u16, u16)> {
        let [x, y] = self.place(point).map(f64::round);
        let is_inside = (0.0..(self.columns * DOTS.0) as f64).contains(&x)
            && (0.0..(self.rows * DOTS.1) as f64).contains(&y);
        is_inside.then_some((x as u16 / DOTS.0 as u16, y as u16 / DOTS.1 as u16))
    }

    /// The characters that are not empty: column, row, character, and what is on top.
    pub(crate) fn cells(&self, ascii: bool) -> impl Iterator<Item = (u16, u16, char, Ink)> {
        let columns = self.columns;
        self.cells.iter().enumerate().filter_map(move |(index, &(dots, ink))| {
            let ink = ink?;
            let braille = char::from_u32(0x2800 + u32::from(dots)).unwrap_or(' ');
            let character = if ascii { ink.ascii() } else { braille };
            let column = u16::try_from(index % columns).ok()?;
            Some((column, u16::try_from(index / columns).ok()?, character, ink))
        })
    }
}

impl Ink {
    const fn ascii(self) -> char {
        match self {
            Self::Wall => '#',
            Self::Trail => '.',
            Self::Return => '*',
            Self::Robot => 'o',
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(raster: &Raster, ascii: bool) -> String {
        let mut rows = vec![vec![' '; raster.columns]; raster.rows];
        for (column, row, character, _) in raster.cells(ascii) {
            rows[usize::from(row)][usize::from(column)] = character;
        }
        rows.into_iter().map(|row| String::from_iter(row) + "\n").collect()
    }

    #[test]
    fn a_square_fills_its_box_and_stays_a_square() {
        let mut raster = Raster::new(8, 2, [0.0, 0.0], [1.0, 1.0]);
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
        for pair in corners.windows(2) {
            raster.line(pair[0], pair[1], Ink::Wall);
        }

        assert_eq!(picture(&raster, false), "  ⡏⠉⠉⢹  \n  ⣇⣀⣀⣸  \n");
        assert_eq!(picture(&raster, true), "  ####  \n  ####  \n");
    }

    #[test]
    fn what_is_outside_or_no_number_is_not_drawn() {
        let mut raster = Raster::new(2, 1, [0.0, 0.0], [1.0, 1.0]);
        raster.dot([9.0, 0.5], Ink::Return);
        raster.dot([f64::NAN, 0.5], Ink::Return);
        raster.line([-1e9, -1e9], [f64::INFINITY, 0.0], Ink::Wall);

        assert_eq!(picture(&raster, false), "  \n");
    }

    #[test]
    fn the_robot_lies_on_top() {
        let mut raster = Raster::new(1, 1, [0.0, 0.0], [1.0, 1.0]);
        raster.dot([0.5, 0.5], Ink::Robot);
        raster.dot([0.4, 0.4], Ink::Wall);

        assert_eq!(raster.cells(true).map(|(.., ink)| ink).collect::<Vec<_>>(), [Ink::Robot]);
    }
}

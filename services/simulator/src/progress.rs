//! How far the robot has come along its corridor and back.

use nalgebra::Point2;

use crate::Start;

/// Which cells of a corridor the robot has been in, out to the last and back to the first.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    centres: Vec<Point2<f64>>,
    half_cell: f64,
    /// [-] Cells reached on the way out, each after the one before it.
    out: usize,
    /// [-] Cells in the order in which they were first entered on the way out, then on the way back.
    visited: Vec<usize>,
}

impl Progress {
    pub(crate) fn new(start: &Start) -> Self {
        let mut progress = Self {
            centres: start.corridor_m.iter().map(|&centre| centre.into()).collect(),
            half_cell: 0.5 * start.cell_size_m,
            out: 0,
            visited: Vec::with_capacity(2 * start.corridor_m.len()),
        };
        progress.visit(Point2::new(start.x_m, start.y_m));
        progress
    }

    /// Takes note of where the robot is.
    pub(crate) fn visit(&mut self, position: Point2<f64>) {
        let Some(cell) = self.cell(position) else { return };
        if self.out < self.centres.len() {
            if cell == self.out {
                self.out += 1;
                self.visited.push(cell);
            }
        } else if !self.back().contains(&cell) && self.visited.last() != Some(&cell) {
            self.visited.push(cell);
        }
    }

    /// [-] Cells that the corridor has.
    pub fn cells(&self) -> usize {
        self.centres.len()
    }

    /// [-] Cells reached on the way out, each after the one before it.
    pub fn reached(&self) -> usize {
        self.out
    }

    /// [-] The cells, counted from 0, in the order in which the robot first came to them: out to the
    /// last, then back.
    pub fn visited(&self) -> &[usize] {
        &self.visited
    }

    /// The cells in that order for people, counted from 1, where the direction changes: `1-16-1`.
    pub fn path(&self) -> String {
        let mut turns: Vec<usize> = Vec::new();
        for (index, &cell) in self.visited.iter().enumerate() {
            let neighbours =
                (index.checked_sub(1).map(|i| self.visited[i]), self.visited.get(index + 1));
            let goes_on = matches!(neighbours, (Some(before), Some(&after))
                if (before + 1 == cell && cell + 1 == after) || (after + 1 == cell && cell + 1 == before));
            if !goes_on {
                turns.push(cell + 1);
            }
        }
        turns.iter().map(ToString::to_string).collect::<Vec<_>>().join("-")
    }

    /// Whether every cell was reached in order, out to the last, and then the first again.
    pub fn is_round_trip(&self) -> bool {
        self.back().contains(&0)
    }

    /// [-] The cells entered since the last one was reached.
    fn back(&self) -> &[usize] {
        if self.out < self.centres.len() { &[] } else { &self.visited[self.out..] }
    }

    /// [-] The cell that the position is in, if any.
    fn cell(&self, position: Point2<f64>) -> Option<usize> {
        self.centres.iter().position(|centre| (position - centre).amax() <= self.half_cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Progress in a corridor of cells along x, after being in these cells.
    fn after(cells: usize, way: &[usize]) -> Progress {
        let corridor_m = (0..cells).map(|cell| [0.4 * cell as f64, 0.0]).collect();
        let start = Start { x_m: 0.0, y_m: 0.0, yaw_rad: 0.0, cell_size_m: 0.4, corridor_m };
        let mut progress = Progress::new(&start);
        for &cell in way {
            progress.visit(Point2::new(0.4 * cell as f64 + 0.19, -0.19));
        }
        progress
    }

    #[test]
    fn a_round_trip_is_every_cell_out_in_order_and_the_first_again() {
        // The way, cells reached, the round trip done, cells visited.
        let table: [(&[usize], usize, bool, &[usize]); 7] = [
            (&[], 1, false, &[0]),
            (&[0, 0, 1], 2, false, &[0, 1]),
            (&[1, 2, 3], 4, false, &[0, 1, 2, 3]),
            (&[1, 2, 3, 2, 1, 0], 4, true, &[0, 1, 2, 3, 2, 1, 0]),
            (&[1, 2, 1, 0, 1, 2, 2], 3, false, &[0, 1, 2]),
            (&[3, 0], 1, false, &[0]),
            (&[1, 3, 2, 3, 3, 2, 3, 2, 1, 1], 4, false, &[0, 1, 2, 3, 2, 3, 1]),
        ];
        for (way, reached, is_round_trip, visited) in table {
            let progress = after(4, way);
            assert_eq!(progress.reached(), reached, "{way:?}");
            assert_eq!(progress.is_round_trip(), is_round_trip, "{way:?}");
            assert_eq!(progress.visited(), visited, "{way:?}");
        }
    }

    #[test]
    fn outside_of_the_corridor_is_no_cell() {
        let mut progress = after(2, &[]);
        for (x, y) in [(0.4, 0.21), (0.61, 0.0), (f64::NAN, 0.0)] {
            progress.visit(Point2::new(x, y));
        }
        assert_eq!(progress.visited(), [0]);
    }

    #[test]
    fn a_long_wander_needs_no_more_room_than_was_made() {
        let mut progress = after(3, &[1, 2]);
        let room = progress.visited.capacity();
        for step in 0..1000 {
            progress.visit(Point2::new(0.4 * f64::from(1 + step % 2), 0.0));
        }
        assert_eq!(progress.visited.capacity(), room);
        assert_eq!(progress.visited(), [0, 1, 2, 1, 2]);
    }
}

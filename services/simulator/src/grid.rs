//! The walls of a world by where they are, so that a scan costs what is near it and not what there is.

use std::ops::Range;

use fearless_simd::{Simd, dispatch};
use nalgebra::{Point2, Vector2};

use crate::geometry::Wall;
use crate::raster::{Eye, Faces, Raster};

/// [-] So many walls are drawn sooner than sorted out.
const UNSORTED_MAX: usize = 128;

/// [-] Walls in a cell, on average: what is drawn at once is a vector of walls, but what is drawn
/// beside the ones in sight is in vain.
const CELL_WALLS: f64 = 9.0;

/// Walls in square cells, each where its middle is.
///
/// Walls longer than a cell are cut, so that none sticks out of its own by more than half of one. The
/// cells of a row follow each other, and so do their walls.
pub(crate) struct Grid {
    faces: Faces,
    /// [-] By cell, row by row: where its walls begin; one more than there are cells.
    begins: Vec<usize>,
    corner: Point2<f64>,
    /// [m] Side of a cell; infinity where everything is in one.
    cell: f64,
    columns: i64,
    rows: i64,
}

impl Grid {
    pub(crate) fn new(walls: &[Wall]) -> Self {
        let ends = || walls.iter().flat_map(|wall| [wall.a, wall.b]);
        let corner = ends().fold(Point2::from([f64::MAX; 2]), |corner, end| corner.inf(&end));
        let size =
            ends().fold(Vector2::zeros(), |size: Vector2<f64>, end| size.sup(&(end - corner)));
        let is_sorted = walls.len() > UNSORTED_MAX;
        let mut grid = Self {
            faces: Faces::default(),
            begins: Vec::new(),
            corner,
            cell: if is_sorted { cell(walls, size) } else { f64::INFINITY },
            columns: 1,
            rows: 1,
        };
        let pieces = if is_sorted {
            grid.columns = grid.index(size.x) + 1;
            grid.rows = grid.index(size.y) + 1;
            walls.iter().flat_map(|wall| pieces(wall, grid.cell)).collect()
        } else {
            walls.to_vec()
        };
        grid.sort(pieces);
        grid
    }

    fn sort(&mut self, mut pieces: Vec<Wall>) {
        let place = |wall: &Wall| {
            let middle = nalgebra::center(&wall.a, &wall.b) - self.corner;
            let column = self.index(middle.x).clamp(0, self.columns - 1);
            let row = self.index(middle.y).clamp(0, self.rows - 1);
            self.place(row, column)
        };
        let mut begins = vec![0; self.place(self.rows, 0) + 1];
        for piece in &pieces {
            begins[place(piece) + 1] += 1;
        }
        for cell in 1..begins.len() {
            begins[cell] += begins[cell - 1];
        }
        pieces.sort_by_key(place);
        self.faces = Faces::new(&pieces);
        self.begins = begins;
    }

    /// [m] Writes how far each beam gets.
    pub(crate) fn cast(&self, raster: &mut Raster, eye: &Eye, ranges: &mut [f32]) {
        dispatch!(raster.level(), simd => self.cast_with(simd, raster, eye, ranges));
    }

    #[expect(clippy::inline_always, reason = "what is inlined is compiled for the vector unit")]
    #[inline(always)]
    fn cast_with<S: Simd>(&self, simd: S, raster: &mut Raster, eye: &Eye, ranges: &mut [f32]) {
        raster.clear();
        let (row, column) = (self.index(eye.y - self.corner.y), self.index(eye.x - self.corner.x));
        let (mut half, mut drawn) = (1, Square::default());
        loop {
            let square = self.square(row, column, half);
            for row in square.rows.clone() {
                for columns in square.beside(&drawn, row) {
                    let walls = self.walls(row, &columns);
                    raster.draw(simd, &self.faces, walls, eye);
                }
            }
            // Everything else is farther away than this.
            let clear = (half as f64 - 0.5) * self.cell;
            if self.covers(&square) || f64::from(raster.shallowest(simd)) * clear > 1.0 {
                break;
            }
            drawn = square;
            half += (half / 2).max(1);
        }
        raster.measure(simd, ranges);
    }

    /// The cells of the world that are at most so many rows and columns away.
    fn square(&self, row: i64, column: i64, half: i64) -> Square {
        let clip = |at: i64, count| {
            at.saturating_sub(half).clamp(0, count)..at.saturating_add(half + 1).clamp(0, count)
        };
        Square { rows: clip(row, self.rows), columns: clip(column, self.columns) }
    }

    /// [-] The walls in these cells of a row.
    fn walls(&self, row: i64, columns: &Range<i64>) -> Range<usize> {
        self.begins[self.place(row, columns.start)]..self.begins[self.place(row, columns.end)]
    }

    fn covers(&self, square: &Square) -> bool {
        square.rows == (0..self.rows) && square.columns == (0..self.columns)
    }

    /// [-] Which row or column is so far from the corner.
    fn index(&self, offset: f64) -> i64 {
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let index = (offset / self.cell).floor() as i64;
        index
    }

    fn place(&self, row: i64, column: i64) -> usize {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the grid"
        )]
        let place = (row * self.columns + column) as usize;
        place
    }
}

/// Some rows and columns.
#[derive(Default)]
struct Square {
    rows: Range<i64>,
    columns: Range<i64>,
}

impl Square {
    /// The columns of this row that are not in the smaller square.
    fn beside(&self, inner: &Self, row: i64) -> [Range<i64>; 2] {
        if inner.rows.contains(&row) {
            [self.columns.start..inner.columns.start, inner.columns.end..self.columns.end]
        } else {
            [self.columns.clone(), 0..0]
        }
    }
}

/// [m] Cells of this side are never more than walls, and walls no more than twice as many when cut.
fn cell(walls: &[Wall], size: Vector2<f64>) -> f64 {
    let count = walls.len() as f64;
    let length: f64 = walls.iter().map(|wall| (wall.b - wall.a).norm()).sum();
    (CELL_WALLS * size.x * size.y / count).sqrt().max(length / count).max(size.max() / count)
}

/// The wall in equal parts no longer than `length`, whose ends meet to the last bit.
fn pieces(wall: &Wall, length: f64) -> impl Iterator<Item = Wall> + use<> {
    let wall = *wall;
    let edge = wall.b - wall.a;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
    let count = (edge.norm() / length).ceil().max(1.0) as u32;
    let cut = move |at: u32| {
        if at == count { wall.b } else { wall.a + edge * (f64::from(at) / f64::from(count)) }
    };
    (0..count).map(move |at| Wall { a: cut(at), b: cut(at + 1), ..wall })
}

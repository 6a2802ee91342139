//! All ranges of a scan at once: walls are drawn into a one-dimensional depth buffer.
//!
//! The beams of a scan share their origin, so a wall from `a` with the edge `e` is met by the beam `d`
//! at the inverse depth `(d × e) / (a × e)`, where `a × e` is the same for all beams: two products and
//! no division for each. A wall covers one interval of beams, found by an arc tangent that need not be
//! exact, since inside of it the exact test `a × d >= 0 && d × b >= 0` decides. Walls that share a
//! corner compute the same number for it, and of `a × d` and `d × a` one is never negative: no beam
//! slips through between them.
//!
//! Coordinates are `f64`; differences to the eye are rounded to `f32`, so that only the distance to
//! what is seen costs precision, not the place in the world. Every operation is one that IEEE 754
//! rounds in one way, in one order, without fusing two: each vector unit gives the same bits.

#![expect(clippy::inline_always, reason = "what is inlined is compiled for the vector unit")]

use std::array;
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, f32x16, f64x8, i32x16};
use nalgebra::Isometry2;

use crate::geometry::Wall;

/// [-] Beams, or walls, that are worked on together.
const LANES: usize = 16;

/// [rad] What the angle of a wall's end may be off by: ten times more than [`angle`] is.
const ANGLE_ERROR: f32 = 1e-4;

/// [m²] Twice the area between the eye and a wall: with less, the wall is seen end-on.
const AREA_MIN: f32 = 1e-30;

/// [-] What the nearest and the farthest point of a wall may be off by.
const ENDS_ERROR: f32 = 1e-6;

/// Walls as the raster reads them: a vector of any of their numbers is one load.
#[derive(Default)]
pub(crate) struct Faces {
    a_x: Vec<f64>,
    a_y: Vec<f64>,
    b_x: Vec<f64>,
    b_y: Vec<f64>,
    /// [-] 1 where the wall is not seen from its left, 0 where it is seen from both sides.
    solid: Vec<f32>,
}

impl Faces {
    pub(crate) fn new(walls: &[Wall]) -> Self {
        let mut faces = Self::default();
        // The last vector is filled up with walls of no length, which nobody sees.
        let padding = [Wall::default(); LANES];
        for wall in walls.iter().chain(&padding) {
            faces.a_x.push(wall.a.x);
            faces.a_y.push(wall.a.y);
            faces.b_x.push(wall.b.x);
            faces.b_y.push(wall.b.y);
            faces.solid.push(if wall.is_solid { 1.0 } else { 0.0 });
        }
        faces
    }
}

/// Where the LiDAR is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    /// [m]
    pub(crate) x: f64,
    /// [m]
    pub(crate) y: f64,
    cos: f32,
    sin: f32,
}

impl Eye {
    pub(crate) fn new(world_from_scan: &Isometry2<f64>) -> Self {
        let (position, rotation) = (world_from_scan.translation, world_from_scan.rotation);
        Self { x: position.x, y: position.y, cos: single(rotation.re), sin: single(rotation.im) }
    }
}

/// The depth buffer and the beams' directions.
///
/// Both go round twice, since a wall's interval may begin just before the last beam and is at most
/// half a turn wide. What is drawn behind the first turn counts for the beam one turn earlier.
pub(crate) struct Raster {
    level: Level,
    beams: usize,
    /// [1/m] One over the reach: what is drawn must be more.
    least: f32,
    cos: Vec<[f32; LANES]>,
    sin: Vec<[f32; LANES]>,
    /// [1/m]
    depth: Vec<[f32; LANES]>,
}

impl Raster {
    /// For `beams` evenly round the eye, counterclockwise from straight ahead, up to `reach` [m].
    pub(crate) fn new(beams: usize, reach: f64) -> Self {
        let direction = |beam| {
            let angle = (beam % beams) as f64 * std::f64::consts::TAU / beams as f64;
            let (sin, cos) = libm::sincos(angle);
            (single(cos), single(sin))
        };
        // One more, since the last interval ends up to half a turn and a beam behind the first turn.
        let chunks = (2 * beams).div_ceil(LANES) + 1;
        let each = |part: fn((f32, f32)) -> f32| {
            (0..chunks)
                .map(|chunk| array::from_fn(|lane| part(direction(chunk * LANES + lane))))
                .collect()
        };
        Self {
            level: Level::new(),
            beams,
            least: single(1.0 / reach),
            cos: each(|(cos, _)| cos),
            sin: each(|(_, sin)| sin),
            depth: vec![[0.0; LANES]; chunks],
        }
    }

    /// The widest vector unit of this machine, found when the raster was made.
    pub(crate) fn level(&self) -> Level {
        self.level
    }

    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.depth.fill([self.least; LANES]);
    }

    /// Draws these walls.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(&mut self, simd: S, faces: &Faces, which: Range<usize>, eye: &Eye) {
        for start in which.clone().step_by(LANES) {
            let spans = self.project(simd, faces, start, eye);
            // The last vector may reach into walls that were not asked for.
            let asked = u64::MAX >> (64 - LANES.min(which.end - start));
            let mut seen = spans.seen & asked;
            while seen != 0 {
                self.draw_one(simd, &spans, seen.trailing_zeros() as usize);
                seen &= seen - 1;
            }
        }
    }

    /// Where the walls from `start` on are, as the beams see them.
    #[inline(always)]
    fn project<S: Simd>(&self, simd: S, faces: &Faces, start: usize, eye: &Eye) -> Spans {
        let (low, high) = (start..start + LANES / 2, start + LANES / 2..start + LANES);
        let (low, high) = (Sight::of(simd, faces, low, eye), Sight::of(simd, faces, high, eye));
        let a = eye.turn(simd, Sight::join(simd, &low.a, &high.a));
        let b = eye.turn(simd, Sight::join(simd, &low.b, &high.b));
        let edge = eye.turn(simd, Sight::join(simd, &low.edge, &high.edge));
        let cross = simd.narrow_f64x8(low.cross, high.cross);
        let solid = f32x16::from_slice(simd, &faces.solid[start..start + LANES]);

        // One over the distances of both ends, between which all of the wall is, but where the foot of
        // the perpendicular is on it. Rounding cannot put a wall that is seen almost end-on elsewhere.
        let (a_squared, b_squared) = (dot(a, a), dot(b, b));
        let inverse = f32x16::splat(simd, 1.0) / (a_squared * b_squared);
        let (a_depth, b_depth) = ((inverse * b_squared).sqrt(), (inverse * a_squared).sqrt());
        let has_foot = dot(a, edge).simd_lt(0.0) & dot(b, edge).simd_gt(0.0);
        let nearest = a_depth.max(b_depth) * (1.0 + ENDS_ERROR);
        let nearest = has_foot.select(f32x16::splat(simd, f32::MAX), nearest);
        let farthest = a_depth.min(b_depth) * (1.0 - ENDS_ERROR);

        let is_in_reach = nearest.simd_ge(self.least)
            & (cross * cross * (self.least * self.least))
                .simd_le(dot(edge, edge) * (1.0 + ENDS_ERROR));
        let is_faced = (cross * solid).simd_le(0.0) & cross.abs().simd_ge(AREA_MIN);
        let (first, last) = self.beams_between(angle(simd, a), angle(simd, b), cross);
        let seen = is_in_reach & is_faced & first.simd_le(last);

        // Counterclockwise from `a` to `b` or the other way: the sign makes it the same test.
        let sign = f32x16::splat(simd, 1.0).copysign(cross);
        let by_area = f32x16::splat(simd, 1.0) / cross;
        Spans {
            seen: seen.to_bitmask(),
            first: (first >> LANES.ilog2()).to_array(),
            last: (last >> LANES.ilog2()).to_array(),
            a_x: (a.0 * sign).to_array(),
            a_y: (a.1 * sign).to_array(),
            b_x: (b.0 * sign).to_array(),
            b_y: (b.1 * sign).to_array(),
            by_cos: (edge.1 * by_area).to_array(),
            by_sin: (edge.0 * by_area).to_array(),
            nearest: nearest.to_array(),
            farthest: farthest.to_array(),
        }
    }

    /// [-] The first and the last beam that may meet a wall whose ends are seen at these angles.
    #[inline(always)]
    fn beams_between<S: Simd>(
        &self,
        a: f32x16<S>,
        b: f32x16<S>,
        cross: f32x16<S>,
    ) -> (i32x16<S>, i32x16<S>) {
        let leftwards = cross.simd_gt(0.0);
        let (from, to) = (leftwards.select(a, b), leftwards.select(b, a));
        let width = to - from;
        // Less than nothing by more than the error is a wall across the first beam.
        let width = width.simd_lt(-ANGLE_ERROR).select(width + TAU, width);
        let by_beam = self.beams as f32 / TAU;
        let first = (from * by_beam + (1.0 - ANGLE_ERROR * by_beam)).max(0.0);
        let last = (from + width + ANGLE_ERROR) * by_beam;
        (first.to_int(), last.to_int())
    }

    /// Draws the wall in this lane.
    #[inline(always)]
    fn draw_one<S: Simd>(&mut self, simd: S, spans: &Spans, lane: usize) {
        let a_x = f32x16::splat(simd, spans.a_x[lane]);
        let a_y = f32x16::splat(simd, spans.a_y[lane]);
        let b_x = f32x16::splat(simd, spans.b_x[lane]);
        let b_y = f32x16::splat(simd, spans.b_y[lane]);
        let by_cos = f32x16::splat(simd, spans.by_cos[lane]);
        let by_sin = f32x16::splat(simd, spans.by_sin[lane]);
        let nearest = f32x16::splat(simd, spans.nearest[lane]);
        let farthest = f32x16::splat(simd, spans.farthest[lane]);

        #[expect(clippy::cast_sign_loss, reason = "no angle is negative")]
        let chunks = spans.first[lane] as usize..spans.last[lane] as usize + 1;
        let directions = self.cos[chunks.clone()].iter().zip(&self.sin[chunks.clone()]);
        for (depth, (cos, sin)) in self.depth[chunks].iter_mut().zip(directions) {
            let (cos, sin) = (f32x16::load_array_ref(simd, cos), f32x16::load_array_ref(simd, sin));
            let is_between =
                (a_x * sin - a_y * cos).simd_ge(0.0) & (cos * b_y - sin * b_x).simd_ge(0.0);
            let here = (by_cos * cos - by_sin * sin).max(farthest).min(nearest);
            let before = f32x16::load_array_ref(simd, depth);
            is_between.select(here.max(before), before).store_array(depth);
        }
    }

    /// [1/m] One over the longest range yet.
    #[inline(always)]
    pub(crate) fn shallowest<S: Simd>(&self, simd: S) -> f32 {
        let whole = self.beams / LANES;
        let mut all = f32x16::splat(simd, f32::MAX);
        for chunk in 0..whole {
            all = all.min(self.both_turns(simd, chunk));
        }
        let rest = &self.both_turns(simd, whole).to_array()[..self.beams % LANES];
        all.to_array().iter().chain(rest).copied().fold(f32::MAX, f32::min)
    }

    /// [m] Writes the range of each beam, infinity where it met nothing within the reach.
    #[inline(always)]
    pub(crate) fn measure<S: Simd>(&self, simd: S, ranges: &mut [f32]) {
        for (chunk, ranges) in ranges.chunks_mut(LANES).enumerate() {
            let depth = self.both_turns(simd, chunk);
            let range = f32x16::splat(simd, 1.0) / depth;
            let none = f32x16::splat(simd, f32::INFINITY);
            let range = depth.simd_gt(self.least).select(range, none);
            match ranges.as_chunks_mut() {
                ([ranges], _) => range.store_array(ranges),
                (_, rest) => rest.copy_from_slice(&range.to_array()[..rest.len()]),
            }
        }
    }

    /// [1/m] What is drawn for these beams in either turn.
    #[inline(always)]
    fn both_turns<S: Simd>(&self, simd: S, chunk: usize) -> f32x16<S> {
        let start = chunk * LANES;
        let second = &self.depth.as_flattened()[self.beams + start..][..LANES];
        f32x16::load_array_ref(simd, &self.depth[chunk]).max(f32x16::from_slice(simd, second))
    }
}

/// What the beams see of a vector of walls.
struct Spans {
    /// [-] A bit for each wall, set where some beam may meet it.
    seen: u64,
    /// [-] The vector of beams in which it begins.
    first: [i32; LANES],
    /// [-] The vector of beams in which it ends.
    last: [i32; LANES],
    /// [m] Its end to the right.
    a_x: [f32; LANES],
    a_y: [f32; LANES],
    /// [m] Its end to the left.
    b_x: [f32; LANES],
    b_y: [f32; LANES],
    /// [1/m] What the beam's cosine counts for its inverse depth.
    by_cos: [f32; LANES],
    /// [1/m] What the beam's sine takes from that.
    by_sin: [f32; LANES],
    /// [1/m] Inverse depth that no point of it exceeds.
    nearest: [f32; LANES],
    /// [1/m] Inverse depth that every point of it has.
    farthest: [f32; LANES],
}

/// Half a vector of walls, from the eye.
struct Sight<S: Simd> {
    a: [f64x8<S>; 2],
    b: [f64x8<S>; 2],
    edge: [f64x8<S>; 2],
    /// [m²] Twice the area between the eye and the wall: positive where `a` to `b` is counterclockwise.
    cross: f64x8<S>,
}

impl<S: Simd> Sight<S> {
    #[inline(always)]
    fn of(simd: S, faces: &Faces, which: Range<usize>, eye: &Eye) -> Self {
        let a_x = f64x8::from_slice(simd, &faces.a_x[which.clone()]);
        let a_y = f64x8::from_slice(simd, &faces.a_y[which.clone()]);
        let b_x = f64x8::from_slice(simd, &faces.b_x[which.clone()]);
        let b_y = f64x8::from_slice(simd, &faces.b_y[which]);
        let edge = [b_x - a_x, b_y - a_y];
        let a = [a_x - eye.x, a_y - eye.y];
        let cross = a[0] * edge[1] - a[1] * edge[0];
        Self { a, b: [b_x - eye.x, b_y - eye.y], edge, cross }
    }

    #[inline(always)]
    fn join(simd: S, low: &[f64x8<S>; 2], high: &[f64x8<S>; 2]) -> (f32x16<S>, f32x16<S>) {
        (simd.narrow_f64x8(low[0], high[0]), simd.narrow_f64x8(low[1], high[1]))
    }
}

impl Eye {
    /// From the world's axes to the LiDAR's.
    #[inline(always)]
    fn turn<S: Simd>(&self, simd: S, (x, y): (f32x16<S>, f32x16<S>)) -> (f32x16<S>, f32x16<S>) {
        let (cos, sin) = (f32x16::splat(simd, self.cos), f32x16::splat(simd, self.sin));
        (cos * x + sin * y, cos * y - sin * x)
    }
}

#[inline(always)]
fn dot<S: Simd>(a: (f32x16<S>, f32x16<S>), b: (f32x16<S>, f32x16<S>)) -> f32x16<S> {
    a.0 * b.0 + a.1 * b.1
}

/// [rad] From straight ahead, counterclockwise, in 0 to a whole turn; off by at most 2e-5.
#[inline(always)]
fn angle<S: Simd>(simd: S, (x, y): (f32x16<S>, f32x16<S>)) -> f32x16<S> {
    let (across, along) = (y.abs(), x.abs());
    let steep = across.simd_gt(along);
    let slope = across.min(along) / across.max(along);
    let squared = slope * slope;
    // Abramowitz and Stegun, 4.4.49, whose error is 1e-5.
    let mut sum = f32x16::splat(simd, 0.020_835_1);
    for term in [-0.085_133, 0.180_141, -0.330_299_5, 0.999_866] {
        sum = sum * squared + term;
    }
    let octant = sum * slope;
    let quadrant = steep.select(FRAC_PI_2 - octant, octant);
    let half = x.simd_lt(0.0).select(PI - quadrant, quadrant);
    y.simd_lt(0.0).select(TAU - half, half)
}

pub(crate) fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "differences are single precision")]
    let value = value as f32;
    value
}

#[cfg(test)]
pub(crate) mod tests {
    use fearless_simd::dispatch;

    use super::*;

    /// Every vector unit that this machine has, the least first.
    fn levels() -> Vec<Level> {
        #[cfg(target_arch = "x86_64")]
        let more = {
            let widest = Level::new();
            [
                widest.as_sse4_2().map(Level::Sse4_2),
                widest.as_avx2().map(Level::Avx2),
                widest.as_avx512().map(Level::Avx512),
            ]
        };
        #[cfg(not(target_arch = "x86_64"))]
        let more: [Option<Level>; 0] = [];
        [Level::baseline()].into_iter().chain(more.into_iter().flatten()).collect()
    }

    /// The raster as each vector unit has it.
    pub(crate) fn on_each_unit(beams: usize, reach: f64) -> Vec<Raster> {
        let on = |level| Raster { level, ..Raster::new(beams, reach) };
        levels().into_iter().map(on).collect()
    }

    // Breaks, as it should, with a tenth of the arc tangent's last term.
    #[test]
    fn the_arc_tangent_is_far_better_than_it_is_taken_for() {
        for turn in 0..100_000 {
            let expected = f64::from(turn) * std::f64::consts::TAU / 100_000.0;
            let (sin, cos) = libm::sincos(expected);
            let found = dispatch!(Level::new(), simd => {
                let (x, y) = (single(3.0 * cos), single(3.0 * sin));
                angle(simd, (f32x16::splat(simd, x), f32x16::splat(simd, y))).to_array()[0]
            });
            let error = (f64::from(found) - expected).abs();
            let error = error.min(std::f64::consts::TAU - error);
            assert!(error < f64::from(ANGLE_ERROR) / 5.0, "{expected}: off by {error}");
        }
    }
}

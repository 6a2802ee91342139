//! Other robots of the same world: discs, to be seen and to be run into. They move, so that no tree
//! and no grid knows them; there are few, and each is asked.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Point2, Vector2};

use crate::raster::single;

/// A round robot, as others see it and run into it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    /// [m] Its middle, in the world.
    pub(crate) centre: Point2<f64>,
    /// [m]
    pub(crate) radius: f64,
}

impl Disc {
    /// [m] From `point` to the edge, less than nothing inside.
    pub(crate) fn distance(&self, point: Point2<f64>) -> f64 {
        (point - self.centre).norm() - self.radius
    }

    /// [m] How far a ray gets, if it meets the disc; nowhere where it begins inside.
    pub(crate) fn meet(&self, origin: Point2<f64>, direction: Vector2<f64>) -> Option<f64> {
        let offset = self.centre - origin;
        let (ahead, aside) = (direction.dot(&offset), direction.perp(&offset));
        let half_chord = (self.radius * self.radius - aside * aside).sqrt();
        // NaN, a ray that passes by, is no range.
        (ahead + half_chord >= 0.0).then(|| (ahead - half_chord).max(0.0))
    }
}

/// The directions of a LiDAR's beams, for what is drawn beam by beam.
pub(crate) struct Beams {
    directions: Vec<Vector2<f64>>,
}

impl Beams {
    /// So many evenly round, counterclockwise from straight ahead.
    pub(crate) fn new(beams: usize) -> Self {
        let direction = |beam| {
            let (sin, cos) = libm::sincos(beam as f64 * TAU / beams as f64);
            Vector2::new(cos, sin)
        };
        Self { directions: (0..beams).map(direction).collect() }
    }

    /// [m] Shortens the `ranges` of the beams that meet a disc within `reach`.
    pub(crate) fn cast(
        &self,
        discs: &[Disc],
        world_from_scan: &Isometry2<f64>,
        reach: f64,
        ranges: &mut [f32],
    ) {
        for disc in discs {
            let centre = world_from_scan.inverse_transform_point(&disc.centre);
            let seen = Disc { centre, ..*disc };
            let distance = centre.coords.norm();
            if reach < distance - disc.radius {
                continue;
            }
            for beam in self.about(&seen, distance) {
                let range = seen.meet(Point2::origin(), self.directions[beam]);
                if let Some(range) = range.filter(|&range| range <= reach) {
                    ranges[beam] = ranges[beam].min(single(range));
                }
            }
        }
    }

    /// [-] The beams that may meet a disc at this distance, and one more to either side.
    fn about(&self, disc: &Disc, distance: f64) -> impl Iterator<Item = usize> + use<> {
        let by_beam = self.directions.len() as f64 / TAU;
        let middle = libm::atan2(disc.centre.y, disc.centre.x);
        let half = if disc.radius < distance { libm::asin(disc.radius / distance) } else { PI };
        let count = i64::try_from(self.directions.len()).unwrap_or(i64::MAX);
        let first = whole((middle - half) * by_beam) - 1;
        let last = (whole((middle + half) * by_beam) + 1).min(first + count - 1);
        (first..=last).filter_map(move |beam| usize::try_from(beam.rem_euclid(count)).ok())
    }
}

fn whole(value: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "some turns of beams")]
    let whole = value.round() as i64;
    whole
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;
    use crate::geometry::oracle;

    fn between(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(random.next_u32()) / f64::from(u32::MAX)
    }

    // Breaks, as it should, where a disc is taken for a fifth narrower than it is, and where it is seen at
    // its middle.
    #[test]
    fn every_beam_agrees_with_parry_on_discs_that_may_hide_each_other() {
        let mut met = 0;
        for seed in 0..2_000 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let off = [0.0, 1000.0][random.next_u32() as usize % 2];
            let discs: Vec<_> = (0..=random.next_u32() % 15)
                .map(|_| {
                    let [x, y] = [0; 2].map(|_| off + between(&mut random, -5.0, 5.0));
                    Disc { centre: Point2::new(x, y), radius: between(&mut random, 0.01, 1.0) }
                })
                .collect();
            let [x, y] = [0; 2].map(|_| off + between(&mut random, -5.0, 5.0));
            let pose = Isometry2::new(Vector2::new(x, y), between(&mut random, -4.0, 4.0));
            let beams = [1, 7, 60, 240, 1440][random.next_u32() as usize % 5];
            let reach = between(&mut random, 0.5, 8.0);
            let all = Beams::new(beams);
            let mut ranges = vec![f32::INFINITY; beams];
            all.cast(&discs, &pose, reach, &mut ranges);
            for (direction, range) in all.directions.iter().zip(ranges) {
                let direction = pose.rotation * direction;
                let expected = discs
                    .iter()
                    .filter_map(|disc| oracle::meet(disc, [x, y].into(), direction, reach))
                    .fold(f64::INFINITY, f64::min);
                let range = f64::from(range);
                // What a beam grazes, or what is at the end of the reach, may be missed.
                let closest = |disc: &Disc| {
                    (disc.distance([x, y].into()) > 0.0)
                        .then(|| (disc.centre - Point2::new(x, y)).perp(&direction).abs())
                        .map_or(f64::MAX, |aside| (aside - disc.radius).abs())
                };
                let grazes = discs.iter().any(|disc| closest(disc) < 1e-9);
                let at_the_end = (range.min(expected) - reach).abs() < 1e-6;
                let agrees = (range - expected).abs() < 1e-5 || range == expected;
                assert!(
                    agrees || grazes || at_the_end,
                    "SEED={seed}: {range}, parry {expected}, {beams} beams, reach {reach}"
                );
                met += usize::from(range.is_finite());
            }
        }
        assert!(met > 10_000, "{met} beams met something");
    }

    #[test]
    fn a_disc_is_seen_at_its_edge_and_from_inside_at_once() {
        let disc = Disc { centre: Point2::new(1.0, 0.0), radius: 0.25 };
        // Ahead, left, behind, right of some places.
        let none = f32::INFINITY;
        let table = [
            ([0.0, 0.0], [0.75, none, none, none]),
            ([2.0, 0.0], [none, none, 0.75, none]),
            ([1.0, -1.0], [none, 0.75, none, none]),
            ([1.1, 0.0], [0.0; 4]),
        ];
        for ([x, y], expected) in table {
            let mut ranges = [none; 4];
            let pose = Isometry2::translation(x, y);
            Beams::new(4).cast(&[disc], &pose, 8.0, &mut ranges);
            assert_eq!(ranges, expected, "{x} {y}");
        }
    }
}

//! Walls, and what parry knows about them. No other module names parry's types.

use nalgebra::{Point2, Vector2};
use parry2d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry2d_f64::math::Vector;
use parry2d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry2d_f64::query::Ray;
use parry2d_f64::shape::Segment;

use crate::grid::Grid;

/// [m] So much wider than the walls are the boxes by which parry finds them, so that rounding cannot
/// make it overlook one.
const LOOSENED: f64 = 1e-6;

/// A straight wall without thickness.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Wall {
    /// [m] Where it begins.
    pub(crate) a: Point2<f64>,
    /// [m] Where it ends.
    pub(crate) b: Point2<f64>,
    /// Whether what is to the left of `a` to `b` is solid, so that nobody sees the wall from there.
    pub(crate) is_solid: bool,
}

impl Wall {
    /// [m] From `point` to the nearest point of the wall.
    pub(crate) fn distance(&self, point: Point2<f64>) -> f64 {
        let along = self.b - self.a;
        let share = (point - self.a).dot(&along) / along.norm_squared();
        (point - (self.a + along * share.clamp(0.0, 1.0))).norm()
    }

    /// [m] How far a ray gets, if it meets the wall.
    fn meet(&self, origin: Point2<f64>, direction: Vector2<f64>) -> Option<f64> {
        let (a, b) = (self.a - origin, self.b - origin);
        // Walls that share a corner compute the same number for it, and both hold it where that is
        // zero: no ray slips through between them.
        let (beside_a, beside_b) = (direction.perp(&a), direction.perp(&b));
        if beside_a * beside_b > 0.0 {
            return None;
        }
        let (ahead_a, ahead_b) = (direction.dot(&a), direction.dot(&b));
        let range = (ahead_a * beside_b - ahead_b * beside_a) / (beside_b - beside_a);
        // NaN, a wall seen end-on, is not met: without thickness there is nothing to see.
        (range >= 0.0).then_some(range)
    }
}

/// All walls of a world.
pub(crate) struct Walls {
    each: Vec<Wall>,
    grid: Grid,
    tree: Bvh,
}

impl Walls {
    pub(crate) fn new(each: Vec<Wall>) -> Self {
        let boxes = each
            .iter()
            .map(|wall| Segment::new(wall.a.into(), wall.b.into()).local_aabb().loosened(LOOSENED));
        let tree = Bvh::from_iter(BvhBuildStrategy::Binned, boxes.enumerate());
        let grid = Grid::new(&each);
        Self { each, grid, tree }
    }

    /// The walls as the LiDAR wants them.
    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// [m] From `point` to the nearest wall, which all of them are asked for.
    pub(crate) fn distance(&self, point: Point2<f64>) -> f64 {
        self.each.iter().map(|wall| wall.distance(point)).fold(f64::MAX, f64::min)
    }

    /// [m] The same, where it is known to be at most `bound`: only what is near is asked.
    pub(crate) fn distance_within(&self, point: Point2<f64>, bound: f64) -> f64 {
        self.near(point, bound).map(|wall| wall.distance(point)).fold(f64::MAX, f64::min)
    }

    /// The walls at most `distance` [m] from `point`, and some more.
    pub(crate) fn near(&self, point: Point2<f64>, distance: f64) -> impl Iterator<Item = &Wall> {
        let around = Aabb::from_half_extents(point.into(), Vector::splat(distance));
        let leaves = self.tree.leaves(move |node| node.aabb().intersects(&around));
        leaves.map(|leaf| &self.each[leaf as usize])
    }

    /// [m] How far a ray gets, if it meets a wall within `reach`.
    pub(crate) fn cast(
        &self,
        origin: Point2<f64>,
        direction: Vector2<f64>,
        reach: f64,
    ) -> Option<f64> {
        // Parry finds the walls near the ray; whether it meets them is decided here, since parry's own
        // answer lets through some rays that run right into a corner.
        let ray = Ray::new(Vector::from(origin), Vector::from(direction));
        let meet = |index: u32, _| self.each[index as usize].meet(origin, direction);
        self.tree.cast_ray(&ray, reach, meet).map(|(_, range)| range)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    #[test]
    fn no_ray_escapes_through_the_corners_of_a_closed_room() {
        for corners in 3..40 {
            let corner = |index: usize| {
                let angle = (index % corners) as f64 * std::f64::consts::TAU / corners as f64;
                Point2::new(0.3 + 2.0 * libm::cos(angle), 0.7 + 2.0 * libm::sin(angle))
            };
            let wall = |index| Wall { a: corner(index), b: corner(index + 1), is_solid: false };
            let walls = Walls::new((0..corners).map(wall).collect());
            for place in 0..100 {
                let angle = f64::from(place);
                let origin =
                    Point2::new(0.3 + 0.9 * libm::cos(angle), 0.7 + 0.6 * libm::sin(angle));
                for target in (0..corners).map(corner) {
                    let (direction, range) = Unit::new_and_get(target - origin);
                    let found = walls.cast(origin, *direction, 10.0);
                    let hits = found.is_some_and(|found| (found - range).abs() < 1e-9);
                    assert!(hits, "{corners} corners, {origin} to {target}: {found:?}");
                }
            }
        }
    }

    // Breaks, as it should, where the boxes by which parry finds walls are narrower than the walls.
    #[test]
    fn no_wall_within_the_bound_is_overlooked() {
        let corner = |index: usize| {
            let angle = index as f64 * 2.4;
            Point2::new(index as f64 * libm::cos(angle), index as f64 * libm::sin(angle)) / 20.0
        };
        let wall = |index| Wall { a: corner(index), b: corner(index + 7), is_solid: false };
        let walls = Walls::new((0..200).map(wall).collect());
        for place in 0..2000 {
            let (sin, cos) = libm::sincos(f64::from(place));
            let point = Point2::new(cos, sin) * f64::from(place) / 200.0;
            let distance = walls.distance(point);
            for more in [0.0, 1e-3, 1.0] {
                let found = walls.distance_within(point, distance + more);
                assert_eq!(found.to_bits(), distance.to_bits(), "{point}, {more} m more");
            }
        }
    }

    #[test]
    fn a_ray_meets_a_wall_ahead_of_it_only() {
        let wall = Wall { a: Point2::new(1.0, -1.0), b: Point2::new(1.0, 1.0), is_solid: false };
        let walls = Walls::new(vec![wall]);
        // Origin, direction, reach, what it meets.
        let table = [
            ([0.0, 0.0], [1.0, 0.0], 8.0, Some(1.0)),
            ([0.0, 0.0], [1.0, 0.0], 0.9, None),
            ([0.0, 0.0], [-1.0, 0.0], 8.0, None),
            ([0.0, 0.0], [0.0, 1.0], 8.0, None),
            ([0.0, 2.0], [1.0, 0.0], 8.0, None),
            ([3.0, 0.5], [-1.0, 0.0], 8.0, Some(2.0)),
            ([1.0, -3.0], [0.0, 1.0], 8.0, None),
        ];
        for (origin, direction, reach, expected) in table {
            let found = walls.cast(origin.into(), direction.into(), reach);
            assert_eq!(found, expected, "{origin:?} {direction:?}");
        }
    }
}

#[cfg(test)]
pub(crate) mod oracle {
    use nalgebra::{Point2, Vector2};
    use parry2d_f64::math::Pose;
    use parry2d_f64::query::{NonlinearRigidMotion, RayCast, cast_shapes_nonlinear};
    use parry2d_f64::shape::{Ball, Shape};

    use super::{Ray, Segment, Vector, Wall};
    use crate::arc::Arc;
    use crate::discs::Disc;

    /// [m] How far parry sees a ray get that meets the disc within `reach`.
    pub(crate) fn meet(
        disc: &Disc,
        origin: Point2<f64>,
        direction: Vector2<f64>,
        reach: f64,
    ) -> Option<f64> {
        let pose = Pose::new(disc.centre.into(), 0.0);
        let ray = Ray::new(Vector::from(origin), Vector::from(direction));
        Ball::new(disc.radius).cast_ray(&pose, &ray, reach, true)
    }

    /// [-] The fraction of the arc after which parry sees a disc of `radius` touch the wall.
    pub(crate) fn first_contact(arc: &Arc, radius: f64, wall: &Wall) -> Option<f64> {
        let segment = Segment::new(wall.a.into(), wall.b.into());
        contact(arc, radius, &segment, Pose::IDENTITY)
    }

    /// [-] The same of another disc.
    pub(crate) fn first_contact_with(arc: &Arc, radius: f64, other: &Disc) -> Option<f64> {
        contact(arc, radius, &Ball::new(other.radius), Pose::new(other.centre.into(), 0.0))
    }

    fn contact(arc: &Arc, radius: f64, other: &dyn Shape, place: Pose) -> Option<f64> {
        let base = arc.world_from_base;
        let pose = Pose::new(base.translation.vector.into(), base.rotation.angle());
        // The disc turns about the centre of its circle, one period being the unit of time.
        let centre = Vector::new(0.0, arc.distance / arc.turn);
        let motion = NonlinearRigidMotion::new(pose, centre, Vector::ZERO, arc.turn);
        let rest = NonlinearRigidMotion::constant_position(place);
        cast_shapes_nonlinear(&motion, &Ball::new(radius), &rest, other, 0.0, 1.0, false)
            .expect("parry casts discs against these")
            .map(|hit| hit.time_of_impact)
    }
}

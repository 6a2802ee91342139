//! The path of one period: both wheels turn at constant speed, so the axle moves on a circle.

use nalgebra::{Isometry2, Vector2};

/// Where the robot goes in one period.
pub(crate) struct Arc {
    /// Where it begins.
    pub(crate) world_from_base: Isometry2<f64>,
    /// [m] Along the path, negative backwards.
    pub(crate) distance: f64,
    /// [rad] Change of heading, counterclockwise.
    pub(crate) turn: f64,
}

impl Arc {
    /// Where the robot is after this fraction of the period.
    pub(crate) fn at(&self, fraction: f64) -> Isometry2<f64> {
        // By its chord, which needs no centre of rotation and so no special case for going straight.
        let half = 0.5 * self.turn * fraction;
        let chord = self.distance * fraction * sinc(half);
        let step = Vector2::new(chord * libm::cos(half), chord * libm::sin(half));
        let base_from_next = Isometry2::new(step, self.turn * fraction);

        let mut world_from_next = self.world_from_base * base_from_next;
        world_from_next.rotation.renormalize_fast();
        world_from_next
    }
}

fn sinc(x: f64) -> f64 {
    // Below this the next term of the series is under 1e-18.
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { libm::sin(x) / x }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    use super::*;

    #[test]
    fn the_arc_ends_where_the_circle_does() {
        // (start x, y, yaw), distance, turn, (end x, y, yaw), by hand from the circle's centre.
        let table = [
            ([0.0, 0.0, 0.0], 1.0, 0.0, [1.0, 0.0, 0.0]),
            ([1.0, 2.0, FRAC_PI_2], -0.5, 0.0, [1.0, 1.5, FRAC_PI_2]),
            ([0.0, 0.0, 0.0], FRAC_PI_2, FRAC_PI_2, [1.0, 1.0, FRAC_PI_2]),
            ([0.0, 0.0, 0.0], FRAC_PI_2, -FRAC_PI_2, [1.0, -1.0, -FRAC_PI_2]),
            ([0.0, 0.0, FRAC_PI_2], -PI, PI, [2.0, 0.0, -FRAC_PI_2]),
            ([3.0, 0.0, 0.3], 0.0, 1.0, [3.0, 0.0, 1.3]),
            ([0.0, 0.0, 0.0], TAU, TAU, [0.0, 0.0, 0.0]),
        ];
        for ([x, y, yaw], distance, turn, [x_end, y_end, yaw_end]) in table {
            let world_from_base = Isometry2::new(Vector2::new(x, y), yaw);
            let end = Arc { world_from_base, distance, turn }.at(1.0);
            let expected = Isometry2::new(Vector2::new(x_end, y_end), yaw_end);
            assert!((end.translation.vector - expected.translation.vector).norm() < 1e-14, "{end}");
            assert!(end.rotation.angle_to(&expected.rotation).abs() < 1e-14, "{end}");
        }
    }

    #[test]
    fn two_halves_make_the_whole_however_slight_the_turn() {
        for exponent in -14..2 {
            let turn = 10_f64.powi(exponent);
            let whole = Arc { world_from_base: Isometry2::identity(), distance: 0.3, turn };
            let rest = Arc { world_from_base: whole.at(0.4), distance: 0.18, turn: 0.6 * turn };
            let gap = rest.at(1.0).translation.vector - whole.at(1.0).translation.vector;
            assert!(gap.norm() < 1e-15, "turn {turn}: {gap}");
        }
    }
}

//! Somebody's estimate of the pose against the truth.

use std::f64::consts::PI;

use interfaces::Pose;
use nalgebra::{Isometry2, Point2, UnitComplex};

/// How far an estimate is from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// [m] Between the two positions.
    pub position: f64,
    /// [rad] True heading minus estimated, in `-PI..=PI`.
    pub heading: f64,
    /// Whether both are within tolerance.
    pub within: bool,
}

impl PoseError {
    pub(crate) fn of(
        estimate: &Pose,
        world_from_base: &Isometry2<f64>,
        position_tolerance: f64,
        heading_tolerance: f64,
    ) -> Self {
        let truth = Point2::from(world_from_base.translation.vector);
        let position = (truth - Point2::new(estimate.x, estimate.y)).norm();
        let heading = UnitComplex::new(estimate.yaw).angle_to(&world_from_base.rotation);
        let within = position <= position_tolerance && heading.abs() <= heading_tolerance;
        Self { position, heading: heading.clamp(-PI, PI), within }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn an_estimate_is_compared_by_distance_and_by_wrapped_angle() {
        // True yaw, estimated yaw, expected error of heading, within 10 degrees.
        let table = [
            (0.0, 0.0, 0.0, true),
            (0.1, 0.0, 0.1, true),
            (0.2, 0.0, 0.2, false),
            (-0.2, 0.0, -0.2, false),
            (PI - 0.05, -PI + 0.05, -0.1, true),
            (-PI + 0.05, PI - 0.05, 0.1, true),
            (PI, -PI, 0.0, true),
            (0.0, 7.0, 2.0 * PI - 7.0, false),
        ];
        for (truth, yaw, heading, within) in table {
            let world_from_base = Isometry2::new(Vector2::new(1.0, 2.0), truth);
            let estimate = Pose { x: 1.03, y: 1.96, yaw, ..Pose::default() };
            let error = PoseError::of(&estimate, &world_from_base, 0.1, 10_f64.to_radians());
            assert!((error.position - 0.05).abs() < 1e-12, "{truth} {yaw}: {error:?}");
            assert!((error.heading - heading).abs() < 1e-12, "{truth} {yaw}: {error:?}");
            assert_eq!(error.within, within, "{truth} {yaw}: {error:?}");
        }
    }

    #[test]
    fn a_far_estimate_or_none_at_all_is_not_within() {
        for x in [0.11, -0.11, f64::NAN, f64::INFINITY] {
            let estimate = Pose { x, ..Pose::default() };
            assert!(!PoseError::of(&estimate, &Isometry2::identity(), 0.1, 1.0).within, "{x}");
        }
        let estimate = Pose { yaw: f64::NAN, ..Pose::default() };
        assert!(!PoseError::of(&estimate, &Isometry2::identity(), 0.1, 1.0).within);
    }
}

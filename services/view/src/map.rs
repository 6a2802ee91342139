//! Where things are: poses, walls, and the map that somebody else has read.

use std::path::Path;

use interfaces::Odometry;

/// What reads a world's file: the walls in it, and its start of this name.
pub type FindMap = fn(world: &Path, start: &str) -> Option<Map>;

/// A place and a heading, in a frame that the variable's name tells.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// [m] Along x.
    pub x: f64,
    /// [m] Along y.
    pub y: f64,
    /// [rad] Counterclockwise from x.
    pub yaw: f64,
}

/// The walls around a robot, and where it started.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Map {
    /// [m] The two ends of each wall, in the map's frame.
    pub walls: Vec<[[f64; 2]; 2]>,
    /// Where the robot started: the origin of `odom`, in the map's frame.
    pub start: Pose,
}

impl Pose {
    /// What odometry says, in `odom`.
    pub(crate) const fn of(odometry: &Odometry) -> Self {
        Self { x: odometry.x, y: odometry.y, yaw: odometry.yaw }
    }

    /// `a_from_b` times `b_from_c`.
    pub(crate) fn times(self, other: Self) -> Self {
        let [x, y] = self.place([other.x, other.y]);
        Self { x, y, yaw: self.yaw + other.yaw }
    }

    /// `b_from_a` of `a_from_b`.
    pub(crate) fn inverse(self) -> Self {
        let (sine, cosine) = libm::sincos(self.yaw);
        Self {
            x: -cosine * self.x - sine * self.y,
            y: sine * self.x - cosine * self.y,
            yaw: -self.yaw,
        }
    }

    /// A point of the inner frame in the outer one.
    pub(crate) fn place(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sine, cosine) = libm::sincos(self.yaw);
        [self.x + cosine * x - sine * y, self.y + sine * x + cosine * y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_is_nowhere() {
        let pose = Pose { x: 1.0, y: -2.0, yaw: 2.5 };
        let Pose { x, y, yaw } = pose.times(pose.inverse());

        assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && yaw.abs() < 1e-12, "{x} {y} {yaw}");
    }
}

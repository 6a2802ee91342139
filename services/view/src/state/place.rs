//! Where the robot is on its map, where it has been, and what it sees there.

use std::collections::VecDeque;

use interfaces::{LaserScan, Odometry, Stamp};

use crate::map::{Map, Pose};

/// [m] Between two points of the trail.
const TRAIL_STEP: f64 = 0.02;

/// [-] Points of the trail: eighty metres.
const TRAIL_MAX: usize = 4_000;

/// [-] Poses among which that of a scan is looked for: a second and more at 20 Hz.
const POSES_MAX: usize = 64;

/// [m] Of the LiDAR along x of `base_link`: a Burger's.
const SENSOR_X: f64 = -0.032;

/// The robot on its map.
#[derive(Debug, Clone, Default)]
pub(crate) struct Place {
    pub(crate) map: Option<Map>,
    /// Whether the robot itself tells its pose on the map, so that odometry only passes it on.
    pub(crate) reports_pose: bool,
    /// Where `odom` lies on the map; unknown where odometry began anew while the robot stood
    /// somewhere that nobody saw.
    anchor: Option<Anchor>,
    poses: VecDeque<(Stamp, Pose)>,
    odometry: Option<Odometry>,
    scan: Option<Box<LaserScan>>,
    /// [m] What the LiDAR's beams met, on the map.
    pub(crate) returns: Vec<[f64; 2]>,
    /// [m] Where the robot was, on the map.
    pub(crate) trail: VecDeque<[f64; 2]>,
}

/// Where a life of odometry has its origin.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    odometry_epoch: u32,
    world_epoch: Option<u32>,
    map_from_odom: Pose,
    is_known: bool,
}

impl Place {
    pub(crate) fn set_map(&mut self, map: Option<Map>) {
        if self.map != map {
            self.map = map;
            self.anchor = None;
            self.poses.clear();
            self.trail.clear();
        }
    }

    pub(crate) fn hear_odometry(&mut self, odometry: &Odometry) {
        let map_from_odom = self.anchor(odometry);
        let pose = map_from_odom.times(Pose::of(odometry));
        self.odometry = Some(*odometry);
        if self.poses.len() == POSES_MAX {
            self.poses.pop_front();
        }
        self.poses.push_back((odometry.header.stamp, pose));
        let here = [pose.x, pose.y];
        let is_further = self.trail.back().is_none_or(|last| TRAIL_STEP <= distance(*last, here));
        if is_further {
            if self.trail.len() == TRAIL_MAX {
                self.trail.pop_front();
            }
            self.trail.push_back(here);
        }
    }

    pub(crate) fn hear_scan(&mut self, scan: &LaserScan) {
        match &mut self.scan {
            Some(known) => **known = *scan,
            None => self.scan = Some(Box::new(*scan)),
        }
    }

    /// Where `odom` lies on the map. Odometry starts at the origin: at the robot's start, unless it
    /// has died and the world has not. Then it is where the robot was last seen.
    fn anchor(&mut self, odometry: &Odometry) -> Pose {
        let odometry_epoch = odometry.header.epoch;
        let world_epoch = self.scan.as_ref().map(|scan| scan.header.epoch);
        let start = self.map.as_ref().map_or_else(Pose::default, |map| map.start);
        let start = if self.reports_pose { Pose::default() } else { start };
        let anchor = match self.anchor {
            Some(known) if known.odometry_epoch == odometry_epoch => return known.map_from_odom,
            Some(known) if known.world_epoch == world_epoch => {
                let last = self.poses.back().map_or(start, |(_, pose)| *pose);
                let map_from_odom = last.times(Pose::of(odometry).inverse());
                Anchor { odometry_epoch, world_epoch, map_from_odom, is_known: known.is_known }
            }
            // Both began together, or so their lives say.
            known => {
                let is_known = self.reports_pose
                    || known.is_some()
                    || world_epoch.is_none_or(|epoch| epoch == odometry_epoch);
                self.trail.clear();
                Anchor { odometry_epoch, world_epoch, map_from_odom: start, is_known }
            }
        };
        self.anchor = Some(anchor);
        anchor.map_from_odom
    }

    /// Puts the newest scan where the robot was when it was taken.
    pub(crate) fn settle(&mut self) {
        let Some(scan) = &self.scan else { return };
        let stamp = scan.header.stamp;
        let apart = |of: Stamp| of.since(stamp).max(stamp.since(of));
        let nearest = self.poses.iter().min_by_key(|(of, _)| apart(*of));
        let Some((_, map_from_base)) = nearest else { return };
        let map_from_scan = map_from_base.times(Pose { x: SENSOR_X, ..Pose::default() });
        self.returns.clear();
        for (beam, &range) in scan.ranges().iter().enumerate() {
            if scan.range_min <= range && range <= scan.range_max {
                let angle = scan.angle_min + beam as f32 * scan.angle_increment;
                let (sine, cosine) = libm::sincos(f64::from(angle));
                let range = f64::from(range);
                self.returns.push(map_from_scan.place([range * cosine, range * sine]));
            }
        }
    }

    /// Where the robot is, on the map, as odometry believes.
    pub(crate) fn pose(&self) -> Option<Pose> {
        self.poses.back().map(|(_, pose)| *pose)
    }

    /// The newest odometry.
    pub(crate) const fn odometry(&self) -> Option<&Odometry> {
        self.odometry.as_ref()
    }

    /// Whether the robot is where it is drawn, as far as anybody can tell.
    pub(crate) fn is_known(&self) -> bool {
        self.anchor.is_none_or(|anchor| anchor.is_known)
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

//! One turn of the LiDAR, from where it sits on the robot.

use std::f64::consts::TAU;

use fearless_simd::dispatch;
use interfaces::LaserScan;
use nalgebra::{Isometry2, Vector2};

use crate::discs::{Beams, Disc};
use crate::geometry::Walls;
use crate::noise::{Noise, RangeNoise};
use crate::raster::{Eye, Raster, single};
use crate::{Config, LidarConfig};

/// [-] So much farther than its range a beam is followed, so that rounding cannot lose a wall at the
/// very end of the range.
const BEYOND: f64 = 1e-6;

/// The LiDAR on its robot. It measures a whole turn at one moment.
pub(crate) struct Lidar {
    config: LidarConfig,
    /// [s] Between two scans.
    period: f64,
    base_from_scan: Isometry2<f64>,
    raster: Raster,
    beams: Beams,
    /// [m] How far a beam is followed.
    reach: f64,
    noise: RangeNoise,
}

impl Lidar {
    pub(crate) fn new(config: &Config) -> Self {
        let lidar = &config.lidar;
        let reach = lidar.range_max_m * (1.0 + BEYOND);
        Self {
            config: lidar.clone(),
            period: config.dt_s,
            base_from_scan: Isometry2::translation(lidar.sensor_x_m, 0.0),
            raster: Raster::new(lidar.beams, reach),
            beams: Beams::new(lidar.beams),
            reach,
            noise: RangeNoise::new(lidar.noise, config.seed),
        }
    }

    pub(crate) const fn set_noise(&mut self, noise: Noise) {
        self.noise.set(noise);
    }

    /// Measures into `scan`, which is new, or was measured into before: what has no beam is zero and
    /// stays so, since a scan of few beams is not to cost what one of many does.
    pub(crate) fn sense(
        &mut self,
        walls: &Walls,
        others: &[Disc],
        world_from_base: &Isometry2<f64>,
        scan: &mut LaserScan,
    ) {
        self.describe(scan);
        let world_from_scan = world_from_base * self.base_from_scan;
        walls.grid().cast(&mut self.raster, &Eye::new(&world_from_scan), scan.ranges_mut());
        self.beams.cast(others, &world_from_scan, self.reach, scan.ranges_mut());

        let (range_min, range_max) = (scan.range_min, scan.range_max);
        if !self.noise.is_ideal() {
            for range in scan.ranges_mut() {
                *range = single(self.noise.measure(f64::from(*range)));
            }
        }
        let ranges = scan.ranges_mut();
        dispatch!(self.raster.level(), _unit => report(ranges, range_min, range_max));
    }

    /// Writes what is the same in every scan.
    fn describe(&self, scan: &mut LaserScan) {
        let lidar = &self.config;
        let angle_increment = TAU / lidar.beams as f64;
        scan.angle_max = single((lidar.beams - 1) as f64 * angle_increment);
        scan.angle_increment = single(angle_increment);
        scan.scan_time = single(self.period);
        scan.range_min = single(lidar.range_min_m);
        scan.range_max = single(lidar.range_max_m);
        scan.length = u32::try_from(lidar.beams).expect("validated: a scan holds so many beams");
    }

    /// One beam, as measured.
    pub(crate) fn range(
        &mut self,
        walls: &Walls,
        others: &[Disc],
        world_from_base: &Isometry2<f64>,
        angle: f64,
    ) -> f64 {
        let world_from_scan = world_from_base * self.base_from_scan;
        let (sin, cos) = libm::sincos(angle);
        let origin = world_from_scan.translation.vector.into();
        let direction = world_from_scan.rotation * Vector2::new(cos, sin);
        let by_wall = walls.cast(origin, direction, self.reach);
        let by_others = others.iter().filter_map(|other| other.meet(origin, direction));
        let ranges = by_wall.into_iter().chain(by_others.filter(|&range| range <= self.reach));
        self.noise.measure(ranges.fold(f64::INFINITY, f64::min))
    }
}

/// Makes ranges what REP 117 wants them to be.
#[expect(clippy::inline_always, reason = "what is inlined is compiled for the vector unit")]
#[inline(always)]
fn report(ranges: &mut [f32], range_min: f32, range_max: f32) {
    for range in ranges {
        // Of the many NaNs always the same, since scans are compared by their bytes.
        let told = if range.is_nan() { f32::NAN } else { *range };
        let told = if told < range_min { f32::NEG_INFINITY } else { told };
        *range = if told > range_max { f32::INFINITY } else { told };
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use nalgebra::{Point2, Vector2};
    use serde::Deserialize;

    use super::*;
    use crate::geometry::Wall;
    use crate::{Noise, World};

    /// The robot in the middle of a square room, `half` from each wall, and what it measures.
    fn scan_of_room(half: f64, lidar: LidarConfig) -> LaserScan {
        let world: World = toml::from_str(&format!(
            "segment = [
                {{ name = 'a', x1_m = -{half}, y1_m = -{half}, x2_m = {half}, y2_m = -{half} }},
                {{ name = 'b', x1_m = {half}, y1_m = -{half}, x2_m = {half}, y2_m = {half} }},
                {{ name = 'c', x1_m = {half}, y1_m = {half}, x2_m = -{half}, y2_m = {half} }},
                {{ name = 'd', x1_m = -{half}, y1_m = {half}, x2_m = -{half}, y2_m = -{half} }},
            ]"
        ))
        .unwrap();
        scan_of(&world, &Isometry2::identity(), lidar)
    }

    fn scan_of(world: &World, world_from_base: &Isometry2<f64>, lidar: LidarConfig) -> LaserScan {
        let config = Config { lidar, ..Config::default() };
        let mut scan = LaserScan::default();
        // What was measured before must not be seen.
        scan.range[..config.lidar.beams].fill(9.0);
        Lidar::new(&config).sense(&Walls::new(world.walls()), &[], world_from_base, &mut scan);
        scan
    }

    #[derive(Deserialize)]
    struct Reference {
        pose: [f64; 3],
        ambiguous_beams: Vec<usize>,
        sensor_offset: f64,
        beams: usize,
        ranges: Vec<f64>,
    }

    #[test]
    fn the_reference_scans_of_lab02_agree_within_a_millimetre() {
        let world: World =
            toml::from_str(include_str!("../../../config/worlds/lab02.toml")).unwrap();
        let references: Vec<Reference> =
            serde_json::from_str(include_str!("../tests/data/lab02_scans.json")).unwrap();
        assert_eq!(references.len(), 5);

        for Reference { pose: [x, y, yaw], ambiguous_beams, sensor_offset, beams, ranges } in
            references
        {
            let lidar = LidarConfig { beams, sensor_x_m: sensor_offset, ..LidarConfig::default() };
            let scan = scan_of(&world, &Isometry2::new(Vector2::new(x, y), yaw), lidar);
            assert_eq!(scan.len(), ranges.len());
            for (beam, (&range, expected)) in scan.ranges().iter().zip(ranges).enumerate() {
                let error = (f64::from(range) - expected).abs();
                let agrees = error < 1e-3 || ambiguous_beams.contains(&beam);
                assert!(agrees, "({x}, {y}, {yaw}) beam {beam}: {range}, expected {expected}");
            }
        }
    }

    /// [m] How far a ray gets, by the textbook.
    fn cast(walls: &[Wall], origin: Point2<f64>, angle: f64) -> f64 {
        let direction = Vector2::new(libm::cos(angle), libm::sin(angle));
        let ranges = walls.iter().filter_map(|wall| {
            let (along, offset) = (wall.b - wall.a, wall.a - origin);
            let range = offset.perp(&along) / direction.perp(&along);
            let share = offset.perp(&direction) / direction.perp(&along);
            (range >= 0.0 && (0.0..=1.0).contains(&share)).then_some(range)
        });
        ranges.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_beam_slips_through_and_none_is_stopped_early() {
        let world: World =
            toml::from_str(include_str!("../../../config/worlds/lab02.toml")).unwrap();
        let walls = world.walls();
        let centres: Vec<[f64; 2]> =
            world.starts.values().flat_map(|start| start.corridor_m.clone()).collect();
        // In the middle of the cells, where beams run right into corners, and beside it.
        for (offset, yaw) in [(0.0, 0.0), (0.003, 0.1), (-0.05, 2.0)] {
            for &[x, y] in &centres {
                let world_from_base = Isometry2::new(Vector2::new(x + offset, y), yaw);
                let lidar = LidarConfig { sensor_x_m: 0.0, ..LidarConfig::default() };
                let scan = scan_of(&world, &world_from_base, lidar);
                for (beam, &range) in scan.ranges().iter().enumerate() {
                    let angle = yaw + beam as f64 * TAU / 240.0;
                    let origin = world_from_base.translation.vector.into();
                    // A beam that grazes a corner may pass it on either side.
                    let beside = [-1e-9, 0.0, 1e-9].map(|by| cast(&walls, origin, angle + by));
                    let agrees = beside.iter().any(|at| (f64::from(range) - at).abs() < 1e-5);
                    assert!(agrees, "{origin} {yaw} beam {beam}: {range}, expected {beside:?}");
                }
            }
        }
    }

    #[test]
    fn the_scan_is_taken_where_the_sensor_is() {
        // Straight ahead, left, behind, right.
        let table = [(0.0, [1.0, 1.0, 1.0, 1.0]), (-0.1, [1.1, 1.0, 0.9, 1.0])];
        for (sensor_x_m, expected) in table {
            let lidar = LidarConfig { beams: 4, sensor_x_m, ..LidarConfig::default() };
            let scan = scan_of_room(1.0, lidar);
            for (range, expected) in scan.ranges().iter().zip(expected) {
                assert!((range - expected).abs() < 1e-6, "{sensor_x_m}: {:?}", scan.ranges());
            }
        }
    }

    #[test]
    fn a_single_beam_is_that_of_the_whole_scan() {
        let world: World =
            toml::from_str(include_str!("../../../config/worlds/lab02.toml")).unwrap();
        let walls = Walls::new(world.walls());
        let world_from_base = Isometry2::new(Vector2::new(1.0, -0.9), 1.4);
        let scan = scan_of(&world, &world_from_base, LidarConfig::default());
        let mut lidar = Lidar::new(&Config::default());
        for (beam, &range) in scan.ranges().iter().enumerate() {
            let angle = beam as f64 * TAU / 240.0;
            // Whole turns do not matter.
            for angle in [angle, angle - TAU] {
                let single = lidar.range(&walls, &[], &world_from_base, angle);
                assert!((single - f64::from(range)).abs() < 1e-5, "beam {beam}: {single} {range}");
            }
        }
    }

    #[test]
    fn a_scan_says_what_it_is() {
        for beams in [1, 240, 480, 1440] {
            let scan = scan_of_room(1.0, LidarConfig { beams, ..LidarConfig::default() });
            let increment = TAU / beams as f64;
            assert_eq!(scan.len(), beams);
            assert_eq!(scan.angle_min, 0.0);
            assert!((f64::from(scan.angle_increment) - increment).abs() < 1e-6);
            assert!((f64::from(scan.angle_max) - (TAU - increment)).abs() < 1e-6);
            assert_eq!((scan.range_min, scan.range_max, scan.scan_time), (0.12, 8.0, 0.05));
            assert!(scan.range[beams..].iter().chain(&scan.intensity).all(|&value| value == 0.0));
        }
    }

    #[test]
    fn what_is_no_range_is_told_by_rep_117() {
        // Half the room, the LiDAR's range, and what it tells straight ahead.
        let table = [
            (1.0, (0.12, 8.0), 1.0),
            (0.11, (0.12, 8.0), f32::NEG_INFINITY),
            (8.1, (0.12, 8.0), f32::INFINITY),
            // At the bounds themselves.
            (0.12, (0.12, 8.0), 0.12),
            (8.0, (0.12, 8.0), 8.0),
            (3.5, (3.5, 8.0), 3.5),
        ];
        for (half, (range_min_m, range_max_m), expected) in table {
            let lidar = LidarConfig {
                beams: 1,
                range_min_m,
                range_max_m,
                sensor_x_m: 0.0,
                noise: Noise::Ideal,
            };
            let range = scan_of_room(half, lidar).ranges()[0];
            // By rounding alone: a range that is told is within the bounds, to the last bit.
            let agrees = range == expected || (range - expected).abs() < 1e-6;
            let is_told = range.is_infinite() || single(range_min_m) <= range && range <= 8.0;
            assert!(agrees && is_told, "{half}: {range}, expected {expected}");
        }
    }

    #[test]
    fn noise_decides_what_is_too_close_or_fails() {
        let lidar = |noise| LidarConfig { beams: 480, noise, ..LidarConfig::default() };
        let scan = scan_of_room(0.13, lidar(Noise::Gazebo));
        assert!(scan.ranges().contains(&f32::NEG_INFINITY));

        let scan = scan_of_room(1.0, lidar(Noise::Lds01));
        let nans: Vec<u32> = scan
            .ranges()
            .iter()
            .filter(|range| range.is_nan())
            .map(|range| range.to_bits())
            .collect();
        assert!(!nans.is_empty());
        assert!(nans.iter().all(|&bits| bits == f32::NAN.to_bits()));
    }
}

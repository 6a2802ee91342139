//! The LiDAR by itself, without robot, noise or message, for whoever measures what a scan costs.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Vector2};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::geometry::Walls;
use crate::raster::{Eye, Raster};
use crate::{Segment, World};

/// Beams evenly round a place in a world, as many as one likes.
pub struct Scanner {
    walls: Walls,
    raster: Raster,
    directions: Vec<Vector2<f64>>,
    reach: f64,
}

impl Scanner {
    /// `range_max` is in metres.
    pub fn new(world: &World, beams: usize, range_max: f64) -> Self {
        let directions = (0..beams).map(|beam| {
            let (sin, cos) = libm::sincos(beam as f64 * TAU / beams as f64);
            Vector2::new(cos, sin)
        });
        Self {
            walls: Walls::new(world.walls()),
            raster: Raster::new(beams, range_max),
            directions: directions.collect(),
            reach: range_max,
        }
    }

    /// [m] Writes how far each beam gets from this place, as the simulator's LiDAR does; infinity where
    /// it meets nothing.
    pub fn cast(&mut self, world_from_scan: &Isometry2<f64>, ranges: &mut [f32]) {
        self.walls.grid().cast(&mut self.raster, &Eye::new(world_from_scan), ranges);
    }

    /// [m] The same by one query of parry's tree for each beam.
    pub fn cast_by_parry(&self, world_from_scan: &Isometry2<f64>, ranges: &mut [f64]) {
        let origin = world_from_scan.translation.vector.into();
        for (range, direction) in ranges.iter_mut().zip(&self.directions) {
            let direction = world_from_scan.rotation * direction;
            *range = self.walls.cast(origin, direction, self.reach).unwrap_or(f64::INFINITY);
        }
    }
}

/// A maze of square cells of 1 m, `side` in a row, with one way between any two of them: it has
/// `(side + 1)²` walls of one cell's side each. The lower left corner is the origin.
pub fn maze(side: usize, seed: u64) -> World {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Whether the wall to the right of the cell, and that above it, stands.
    let mut stands = vec![[true; 2]; side * side];
    let mut visited = vec![false; side * side];
    let mut way = vec![0];
    visited[0] = true;
    while let Some(&cell) = way.last() {
        let (row, column) = (cell / side, cell % side);
        let ways = [
            (column + 1 < side).then(|| (cell + 1, cell, 0)),
            (row + 1 < side).then(|| (cell + side, cell, 1)),
            (column > 0).then(|| (cell - 1, cell - 1, 0)),
            (row > 0).then(|| (cell - side, cell - side, 1)),
        ];
        let open: Vec<_> =
            ways.into_iter().flatten().filter(|&(next, ..)| !visited[next]).collect();
        if open.is_empty() {
            way.pop();
        } else {
            let (next, beside, wall) = open[random.next_u32() as usize % open.len()];
            stands[beside][wall] = false;
            visited[next] = true;
            way.push(next);
        }
    }
    let right_and_above = stands.iter().enumerate().flat_map(|(cell, &[right, above])| {
        let (x, y) = ((cell % side) as f64, (cell / side) as f64);
        let right = right.then(|| segment([x + 1.0, y], [x + 1.0, y + 1.0]));
        let above = above.then(|| segment([x, y + 1.0], [x + 1.0, y + 1.0]));
        right.into_iter().chain(above)
    });
    let left_and_below = (0..side)
        .map(|cell| cell as f64)
        .flat_map(|at| [segment([0.0, at], [0.0, at + 1.0]), segment([at, 0.0], [at + 1.0, 0.0])]);
    World { segments: right_and_above.chain(left_and_below).collect(), ..World::default() }
}

fn segment([x1_m, y1_m]: [f64; 2], [x2_m, y2_m]: [f64; 2]) -> Segment {
    Segment { name: String::new(), x1_m, y1_m, x2_m, y2_m }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_4;

    use nalgebra::Point2;

    use super::*;
    use crate::Block;
    use crate::raster;

    const LAB02: &str = include_str!("../../../config/worlds/lab02.toml");

    fn between(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(random.next_u32()) / f64::from(u32::MAX)
    }

    /// Boxes and walls of any size and direction, `width` wide and so far from the origin.
    fn random_world(random: &mut ChaCha8Rng, items: usize, width: f64, off: f64) -> World {
        let mut world = World::default();
        for _ in 0..items {
            let [x, y] = [0; 2].map(|_| off + between(random, 0.0, width));
            let [length, yaw] = [between(random, -2.0, 1.0), between(random, -4.0, 4.0)];
            let length = 10_f64.powf(length);
            if random.next_u32().is_multiple_of(2) {
                let end = [x + length * libm::cos(yaw), y + length * libm::sin(yaw)];
                world.segments.push(segment([x, y], end));
            } else {
                world.blocks.push(Block {
                    name: String::new(),
                    x_m: x,
                    y_m: y,
                    size_x_m: length,
                    size_y_m: between(random, 0.01, 1.0),
                    yaw_rad: yaw,
                });
            }
        }
        world
    }

    /// Some places in the world where a robot can be.
    fn random_places(
        random: &mut ChaCha8Rng,
        world: &World,
        walls: &Walls,
        (width, off): (f64, f64),
    ) -> Vec<[f64; 3]> {
        let any = (0..20).map(|_| {
            let [x, y] = [0; 2].map(|_| off + between(random, -0.1 * width, 1.1 * width));
            [x, y, between(random, -4.0, 4.0)]
        });
        let is_free = |&[x, y, _]: &[f64; 3]| {
            let position = Point2::new(x, y);
            walls.distance(position) > 0.001
                && !world.blocks.iter().any(|block| block.contains(position))
        };
        any.filter(is_free).collect()
    }

    fn pose([x, y, yaw]: [f64; 3]) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(x, y), yaw)
    }

    /// The first beam that is more than a millimetre off what parry says of it, or of a beam that is
    /// turned by no more than a microradian.
    fn disagreement(scanner: &mut Scanner, [x, y, yaw]: [f64; 3]) -> Option<String> {
        let beams = scanner.directions.len();
        let mut ranges = vec![0.0; beams];
        scanner.cast(&pose([x, y, yaw]), &mut ranges);
        let beside = [-1e-6, 0.0, 1e-6].map(|turn| {
            let mut ranges = vec![0.0; beams];
            scanner.cast_by_parry(&pose([x, y, yaw + turn]), &mut ranges);
            ranges
        });
        (0..beams).find_map(|beam| {
            let found = f64::from(ranges[beam]);
            let expected = [&beside[0], &beside[1], &beside[2]].map(|ranges| ranges[beam]);
            let least = expected.iter().copied().fold(f64::MAX, f64::min);
            let most = expected.iter().copied().fold(f64::MIN, f64::max);
            let is_near = expected.iter().any(|&range| (found - range).abs() < 1e-3);
            // A wall that the beam grazes is as far away as such a beam says, and one at the end of the
            // reach may be beyond it.
            let grazes = least < found && found < most && most - least < 0.1;
            let is_far = found.max(most).is_infinite() && found.min(least) > scanner.reach - 1e-3;
            let both = found.is_infinite() && most.is_infinite();
            let agrees = is_near || grazes || is_far || both;
            (!agrees).then(|| format!("({x}, {y}, {yaw}) beam {beam}: {found}, parry {expected:?}"))
        })
    }

    // Breaks, as it should, where an interval of beams is a hundredth of a radian narrower, where the
    // end of the first turn is not drawn beyond, where a square's rest is taken for one cell farther
    // away than it is, and where differences to the eye are made of rounded coordinates.
    #[test]
    fn every_beam_agrees_with_parry_within_a_millimetre() {
        for seed in 0..300 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let items = [1, 5, 30, 100, 400][random.next_u32() as usize % 5];
            let width = between(&mut random, 1.0, 40.0);
            let off = [0.0, 1000.0, -3000.0][random.next_u32() as usize % 3];
            let world = random_world(&mut random, items, width, off);
            let beams = [1, 7, 16, 60, 240, 479, 1440][random.next_u32() as usize % 7];
            let reach = between(&mut random, 0.5, 20.0);
            let mut scanner = Scanner::new(&world, beams, reach);
            let places = random_places(&mut random, &world, &scanner.walls, (width, off));
            for place in places {
                let wrong = disagreement(&mut scanner, place);
                assert_eq!(wrong, None, "SEED={seed}: {items} items on {width} m, reach {reach}");
            }
        }
    }

    fn ranges(scanner: &mut Scanner, place: [f64; 3]) -> Vec<f32> {
        let mut ranges = vec![0.0; scanner.directions.len()];
        scanner.cast(&pose(place), &mut ranges);
        ranges
    }

    /// A closed room of that many walls, none of them long, about that place.
    fn room(corners: usize, centre: [f64; 2]) -> (World, Vec<[f64; 2]>) {
        let corner = |index: usize| {
            let angle = (index % corners) as f64 * TAU / corners as f64;
            // A star: corners that point inwards as well.
            let radius = if (index % corners).is_multiple_of(2) { 2.0 } else { 1.7 };
            [centre[0] + radius * libm::cos(angle), centre[1] + radius * libm::sin(angle)]
        };
        let corners: Vec<_> = (0..=corners).map(corner).collect();
        let walls = corners.windows(2).map(|ends| segment(ends[0], ends[1]));
        (World { segments: walls.collect(), ..World::default() }, corners)
    }

    // Breaks, as it should, where a beam right into either end of a wall does not meet it.
    #[test]
    fn no_beam_escapes_through_a_corner() {
        for corners in [3, 4, 5, 7, 12, 39, 127, 128, 129, 500, 2000] {
            for centre in [[0.3, 0.7], [1000.0, -1000.0]] {
                let (world, vertices) = room(corners, centre);
                let mut scanner = Scanner::new(&world, 240, 8.0);
                for seed in 0..20 {
                    let mut random = ChaCha8Rng::seed_from_u64(seed);
                    let [x, y] = centre.map(|at| at + between(&mut random, -0.5, 0.5));
                    let aim = vertices[random.next_u32() as usize % corners];
                    let (dx, dy) = (aim[0] - x, aim[1] - y);
                    let place = [x, y, libm::atan2(dy, dx)];
                    let escaped = ranges(&mut scanner, place).contains(&f32::INFINITY);
                    assert!(!escaped, "SEED={seed}: {corners} corners about {centre:?}");
                    let wrong = disagreement(&mut scanner, place);
                    assert_eq!(wrong, None, "SEED={seed}: {corners} corners about {centre:?}");
                }
            }
        }
    }

    #[test]
    fn no_beam_passes_between_the_walls_that_meet_at_a_post() {
        for (side, off) in [(5, 0.0), (40, 0.0), (40, 1000.0)] {
            let mut world = maze(side, 1);
            for wall in &mut world.segments {
                for at in [&mut wall.x1_m, &mut wall.y1_m, &mut wall.x2_m, &mut wall.y2_m] {
                    *at += off;
                }
            }
            let mut scanner = Scanner::new(&world, 8, 8.0);
            for cell in 0..side * side {
                let [x, y] = [cell % side, cell / side].map(|at| off + at as f64 + 0.5);
                for turn in 0..4 {
                    // Every other beam goes right into a post.
                    let wrong = disagreement(&mut scanner, [x, y, f64::from(turn) * FRAC_PI_4]);
                    assert_eq!(wrong, None, "{side} cells in a row");
                }
            }
        }
    }

    // Breaks, as it should, where the edge of the wall is made of rounded differences.
    #[test]
    fn a_wall_that_a_beam_grazes_is_where_it_is() {
        // Degrees between beam and wall, and how far off the range may be.
        for (degrees, error_max) in [(30.0, 1e-5), (5.0, 1e-5), (1.0, 2e-4), (0.3, 1e-3)] {
            for piece in [2.0, 0.05] {
                for seed in 0..200 {
                    let mut random = ChaCha8Rng::seed_from_u64(seed);
                    let range = between(&mut random, 1.0, 8.0);
                    let yaw = between(&mut random, -4.0, 4.0);
                    let [x, y] = [0; 2].map(|_| between(&mut random, -20.0, 20.0));
                    let (hit_x, hit_y) = (x + range * libm::cos(yaw), y + range * libm::sin(yaw));
                    let along = yaw + f64::to_radians(degrees);
                    let (cos, sin) = (libm::cos(along), libm::sin(along));
                    let end = |at: f64| [hit_x + at * cos, hit_y + at * sin];
                    let world = World {
                        segments: vec![segment(end(-0.3 * piece), end(0.7 * piece))],
                        ..World::default()
                    };
                    let mut scanner = Scanner::new(&world, 60, 9.0);
                    let error = f64::from(ranges(&mut scanner, [x, y, yaw])[0]) - range;
                    assert!(error.abs() < error_max, "SEED={seed}: {degrees} degrees: {error} m");
                }
            }
        }
    }

    // Breaks, as it should, where inverse depths are not held between those of the wall's ends.
    #[test]
    fn a_wall_seen_end_on_hides_nothing_and_appears_nowhere_else() {
        for seed in 0..10_000 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let [x, y] = [0; 2].map(|_| between(&mut random, -20.0, 20.0));
            let yaw = between(&mut random, -4.0, 4.0);
            let off = 10_f64.powf(between(&mut random, -18.0, -6.0));
            let (cos, sin) = (libm::cos(yaw), libm::sin(yaw));
            let end = |ahead: f64, aside: f64| {
                [x + ahead * cos - aside * sin, y + ahead * sin + aside * cos]
            };
            let end_on = segment(end(1.0, off), end(2.0, -off));
            let behind = segment(end(3.0, -1.0), end(3.0, 1.0));
            let world = World { segments: vec![end_on, behind], ..World::default() };
            let ranges = ranges(&mut Scanner::new(&world, 240, 8.0), [x, y, yaw]);
            let ahead = ranges[0];
            let is_there = (0.999..2.001).contains(&ahead) || (ahead - 3.0).abs() < 1e-3;
            assert!(is_there, "SEED={seed}, {off} m aside: {ahead}");
            for beside in [ranges[1], ranges[239]] {
                assert!((beside - 3.001).abs() < 1e-3, "SEED={seed}, {off} m aside: {beside}");
            }
        }
    }

    // Breaks, as it should, where an interval that is none is drawn.
    #[test]
    fn walls_at_the_eye_and_at_the_end_of_the_world_disturb_nobody() {
        for far in [1e-60, 1e-50, 1e-40, 1e-20, 1e10, 1e20, 1e60, 1e300] {
            for [x, y] in [[far, far], [far, -far], [-far, 0.0], [0.0, far]] {
                let walls = vec![
                    segment([x, y], [1.0, 2.0]),
                    segment([x, y], [2.0 * y, -x]),
                    segment([3.0, -1.0], [3.0, 1.0]),
                ];
                // One of its sides passes by, from far behind to far ahead.
                let block = Block {
                    name: String::new(),
                    x_m: 0.0,
                    y_m: 1.5,
                    size_x_m: 4.0 * far,
                    size_y_m: 1.0,
                    yaw_rad: 0.0,
                };
                let world = World { segments: walls, blocks: vec![block], ..World::default() };
                for place in [[0.0, 0.0, 0.0], [far, 0.0, 1.0], [-far, far, 2.0]] {
                    let ranges = ranges(&mut Scanner::new(&world, 240, 8.0), place);
                    assert!(ranges.iter().all(|range| *range >= 0.0), "{x} {y} from {place:?}");
                }
            }
        }
    }

    #[test]
    fn a_box_is_seen_from_outside() {
        let text = "box = [{ name = 'a', x_m = 2.0, y_m = 0.0, size_x_m = 1.0, size_y_m = 1.0 }]";
        let world = toml::from_str(text).unwrap();
        let mut scanner = Scanner::new(&world, 4, 8.0);
        // Ahead, left, behind, right of three places: before it, above it, behind it.
        let none = f32::INFINITY;
        let table = [
            ([0.0, 0.0], [1.5, none, none, none]),
            ([2.0, 1.5], [none, none, none, 1.0]),
            ([3.0, 0.0], [none, none, 0.5, none]),
        ];
        for ([x, y], expected) in table {
            assert_eq!(ranges(&mut scanner, [x, y, 0.0]), expected, "{x} {y}");
        }
    }

    /// FNV-1a of all ranges of scans of many kinds.
    fn fingerprint(raster: fn(usize, f64, usize) -> Option<Raster>, unit: usize) -> Option<u64> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let lab02: World = toml::from_str(LAB02).unwrap();
        let boxes = random_world(&mut random, 400, 30.0, 0.0);
        let far = random_world(&mut random, 60, 8.0, 1000.0);
        let worlds =
            [(lab02, 1.0, 0.0), (maze(40, 1), 40.0, 0.0), (boxes, 30.0, 0.0), (far, 8.0, 1000.0)];
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for (world, width, off) in worlds {
            for (beams, reach) in [(7, 2.0), (240, 8.0), (480, 3.5), (1440, 12.0)] {
                let mut scanner = Scanner::new(&world, beams, reach);
                scanner.raster = raster(beams, reach, unit)?;
                for _ in 0..8 {
                    let [x, y] = [0; 2].map(|_| off + between(&mut random, 0.0, width));
                    let place = [x, y, between(&mut random, -4.0, 4.0)];
                    for range in ranges(&mut scanner, place) {
                        for byte in range.to_bits().to_le_bytes() {
                            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
                        }
                    }
                }
            }
        }
        Some(hash)
    }

    // Breaks, as it should, where the inverse depth is made by a fused operation: units that have one
    // round it once.
    #[test]
    fn every_vector_unit_of_every_machine_gives_the_same_bits() {
        let on =
            |beams, reach, unit| raster::tests::on_each_unit(beams, reach).into_iter().nth(unit);
        let found: Vec<u64> = (0..).map_while(|unit| fingerprint(on, unit)).collect();
        println!("{} vector units", found.len());
        // Recorded: another machine or compiler that computes something else fails here.
        assert!(found.iter().all(|&hash| hash == 0x25ed_f378_81fc_68aa), "{found:x?}");
    }
}

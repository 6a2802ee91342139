//! Several robots in one world, as whoever drives them sees it.

use std::f64::consts::FRAC_PI_2;

use interfaces::LaserScan;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use simulator::{Config, Crowd, Overlap, Simulator, Start, World};

const SEED: u64 = 5;

const ROOM: &str = "segment = [
    { name = 'a', x1_m = -2, y1_m = -2, x2_m = 2, y2_m = -2 },
    { name = 'b', x1_m = 2, y1_m = -2, x2_m = 2, y2_m = 2 },
    { name = 'c', x1_m = 2, y1_m = 2, x2_m = -2, y2_m = 2 },
    { name = 'd', x1_m = -2, y1_m = 2, x2_m = -2, y2_m = -2 },
]";

/// A square room of 4 m with a robot at each of these places, looking along x.
fn crowd(places: &[[f64; 2]]) -> Result<Crowd, Overlap> {
    let mut world: World = toml::from_str(ROOM).expect("a room is a world");
    let robot = |(number, &[x_m, y_m]): (usize, &[f64; 2])| {
        let corridor_m = vec![[x_m, y_m], [x_m + 0.4, y_m]];
        let start = Start { x_m, y_m, yaw_rad: 0.0, cell_size_m: 0.4, corridor_m };
        world.starts.insert(number.to_string(), start);
        let mut config = Config { start: number.to_string(), ..Config::default() };
        config.lidar.sensor_x_m = 0.0;
        Simulator::new(&config, &world).expect("the robot fits the room")
    };
    Crowd::new(places.iter().enumerate().map(robot).collect())
}

/// [m] Straight ahead, left, behind and right.
fn seen(robot: &mut Simulator) -> [f32; 4] {
    let mut scan = LaserScan::default();
    robot.sense(&mut scan);
    [0, 60, 120, 180].map(|beam| scan.ranges()[beam])
}

#[test]
fn robots_see_each_other_where_they_are_and_in_front_of_the_walls() {
    let mut crowd = crowd(&[[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]]).expect("they have room");
    let near = |seen: [f32; 4], expected: [f32; 4]| {
        let agrees = seen.iter().zip(expected).all(|(one, other)| (one - other).abs() < 1e-5);
        assert!(agrees, "{seen:?}, expected {expected:?}");
    };
    near(seen(&mut crowd.robots()[0]), [0.895, 2.0, 2.0, 0.895]);
    near(seen(&mut crowd.robots()[1]), [1.0, 2.0, 0.895, 2.0]);

    // The second drives on 0.1 m, and the first is seen where it was.
    for _ in 0..10 {
        crowd.step(&[(0.0, 0.0), (0.2, 0.0), (0.0, 0.0)]);
    }
    near(seen(&mut crowd.robots()[0]), [0.995, 2.0, 2.0, 0.895]);
    near(seen(&mut crowd.robots()[1]), [0.9, 2.0, 0.995, 2.0]);
    // A single beam is that of the scan.
    assert!((crowd.robots()[0].range(0.0) - 0.995).abs() < 1e-9);
    assert!((crowd.robots()[0].range(-FRAC_PI_2) - 0.895).abs() < 1e-9);
}

#[test]
fn who_runs_into_another_stops_and_counts_it_once() {
    let mut crowd = crowd(&[[0.0, 0.0], [1.0, 0.0]]).expect("they have room");
    for _ in 0..200 {
        crowd.step(&[(0.2, 0.0), (0.0, 0.0)]);
    }
    let x = crowd.robots()[0].world_from_base().translation.x;
    assert!((x - 0.79).abs() < 1e-9, "{x}");
    assert_eq!([0, 1].map(|robot| crowd.robots()[robot].collisions()), [1, 0]);

    // The other drives away, and is caught up with.
    for _ in 0..40 {
        crowd.step(&[(0.0, 0.0), (0.2, 0.0)]);
    }
    for _ in 0..100 {
        crowd.step(&[(0.2, 0.0), (0.0, 0.0)]);
    }
    assert_eq!([0, 1].map(|robot| crowd.robots()[robot].collisions()), [2, 0]);
}

#[test]
fn two_robots_are_not_put_into_one_place() {
    assert!(crowd(&[[0.0, 0.0], [0.22, 0.0]]).is_ok());
    let overlap = crowd(&[[1.0, 1.0], [0.0, 0.0], [0.2, 0.0]]).err();
    assert_eq!(overlap, Some(Overlap { robots: [1, 2] }));
}

/// Drives 16 robots about at random; where they are at last, by their bits, and all collisions.
fn drive_about() -> (Vec<u64>, u64) {
    let places: Vec<_> = (0..16)
        .map(|robot| [f64::from(robot % 4) * 0.5 - 0.75, f64::from(robot / 4) * 0.5 - 0.75])
        .collect();
    let mut crowd = crowd(&places).expect("they have room");
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut commands = vec![(0.0, 0.0); places.len()];
    for step in 0..5_000 {
        for command in &mut commands {
            if random.next_u32().is_multiple_of(40) {
                let [linear, angular] =
                    [0; 2].map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX) - 0.5);
                *command = (0.3 * linear, 1.5 * angular);
            }
        }
        crowd.step(&commands);
        let places: Vec<_> =
            crowd.robots().iter().map(|robot| robot.world_from_base().translation.vector).collect();
        for (number, place) in places.iter().enumerate() {
            for other in &places[..number] {
                let gap = (place - other).norm() - 0.21;
                assert!(-1e-8 < gap, "SEED={SEED}, step {step}: {gap} m apart");
            }
        }
    }
    let bits = |robot: &Simulator| {
        let place = robot.world_from_base();
        [place.translation.x, place.translation.y, place.rotation.angle()].map(f64::to_bits)
    };
    let robots = crowd.robots();
    let collisions = robots.iter().map(Simulator::collisions).sum();
    (robots.iter().flat_map(bits).collect(), collisions)
}

#[test]
fn no_two_robots_are_ever_in_one_place_and_the_same_seed_gives_the_same_bits() {
    let (bits, collisions) = drive_about();
    assert!(collisions > 100, "SEED={SEED}: {collisions} collisions");
    assert_eq!(drive_about(), (bits, collisions), "SEED={SEED}");
}

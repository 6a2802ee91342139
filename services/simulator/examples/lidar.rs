//! What a scan costs, by the raster and by parry in the same run: `cargo run --release -p simulator
//! --example lidar`.

#![forbid(unsafe_code)]
#![expect(clippy::print_stdout, reason = "a table for people")]

use std::hint::black_box;
use std::time::Duration;

use nalgebra::{Isometry2, Vector2};
use node::clock;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use simulator::{Scanner, World, maze};

/// [-] Places in each world, one scan after another.
const PLACES: usize = 64;

/// [-] Best and median are of so many turns through all places, the two ways in alternation.
const ROUNDS: usize = 31;

/// [m]
const RANGES: [f64; 2] = [3.5, 8.0];

fn main() {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!("load {}", load.trim());
    println!("µs a scan                 range    raster           parry       parry / raster");
    println!("world       walls  beams      m   best  median   best  median   best  median");
    let lab02 = include_str!("../../../config/worlds/lab02.toml");
    let lab02: World = toml::from_str(lab02).expect("lab02 is a world");
    let centres: Vec<[f64; 2]> =
        lab02.starts.values().flat_map(|start| start.corridor_m.clone()).collect();
    for beams in [60, 240, 360, 480, 1440] {
        let places = |random: &mut ChaCha8Rng| {
            let [x, y] = centres[random.next_u32() as usize % centres.len()];
            [x + spread(random, 0.06), y + spread(random, 0.06)]
        };
        compare("lab02", &lab02, beams, 8.0, places);
    }
    for side in [2, 5, 10, 31, 99, 315] {
        let world = maze(side, 1);
        for range_max in RANGES {
            let place = |random: &mut ChaCha8Rng| {
                [0; 2]
                    .map(|_| (random.next_u32() as usize % side) as f64 + 0.5 + spread(random, 0.3))
            };
            compare("maze", &world, 240, range_max, place);
        }
    }
}

/// In `-width..width`.
fn spread(random: &mut ChaCha8Rng, width: f64) -> f64 {
    width * (f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0)
}

/// Prints one line of the table.
fn compare(
    name: &str,
    world: &World,
    beams: usize,
    range_max: f64,
    place: impl Fn(&mut ChaCha8Rng) -> [f64; 2],
) {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let places: Vec<_> = (0..PLACES)
        .map(|_| {
            let [x, y] = place(&mut random);
            Isometry2::new(Vector2::new(x, y), spread(&mut random, 3.0))
        })
        .collect();
    let mut scanner = Scanner::new(world, beams, range_max);
    let (mut single, mut double) = (vec![0.0; beams], vec![0.0; beams]);
    let [mut raster, mut parry] = [Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        raster.push(time(20, &places, |place| {
            scanner.cast(place, black_box(&mut single));
        }));
        parry.push(time(1, &places, |place| scanner.cast_by_parry(place, black_box(&mut double))));
    }
    raster.sort();
    parry.sort();
    let walls = world.segments.len() + 4 * world.blocks.len();
    let each = |times: &[Duration], at: usize| times[at].as_nanos() as f64 / PLACES as f64 / 1e3;
    let [best, median] = [0, ROUNDS / 2].map(|at| (each(&raster, at), each(&parry, at)));
    println!(
        "{name:<6} {walls:>10} {beams:>6} {range_max:>6} {:>6.2} {:>7.2} {:>6.1} {:>7.1} {:>6.1} {:>7.1}",
        best.0,
        median.0,
        best.1,
        median.1,
        best.1 / best.0,
        median.1 / median.0
    );
}

/// One turn through all places.
fn time(turns: u32, places: &[Isometry2<f64>], mut scan: impl FnMut(&Isometry2<f64>)) -> Duration {
    let begun = clock::now();
    for _ in 0..turns {
        places.iter().for_each(&mut scan);
    }
    clock::now().since(begun) / turns
}

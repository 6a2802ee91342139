//! What a step of the simulator costs, part by part: `cargo run --release -p simulator --example step`.

#![forbid(unsafe_code)]
#![expect(clippy::print_stdout, reason = "a table for people")]

use std::hint::black_box;

use interfaces::{JointState, LaserScan};
use node::clock;
use simulator::{Config, Simulator, World};

/// [-] Steps of each round, which make some turns on a small circle.
const STEPS: u32 = 5_000;

/// [-] Best and median are of so many rounds.
const ROUNDS: usize = 31;

fn main() {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!("load {}", load.trim());
    let lab02 = include_str!("../../../config/worlds/lab02.toml");
    let lab02: World = toml::from_str(lab02).expect("lab02 is a world");
    let mut simulator =
        Simulator::new(&Config::default(), &lab02).expect("the robot fits its world");
    let (mut joints, mut scan) = (JointState::default(), LaserScan::default());

    println!("ns                   best  median");
    let mut rounds: [Vec<f64>; 4] = Default::default();
    for _ in 0..ROUNDS {
        rounds[0].push(time(|| simulator.step(black_box(0.04), black_box(1.0))));
        rounds[1].push(time(|| simulator.fill_joint_state(black_box(&mut joints))));
        rounds[2].push(time(|| simulator.sense(black_box(&mut scan))));
        rounds[3].push(time(|| {
            simulator.step(black_box(0.04), black_box(1.0));
            simulator.fill_joint_state(black_box(&mut joints));
            simulator.sense(black_box(&mut scan));
        }));
    }
    for (name, times) in ["drive and collide", "encoders", "scan", "all"].iter().zip(&mut rounds) {
        times.sort_by(f64::total_cmp);
        println!("{name:<18} {:>6.0} {:>7.0}", times[0], times[ROUNDS / 2]);
    }
}

/// [ns] Of one call.
fn time(mut call: impl FnMut()) -> f64 {
    let begun = clock::now();
    for _ in 0..STEPS {
        call();
    }
    clock::now().since(begun).as_nanos() as f64 / f64::from(STEPS)
}

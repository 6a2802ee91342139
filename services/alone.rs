//! The lab's loop in one process and one thread, without any transport: what the algorithms alone take.

use std::fmt::Display;

use bench::{Course, Driven};
use controller::Controller;
use interfaces::{JointState, LaserScan, Odometry};
use node::launch::PairingParameters;
use node::pairing::{ODOMETRIES, SCANS, SensorPairing};
use node::{Error, Result, clock};
use odometry::WheelOdometry;
use simulator::{Block, Crowd, Simulator, World};

const LAB02: &str = include_str!("../config/worlds/lab02.toml");
const LAB_SIMULATION: &str = include_str!("../config/controller/lab_simulation.toml");

/// Drives `steps` periods of the lab's maze.
pub(crate) fn drive(steps: u64, course: &Course) -> Result<Driven> {
    let mut world: World = toml::from_str(LAB02).map_err(|cause| failed(&cause))?;
    add_walls(&mut world, course.more_walls);
    let starts = add_starts(&mut world, course.robots)?;
    let simulators = starts.into_iter().map(|start| {
        let mut config = simulator::Config { start, ..simulator::Config::default() };
        config.lidar.beams = course.beams;
        Simulator::new(&config, &world).map_err(|cause| failed(&cause))
    });
    let mut crowd =
        Crowd::new(simulators.collect::<Result<_>>()?).map_err(|cause| failed(&cause))?;
    let mut minds = (0..course.robots).map(|_| Mind::new()).collect::<Result<Vec<_>>>()?;
    let mut commands = vec![(0.0, 0.0); course.robots];
    let begun = clock::now();
    for sequence in 0..steps {
        crowd.step(&commands);
        let robots = crowd.robots().iter_mut().zip(&mut minds);
        for ((simulator, mind), command) in robots.zip(&mut commands) {
            *command = mind.decide(simulator, sequence)?;
        }
    }
    let took = clock::now().since(begun);
    Ok(Driven { distance: crowd.robots().iter().map(Simulator::distance).sum(), took })
}

/// Walls in a square field around the maze, which no beam reaches.
fn add_walls(world: &mut World, more_walls: usize) {
    let columns = more_walls.isqrt() + 1;
    world.blocks.extend((0..more_walls).map(|wall| Block {
        name: format!("more{wall}"),
        x_m: 4.0 + 0.5 * (wall % columns) as f64,
        y_m: 4.0 + 0.5 * (wall / columns) as f64,
        size_x_m: 0.4,
        size_y_m: 0.1,
        yaw_rad: 0.0,
    }));
}

/// A start for each robot, by name: by turns in the outer and in the inner corridor, each two cells
/// ahead of the one before.
fn add_starts(world: &mut World, robots: usize) -> Result<Vec<String>> {
    let corridors = ["outer", "inner"];
    let mut names = Vec::new();
    for robot in 0..robots {
        let corridor = world.start(corridors[robot % 2]).map_err(|cause| failed(&cause))?;
        let start = corridor.from_cell(robot / 2 * 2);
        let start = start.ok_or_else(|| failed(&"the maze has no room for so many robots"))?;
        names.push(format!("robot{robot}"));
        world.starts.insert(format!("robot{robot}"), start);
    }
    Ok(names)
}

/// All of a robot but its body.
struct Mind {
    wheels: WheelOdometry,
    pairing: SensorPairing,
    controller: Controller,
    scan: LaserScan,
    joint_state: JointState,
    odometry: Odometry,
}

impl Mind {
    fn new() -> Result<Self> {
        let profile: controller::Config =
            toml::from_str(LAB_SIMULATION).map_err(|cause| failed(&cause))?;
        let pairing = PairingParameters::default().config();
        Ok(Self {
            wheels: WheelOdometry::new(&odometry::Config::default()),
            pairing: SensorPairing::new(&pairing).map_err(|cause| failed(&cause))?,
            controller: Controller::new(&profile).map_err(|cause| failed(&cause))?,
            scan: LaserScan::default(),
            joint_state: JointState::default(),
            odometry: Odometry::default(),
        })
    }

    /// From what the sensors see to the next command.
    fn decide(&mut self, simulator: &mut Simulator, sequence: u64) -> Result<(f64, f64)> {
        let Self { wheels, pairing, controller, scan, joint_state, odometry } = self;
        simulator.fill_joint_state(joint_state);
        simulator.sense(scan);
        wheels.update(joint_state, odometry).map_err(|cause| failed(&cause))?;
        // What ports do, where there are some.
        for header in [&mut scan.header, &mut odometry.header] {
            (header.sequence, header.epoch) = (sequence, 1);
        }
        let mut pairs = pairing.push(SCANS, &scan.header, scan.header.stamp).pairs().count();
        pairs += pairing.push(ODOMETRIES, &odometry.header, odometry.header.stamp).pairs().count();
        if pairs != 1 {
            return Err(failed(&format!("{pairs} pairs of one scan")));
        }
        let command = controller.update(scan, odometry).map_err(|cause| failed(&cause))?;
        Ok((command.linear, command.angular))
    }
}

fn failed(cause: &dyn Display) -> Error {
    Error::Fault(format!("cannot drive: {cause}"))
}

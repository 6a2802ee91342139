//! The lab's loop in one process and one thread, without any transport: what the algorithms alone take.

use controller::Controller;
use interfaces::{JointState, LaserScan, Odometry};
use node::launch::PairingParameters;
use node::pairing::{ODOMETRIES, SCANS, SensorPairing};
use node::{Error, Result};
use odometry::WheelOdometry;
use simulator::{Simulator, World};

const LAB02: &str = include_str!("../config/worlds/lab02.toml");
const LAB_SIMULATION: &str = include_str!("../config/controller/lab_simulation.toml");

/// Drives `steps` periods of the lab's maze with a LiDAR of so many `beams`. Returns how far, in m.
pub(crate) fn drive(steps: u64, beams: usize) -> Result<f64> {
    let failed = |cause: &dyn std::fmt::Display| Error::Fault(format!("cannot drive: {cause}"));
    let world: World = toml::from_str(LAB02).map_err(|cause| failed(&cause))?;
    let mut config = simulator::Config::default();
    config.lidar.beams = beams;
    let mut simulator = Simulator::new(&config, &world).map_err(|cause| failed(&cause))?;
    let profile: controller::Config =
        toml::from_str(LAB_SIMULATION).map_err(|cause| failed(&cause))?;
    let mut controller = Controller::new(&profile).map_err(|cause| failed(&cause))?;
    let pairing = PairingParameters::default().config();
    let mut pairing = SensorPairing::new(&pairing).map_err(|cause| failed(&cause))?;
    let mut wheels = WheelOdometry::new(&odometry::Config::default());
    let (mut scan, mut joint_state) = (LaserScan::default(), JointState::default());
    let mut odometry = Odometry::default();
    let (mut linear, mut angular) = (0.0, 0.0);
    for sequence in 0..steps {
        simulator.step(linear, angular);
        simulator.fill_joint_state(&mut joint_state);
        simulator.sense(&mut scan);
        wheels.update(&joint_state, &mut odometry).map_err(|cause| failed(&cause))?;
        // What ports do, where there are some.
        for header in [&mut scan.header, &mut odometry.header] {
            (header.sequence, header.epoch) = (sequence, 1);
        }
        let mut pairs = pairing.push(SCANS, &scan.header, scan.header.stamp).pairs().count();
        pairs += pairing.push(ODOMETRIES, &odometry.header, odometry.header.stamp).pairs().count();
        if pairs != 1 {
            return Err(failed(&format!("{pairs} pairs of one scan")));
        }
        let command = controller.update(&scan, &odometry).map_err(|cause| failed(&cause))?;
        (linear, angular) = (command.linear, command.angular);
    }
    Ok(simulator.distance())
}

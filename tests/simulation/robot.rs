//! The whole robot in one thread: its pure cores, joined by faulty links, step by step.

use std::time::Duration;

use interfaces::{JointState, LaserScan, MotionState, Permission, Stamp};
use node::deadman::DeadMan;
use simulator::{Simulator, World};

use super::LAB02;
use super::plan::{Plan, What, Whom};
use super::processes::{ControllerProcess, OdometryProcess, PairingProcess, Process, Sender};
use super::referee::{Referee, STEP};

/// [-] Drive steps between two measurements.
const SUBSTEPS: u32 = 5;

pub(super) struct Robot {
    pub(super) now: Stamp,
    pub(super) simulator: Simulator,
    pub(super) referee: Referee,
    plan: Plan,
    steps: u32,
    blows_struck: usize,
    dead_man: DeadMan,
    /// What the wheels have told last.
    state: MotionState,
    told: u64,
    /// Since when a person is needed.
    needed: Option<Stamp>,
    joint_states: Sender<JointState>,
    scans: Sender<LaserScan>,
    odometry: Process<OdometryProcess>,
    pairing: Process<PairingProcess>,
    controller: Process<ControllerProcess>,
    /// A former life of the controller that nobody has killed, and when somebody does.
    ghost: Option<(Process<ControllerProcess>, Stamp)>,
}

impl Robot {
    pub(super) fn new(plan: &Plan) -> Self {
        let now = super::plan::START;
        let world: World = toml::from_str(LAB02).unwrap();
        let mut config = simulator::Config {
            start: plan.start.into(),
            seed: plan.seed,
            substeps: SUBSTEPS,
            ..simulator::Config::default()
        };
        config.lidar.noise = plan.noise;
        config.lidar.beams = plan.beams;
        Self {
            now,
            simulator: Simulator::new(&config, &world).unwrap(),
            referee: Referee::new(plan.seed),
            plan: plan.clone(),
            steps: 0,
            blows_struck: 0,
            dead_man: DeadMan::new(&config.deadman),
            state: MotionState::default(),
            told: 0,
            needed: None,
            joint_states: Sender::new(plan, &plan.links.joint_states, 1, 1, now),
            scans: Sender::new(plan, &plan.links.scans, 2, 1, now),
            odometry: Process::new(OdometryProcess::new(plan, 1, now)),
            pairing: Process::new(PairingProcess::new(plan, 1, now)),
            controller: Process::new(ControllerProcess::new(plan, 1, now)),
            ghost: None,
        }
    }

    /// One drive step, and everything that goes with it.
    pub(super) fn step(&mut self) {
        self.now = self.now.after(STEP);
        self.strike();
        self.attend_to_people();
        self.drive();
        self.measure();
        self.think();
    }

    /// Strikes the processes that are due to be struck, and begins the lives that are due.
    fn strike(&mut self) {
        let (now, plan) = (self.now, &self.plan);
        while let Some(blow) = plan.blows.get(self.blows_struck).filter(|blow| blow.at <= now) {
            self.blows_struck += 1;
            match (blow.whom, blow.what) {
                (Whom::Odometry, What::Killed(away)) => self.odometry.kill(now, away),
                (Whom::Pairing, What::Killed(away)) => self.pairing.kill(now, away),
                (Whom::Controller, What::Killed(away)) => self.controller.kill(now, away),
                (Whom::Odometry, What::Stopped(still) | What::Doubled(still)) => {
                    self.odometry.stop(now, still);
                }
                (Whom::Pairing, What::Stopped(still) | What::Doubled(still)) => {
                    self.pairing.stop(now, still);
                }
                (Whom::Controller, What::Stopped(still)) => self.controller.stop(now, still),
                (Whom::Controller, What::Doubled(still)) => {
                    let epoch = self.controller.epoch + 1;
                    let mut next = Process::new(ControllerProcess::new(plan, epoch, now));
                    next.epoch = epoch;
                    let mut ghost = std::mem::replace(&mut self.controller, next);
                    ghost.stop(now, still);
                    self.ghost = Some((ghost, now.after(2 * still).min(plan.cease)));
                }
            }
        }
        self.odometry.revive(now, |epoch| OdometryProcess::new(plan, epoch, now));
        self.pairing.revive(now, |epoch| PairingProcess::new(plan, epoch, now));
        self.controller.revive(now, |epoch| ControllerProcess::new(plan, epoch, now));
        self.ghost.take_if(|(ghost, end)| ghost.alive.is_none() || *end <= now);
    }

    /// Somebody latches and releases the emergency stop, or arms a robot that cannot do it itself.
    fn attend_to_people(&mut self) {
        let now = self.now;
        self.referee.look(now);
        let is_latched = self.plan.is_latched(now);
        self.dead_man.set_emergency_stop(now, is_latched);
        self.referee.sees_latch(now, is_latched);
        if self.state.needs_person == 0 {
            self.needed = None;
        } else if self.plan.patience <= now.since(*self.needed.get_or_insert(now)) {
            self.needed = None;
            self.dead_man.arm(now);
            self.referee.sees_arm(now);
        }
        self.tell();
    }

    /// The wheels hear what has come, and turn.
    fn drive(&mut self) {
        let now = self.now;
        let ghost = self.ghost.as_mut().and_then(|(ghost, _)| ghost.turning(now));
        for controller in ghost.into_iter().chain(self.controller.turning(now)) {
            while let Some(command) = controller.out.pop(now) {
                let before = self.dead_man.motion(now);
                // Who is refused and why is the referee's to know.
                let _ = self.dead_man.hear(now, &command);
                let after = self.dead_man.motion(now);
                self.referee.sees_received(now, &command, before, after);
            }
        }
        let motion = self.dead_man.motion(now);
        self.tell();

        let world_from_before = self.simulator.world_from_base();
        self.simulator.step(motion.linear, motion.angular);
        let before_from_base = world_from_before.inv_mul(&self.simulator.world_from_base());
        let moved = [before_from_base.translation.vector.norm(), before_from_base.rotation.angle()];
        self.referee.judge(now, motion, moved);
        if self.plan.is_honest && !self.referee.has_begun_anew {
            let is_free = self.simulator.collisions() == 0;
            self.referee.hold(is_free, now, "touches a wall", &self.simulator.progress().path());
        }
    }

    /// Every few steps wheels and LiDAR are read; what is under way comes on every step.
    fn measure(&mut self) {
        let now = self.now;
        self.steps += 1;
        if self.steps.is_multiple_of(SUBSTEPS) {
            let mut joint_state = JointState::default();
            self.simulator.fill_joint_state(&mut joint_state);
            joint_state.header.stamp = now;
            self.joint_states.send(now, joint_state);
            let mut scan = LaserScan::default();
            self.simulator.sense(&mut scan);
            scan.header.stamp = now;
            self.scans.send(now, scan);
        }
        while let Some(joint_state) = self.joint_states.pop(now) {
            if let Some(odometry) = &mut self.odometry.alive {
                odometry.joint_states.push(&joint_state);
            }
        }
        while let Some(scan) = self.scans.pop(now) {
            for controller in controllers(&mut self.ghost, &mut self.controller) {
                controller.scans.push(&scan);
            }
            if let Some(pairing) = &mut self.pairing.alive {
                pairing.scans.push(&scan);
            }
        }
    }

    /// Odometry, pairing and controller have their turn, each where it turns at all.
    fn think(&mut self) {
        let now = self.now;
        if let Some(odometry) = self.odometry.turning(now) {
            odometry.turn(now);
            while let Some(sample) = odometry.out.pop(now) {
                for controller in controllers(&mut self.ghost, &mut self.controller) {
                    controller.odometry.push(&sample);
                }
                if let Some(pairing) = &mut self.pairing.alive {
                    pairing.odometry.push(&sample);
                }
            }
        }
        if let Some(pairing) = self.pairing.turning(now) {
            pairing.turn(now);
            while let Some(ticket) = pairing.out.pop(now) {
                for controller in controllers(&mut self.ghost, &mut self.controller) {
                    controller.tickets.push(&ticket);
                }
            }
        }
        let is_armed = self.state.permission == Permission::Armed as u8;
        let ghost = self.ghost.as_mut().and_then(|(ghost, _)| ghost.turning(now));
        for controller in ghost.into_iter().chain(self.controller.turning(now)) {
            controller.turn(now, is_armed, &mut self.referee);
        }
    }

    /// Others learn of the wheels what the wheels find worth telling, and nothing else.
    fn tell(&mut self) {
        let changes = self.dead_man.changes();
        if changes != self.told {
            self.told = changes;
            self.dead_man.describe(self.now, &mut self.state);
        }
    }

    /// How long the robot has been at it.
    pub(super) fn elapsed(&self) -> Duration {
        self.now.since(super::plan::START)
    }
}

/// Everybody who reads what a controller reads.
fn controllers<'a>(
    ghost: &'a mut Option<(Process<ControllerProcess>, Stamp)>,
    controller: &'a mut Process<ControllerProcess>,
) -> impl Iterator<Item = &'a mut ControllerProcess> {
    let ghost = ghost.as_mut().and_then(|(ghost, _)| ghost.alive.as_mut());
    ghost.into_iter().chain(controller.alive.as_mut())
}

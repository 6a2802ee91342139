//! Lock-step: how many steps four processes make in a second, and how that grows with the world.

use interfaces::BEAMS_MAX;
use node::{Error, Namespace, Result, Wait, clock};

use crate::hop::Place;
use crate::measured::{Unit, Values};
use crate::robot::Robot;
use crate::{Drive, Effort};

/// Robots in one world each, all at once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lockstep {
    robot: Robot,
    robots: usize,
}

/// [-] Of the lab's LiDAR.
const BEAMS: usize = 240;

/// [-] Of others as well, up to as many as fit.
const ROW_OF_BEAMS: [usize; 5] = [60, BEAMS, 480, 960, BEAMS_MAX];

/// [s] Simulated: long enough that the start does not show.
const LENGTH_S: f64 = 1500.0;

/// [s] The same, for a quick look.
const QUICK_S: f64 = 20.0;

/// Ways to wait and places; then more beams, more walls and more robots, the usual way.
pub(crate) fn configurations() -> Vec<Lockstep> {
    let robot = Robot {
        wait: Wait::Yield,
        place: Place::One,
        rate: None,
        length_s: LENGTH_S,
        beams: BEAMS,
        more_walls: 0,
    };
    let with = |robot| Lockstep { robot, robots: 1 };
    let settings = [
        (Wait::Yield, Place::One),
        (Wait::Yield, Place::Across),
        (Wait::Block, Place::One),
        (Wait::Block, Place::Across),
        (Wait::Hybrid, Place::Across),
    ];
    let mut all: Vec<_> = settings.map(|(wait, place)| with(Robot { wait, place, ..robot })).into();
    let usual = Robot { place: Place::Across, ..robot };
    let others = ROW_OF_BEAMS.into_iter().filter(|&beams| beams != BEAMS);
    all.extend(others.map(|beams| with(Robot { beams, ..usual })));
    all.extend([1_000, 10_000].map(|more_walls| with(Robot { more_walls, ..usual })));
    all.extend([2, 4].map(|robots| Lockstep { robot: usual, robots }));
    all
}

impl Lockstep {
    /// What it yields, in the order of [`Lockstep::measure`].
    pub(crate) fn names(&self) -> [(String, Unit); 2] {
        let mut what = format!("{}, {} beams", self.robot.setting(), self.robot.beams);
        if 0 < self.robot.more_walls {
            what = format!("{what}, {} more walls", self.robot.more_walls);
        }
        if 1 < self.robots {
            what = format!("{what}, {} robots", self.robots);
        }
        [
            (format!("steps a second, {what}"), Unit::PerSecond),
            (format!("times real time, {what}"), Unit::TimesRealTime),
        ]
    }

    /// One round.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        let mut robot = self.robot;
        if effort == Effort::Quick {
            robot.length_s = QUICK_S;
        }
        let running = (0..self.robots).map(|number| robot.start(namespace, number));
        let running = running.collect::<Result<Vec<_>>>()?;
        let (mut steps, mut factor) = (0.0, 0.0);
        for running in running {
            let report = running.finish()?.report;
            let figure = |value: &serde_json::Value| {
                value.as_f64().ok_or_else(|| Error::Fault("a report lacks a figure".to_owned()))
            };
            steps += figure(&report["nodes"]["simulator"]["steps"])? / figure(&report["wall_s"])?;
            factor += figure(&report["real_time_factor"])?;
        }
        Ok(vec![Values::One(steps), Values::One(factor)])
    }
}

/// The same loop in one process, without any transport.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alone {
    drive: Drive,
    beams: usize,
}

/// [-] Steps of one round.
const STEPS: u64 = 20_000;

/// [-] The same, for a quick look.
const STEPS_QUICK: u64 = 500;

/// By how many beams the LiDAR has.
pub(crate) fn alone(drive: Drive) -> [Alone; 5] {
    ROW_OF_BEAMS.map(|beams| Alone { drive, beams })
}

impl Alone {
    pub(crate) fn name(&self) -> String {
        format!("steps a second, one process, {} beams", self.beams)
    }

    pub(crate) fn measure(&self, effort: Effort) -> Result<Values> {
        let steps = match effort {
            Effort::Whole => STEPS,
            Effort::Quick => STEPS_QUICK,
        };
        let begun = clock::now();
        let distance = (self.drive)(steps, self.beams)?;
        let took = clock::now().since(begun).as_secs_f64();
        if distance <= 0.0 {
            return Err(Error::Fault("the robot did not move".to_owned()));
        }
        Ok(Values::One(steps as f64 / took))
    }
}

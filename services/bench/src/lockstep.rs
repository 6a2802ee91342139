//! Lock-step: how many steps four processes make in a second, and how that grows with the world.

use std::fmt::Write;

use interfaces::BEAMS_MAX;
use node::{Error, Namespace, Result, Wait};

use crate::measured::{Unit, Values};
use crate::robot::{Cores, Robot};
use crate::{Course, Drive, Driven, Effort};

/// Robots in a world each, all at once: a process is in one namespace, and a robot has one of its own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lockstep {
    robot: Robot,
    robots: usize,
}

/// [-] Of the lab's LiDAR.
const BEAMS: usize = 240;

/// [-] Of others as well, up to as many as fit.
const ROW_OF_BEAMS: [usize; 5] = [60, BEAMS, 480, 960, BEAMS_MAX];

/// [-] More walls than the maze has.
const ROW_OF_WALLS: [usize; 3] = [1_000, 10_000, 100_000];

/// [-] More robots than one.
const ROW_OF_ROBOTS: [usize; 4] = [2, 4, 8, 16];

/// [s] Simulated: long enough that the start does not show.
const LENGTH_S: f64 = 6000.0;

/// [s] The same, for a quick look.
const QUICK_S: f64 = 20.0;

/// Ways to wait and places; then more beams, more walls and more robots, the usual way.
pub(crate) fn configurations() -> Vec<Lockstep> {
    let robot = Robot {
        wait: Wait::Yield,
        cores: Cores::One,
        rate: None,
        length_s: LENGTH_S,
        beams: BEAMS,
        more_walls: 0,
    };
    let with = |robot| Lockstep { robot, robots: 1 };
    let settings = [
        (Wait::Yield, Cores::One),
        (Wait::Yield, Cores::Any),
        (Wait::Yield, Cores::Two),
        (Wait::Block, Cores::One),
        (Wait::Block, Cores::Any),
        (Wait::Hybrid, Cores::Any),
    ];
    let mut all: Vec<_> = settings.map(|(wait, cores)| with(Robot { wait, cores, ..robot })).into();
    let usual = Robot { cores: Cores::Any, ..robot };
    let others = ROW_OF_BEAMS.into_iter().filter(|&beams| beams != BEAMS);
    all.extend(others.map(|beams| with(Robot { beams, ..usual })));
    all.extend(ROW_OF_WALLS.map(|more_walls| with(Robot { more_walls, ..usual })));
    all.extend(ROW_OF_ROBOTS.map(|robots| Lockstep { robot: usual, robots }));
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
            what = format!("{what}, {} robots, a world each", self.robots);
        }
        [
            (format!("steps a second, {what}"), Unit::PerSecond),
            (format!("times real time, {what}"), Unit::TimesRealTime),
        ]
    }

    /// One round.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        let mut robot = self.robot;
        match effort {
            // Each of several takes longer for a step, but they also take longer to start, and shall
            // run at the same time.
            Effort::Whole => robot.length_s /= (self.robots as f64).sqrt(),
            Effort::Quick => robot.length_s = QUICK_S,
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
    course: Course,
}

/// [-] Steps of one round.
const STEPS: u64 = 20_000;

/// [-] The same, for a quick look.
const STEPS_QUICK: u64 = 500;

/// By beams, by walls and by robots, which are in one world here.
pub(crate) fn alone(drive: Drive) -> Vec<Alone> {
    let usual = Course { beams: BEAMS, more_walls: 0, robots: 1 };
    let mut all: Vec<_> = ROW_OF_BEAMS.map(|beams| Course { beams, ..usual }).into();
    all.extend(ROW_OF_WALLS.map(|more_walls| Course { more_walls, ..usual }));
    all.extend(ROW_OF_ROBOTS.map(|robots| Course { robots, ..usual }));
    all.into_iter().map(|course| Alone { drive, course }).collect()
}

impl Alone {
    pub(crate) fn name(&self) -> String {
        let Course { beams, more_walls, robots } = self.course;
        let mut name = format!("steps a second, one process, {beams} beams");
        if 0 < more_walls {
            let _ = write!(name, ", {more_walls} more walls");
        }
        if 1 < robots {
            let _ = write!(name, ", {robots} robots in one world");
        }
        name
    }

    pub(crate) fn measure(&self, effort: Effort) -> Result<Values> {
        let steps = match effort {
            Effort::Whole => STEPS,
            Effort::Quick => STEPS_QUICK,
        };
        let Driven { distance, took } = (self.drive)(steps, &self.course)?;
        if distance <= 0.0 {
            return Err(Error::Fault("the robot did not move".to_owned()));
        }
        Ok(Values::One(steps as f64 * self.course.robots as f64 / took.as_secs_f64()))
    }
}

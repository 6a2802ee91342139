//! The whole loop in real time: from light to wheel, through every process of a robot.

use node::{Error, Namespace, Result, Wait};
use serde_json::Value;

use crate::Effort;
use crate::measured::Values;
use crate::robot::{Cores, Robot};

/// [Hz] The lab's, a fast LiDAR's, and as fast as anybody drives.
const RATES: [u32; 3] = [20, 100, 1000];

/// One robot at one rate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain {
    robot: Robot,
    rate: u32,
}

/// Every rate, way to wait and place.
pub(crate) fn configurations() -> Vec<Chain> {
    let settings = [
        (Wait::Block, Cores::Any),
        (Wait::Block, Cores::One),
        (Wait::Hybrid, Cores::Any),
        (Wait::Yield, Cores::Any),
        (Wait::Yield, Cores::One),
        (Wait::Yield, Cores::Two),
        (Wait::Poll, Cores::Any),
    ];
    let chains = RATES.map(|rate| {
        settings.map(|(wait, cores)| {
            let robot =
                Robot { wait, cores, rate: Some(rate), length_s: 2.0, beams: 240, more_walls: 0 };
            Chain { robot, rate }
        })
    });
    chains.into_iter().flatten().collect()
}

/// What is told of a chain: a name, the node whose figure it is, and the figure.
const FIGURES: [(&str, &str, &str); 5] = [
    ("scan to wheel", "simulator", "scan_to_command"),
    ("scan to odometry sent", "odometry", "age"),
    ("scan to pair sent", "pairing", "age"),
    ("scan to command sent", "controller", "age"),
    ("the simulator's period late by", "simulator", "late"),
];

/// [s] How long a quick look drives.
const QUICK_S: f64 = 0.5;

impl Chain {
    /// What it yields, in the order of [`Chain::measure`].
    pub(crate) fn names(&self) -> Vec<String> {
        let setting = self.robot.setting();
        FIGURES.iter().map(|(what, ..)| format!("{what}, {setting}, {} Hz", self.rate)).collect()
    }

    /// One round: a drive of some seconds.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        let mut robot = self.robot;
        if effort == Effort::Quick {
            robot.length_s = QUICK_S;
        }
        let ran = robot.start(namespace, 0)?.finish()?;
        let commands = ran.report["commands"].as_u64().unwrap_or_default();
        let values = FIGURES.iter().map(|(_, node, figure)| {
            summed(&ran.report, node, figure, commands)
                .ok_or_else(|| Error::Fault(format!("{node} does not tell its {figure}")))
        });
        values.collect()
    }
}

/// A duration as the nodes tell theirs: they have counted every one, of which there are `count`.
pub(crate) fn summed(report: &Value, node: &str, figure: &str, count: u64) -> Option<Values> {
    let figures = &report["nodes"][node];
    let us = |which: &str| figures[format!("{figure}_{which}_us")].as_f64();
    let [p50, p99, max] = [us("p50")?, us("p99")?, us("max")?].map(|value| value * 1e3);
    Some(Values::Summed(count, [p50, p99, max]))
}

//! The cells of the matrix: which robot, what happens to whom, and when.

use std::fmt::{self, Display, Formatter};
use std::time::Duration;

use interfaces::JointState;

use crate::robot::{Process, Run};
use crate::witness::WHEEL_RADIUS;

/// [m] Between a TurtleBot3 Burger's wheels.
const TRACK: f64 = 0.16;

/// Who has the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Body {
    /// The simulator.
    Simulated,
    /// The bridge, and an emulated TurtleBot3 before it.
    Emulated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Fault {
    Kill,
    Stop,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Victim {
    Guardian,
    Supervisor,
    GuardianAndSupervisor,
    Odometry,
    Controller,
    /// The simulator or the bridge.
    Drive,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Phase {
    StartUp,
    Configuring,
    Straight,
    Turning,
    Stopping,
}

/// What happens to whom, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Cell {
    pub(super) body: Body,
    pub(super) fault: Fault,
    pub(super) victim: Victim,
    pub(super) phase: Phase,
}

impl Cell {
    pub(super) fn all(body: Body) -> Vec<Self> {
        let mut cells = Vec::new();
        for fault in [Fault::Kill, Fault::Stop] {
            for victim in Victim::ALL {
                for phase in Phase::ALL {
                    cells.push(Self { body, fault, victim, phase });
                }
            }
        }
        // Stopped together, nobody would be there to wake them.
        let both = |cell: &Self| cell.victim == Victim::GuardianAndSupervisor;
        cells.retain(|cell| !(both(cell) && cell.fault == Fault::Stop));
        cells
    }

    /// Whether the wheels have not turned yet.
    pub(super) fn is_at_rest(self) -> bool {
        matches!(self.phase, Phase::StartUp | Phase::Configuring)
    }

    /// Whether nobody is left who could look after the robot.
    pub(super) fn ends_the_run(self) -> bool {
        self.fault == Fault::Kill && self.victim.looks_after_others()
    }

    /// Whether nobody but a person, or systemd, ends what hangs.
    pub(super) fn needs_hands(self) -> bool {
        self.fault == Fault::Stop && self.victim.looks_after_others()
    }

    /// Whether the node can be back before the wheels miss it: one that was killed; and an odometry
    /// that hangs, where a scan may be half a second old anyway because the LiDAR turns so slowly.
    pub(super) fn may_move_on(self) -> bool {
        let is_slow = self.body == Body::Emulated && self.victim == Victim::Odometry;
        !self.ends_the_run() && (self.fault == Fault::Kill || is_slow)
    }

    /// Whether a process that lives has wheels to stop: the simulator's are gone with it, the bridge's
    /// are left to the robot's firmware.
    pub(super) fn has_wheels_left(self) -> bool {
        self.victim != Victim::Drive
    }

    /// Whether wheels that turn are stopped, and by a process that lives.
    pub(super) fn stops_the_wheels(self) -> bool {
        let is_idle = self.needs_hands() && self.victim == Victim::Guardian;
        self.has_wheels_left() && (!is_idle || self.phase == Phase::Stopping)
    }

    /// The victim's processes; none where it has not been started yet.
    pub(super) fn processes(self, run: &Run<'_>) -> Vec<Process> {
        let guardian = run.process();
        let supervisors = guardian.children();
        match self.victim {
            Victim::Guardian => vec![guardian],
            Victim::Supervisor => supervisors,
            Victim::GuardianAndSupervisor if supervisors.is_empty() => supervisors,
            Victim::GuardianAndSupervisor => [vec![guardian], supervisors].concat(),
            Victim::Odometry | Victim::Controller | Victim::Drive => {
                let name = format!("--name={}", self.victim_label());
                let nodes = supervisors.into_iter().flat_map(Process::children);
                nodes.filter(|node| node.command().contains(&name)).collect()
            }
        }
    }

    /// What happens, to whom and when, as the table calls it.
    pub(super) fn labels(self) -> [&'static str; 3] {
        [self.fault.label(), self.victim_label(), self.phase.label()]
    }

    /// A node by its name in the launch file.
    fn victim_label(self) -> &'static str {
        match self.victim {
            Victim::Guardian => "guardian",
            Victim::Supervisor => "supervisor",
            Victim::GuardianAndSupervisor => "guardian and supervisor",
            Victim::Odometry => "odometry",
            Victim::Controller => "controller",
            Victim::Drive => self.body.drive(),
        }
    }

    /// Whether a start has come to this cell's phase.
    pub(super) fn has_begun(self, run: &Run<'_>) -> bool {
        if self.phase == Phase::StartUp {
            return !self.processes(run).is_empty();
        }
        let former = match self.victim {
            Victim::Guardian
            | Victim::Supervisor
            | Victim::GuardianAndSupervisor
            | Victim::Drive => "pairing",
            Victim::Odometry => self.body.drive(),
            Victim::Controller => "odometry",
        };
        run.output()
            .lines()
            .any(|line| line.contains(former) && line.ends_with("unconfigured -> inactive"))
    }
}

impl Display for Cell {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.labels().join(" "))
    }
}

impl Body {
    /// Its node in the launch file.
    pub(super) fn drive(self) -> &'static str {
        match self {
            Self::Simulated => "simulator",
            Self::Emulated => "turtlebot3",
        }
    }
}

impl Fault {
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Kill => "SIGKILL",
            Self::Stop => "SIGSTOP",
        }
    }
}

impl Victim {
    pub(super) const ALL: [Self; 6] = [
        Self::Controller,
        Self::Odometry,
        Self::Drive,
        Self::Supervisor,
        Self::Guardian,
        Self::GuardianAndSupervisor,
    ];

    pub(super) fn looks_after_others(self) -> bool {
        matches!(self, Self::Guardian | Self::Supervisor | Self::GuardianAndSupervisor)
    }
}

impl Phase {
    pub(super) const ALL: [Self; 5] =
        [Self::StartUp, Self::Configuring, Self::Straight, Self::Turning, Self::Stopping];

    pub(super) fn label(self) -> &'static str {
        match self {
            Self::StartUp => "starting up",
            Self::Configuring => "configuring",
            Self::Straight => "straight",
            Self::Turning => "turning",
            Self::Stopping => "stopping",
        }
    }

    /// The fault strikes at some moment within this.
    pub(super) fn length(self) -> Duration {
        Duration::from_millis(match self {
            Self::StartUp => 40,
            Self::Configuring => 20,
            // Two periods of the controller.
            Self::Straight | Self::Turning => 100,
            // The way to rest, and the end of the processes.
            Self::Stopping => 200,
        })
    }

    /// Whether wheels that do so are those of a robot in this phase, or just before it.
    pub(super) fn is_shown_by(self, wheels: &JointState) -> bool {
        let [left, right] = wheels.velocity;
        let turning_speed = (right - left) * WHEEL_RADIUS / TRACK;
        match self {
            Self::StartUp | Self::Configuring => false,
            Self::Turning => 0.2 < turning_speed.abs(),
            Self::Straight | Self::Stopping => 3.0 < left.min(right) && turning_speed.abs() < 0.2,
        }
    }
}

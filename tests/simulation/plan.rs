//! What goes wrong in one run, all of it drawn from its seed.

use std::time::Duration;

use controller::Pacing;
use interfaces::Stamp;
use node::faults::Faults;
use simulator::Noise;

use crate::random::Random;

/// When a run begins: far enough from the clock's own start for stamps to lie before it.
pub(super) const START: Stamp = Stamp::from_nanoseconds(3_600_000_000_000);

/// [-] As few as a follower makes do with: most of a run's time is the LiDAR's.
pub(super) const BEAMS: usize = 60;

/// One run's faults, and what surrounds them.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) seed: u64,
    pub(super) start: &'static str,
    pub(super) noise: Noise,
    /// [-] Of the LiDAR.
    pub(super) beams: usize,
    pub(super) pacing: Pacing,
    /// Whether no sample ever says what is not so. What is lost or late is no lie.
    pub(super) is_honest: bool,
    /// When all faults are over.
    pub(super) cease: Stamp,
    pub(super) links: Links,
    /// In the order of their times.
    pub(super) blows: Vec<Blow>,
    /// From when to when the emergency stop is latched.
    pub(super) latches: Vec<(Stamp, Stamp)>,
    /// How long it takes until somebody arms a robot that needs a person.
    pub(super) patience: Duration,
}

/// The faults of each topic.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Links {
    pub(super) joint_states: Faults,
    pub(super) scans: Faults,
    pub(super) odometry: Faults,
    pub(super) tickets: Faults,
    pub(super) commands: Faults,
}

/// What happens to one process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blow {
    pub(super) at: Stamp,
    pub(super) whom: Whom,
    pub(super) what: What,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Whom {
    Odometry,
    Pairing,
    Controller,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum What {
    /// It dies, and its next life begins after so long.
    Killed(Duration),
    /// It stands still for so long, and goes on where it was.
    Stopped(Duration),
    /// It stands still, a new life takes its place at once, and after so long the old one goes on
    /// beside it for as long again: nobody has killed it.
    Doubled(Duration),
}

impl Plan {
    /// A run in which nothing goes wrong.
    pub(super) fn faultless(seed: u64) -> Self {
        Self {
            seed,
            start: "outer",
            noise: Noise::Ideal,
            beams: BEAMS,
            pacing: Pacing::EveryPair,
            is_honest: true,
            cease: START,
            links: Links::default(),
            blows: Vec::new(),
            latches: Vec::new(),
            patience: Duration::ZERO,
        }
    }

    /// Of eight runs, one meets no faults, four meet faults that are no lies, and three any.
    pub(super) fn draw(seed: u64) -> Self {
        let random = &mut Random(seed);
        let severity = random.one_of(&[0, 1, 1, 1, 1, 2, 2, 2]);
        let mut plan = Self {
            start: random.one_of(&["outer", "inner"]),
            noise: random.one_of(&[Noise::Ideal, Noise::Gazebo, Noise::Lds01]),
            pacing: random.one_of(&[Pacing::EveryPair, Pacing::Timer]),
            is_honest: severity < 2,
            patience: Duration::from_secs(1) + random.duration(Duration::from_secs(4)),
            ..Self::faultless(seed)
        };
        if severity == 0 {
            return plan;
        }
        let lasting = Duration::from_secs(10) + random.duration(Duration::from_secs(50));
        plan.cease = START.after(lasting);
        let is_honest = plan.is_honest;
        let mut faults = || if random.happens(0.6) { draw_faults(random, is_honest) } else { NONE };
        plan.links = Links {
            joint_states: faults(),
            scans: faults(),
            odometry: faults(),
            tickets: faults(),
            commands: faults(),
        };
        for _ in 0..random.below(10) {
            plan.blows.push(draw_blow(random, lasting));
        }
        plan.blows.sort_by_key(|blow| blow.at);
        for _ in 0..random.below(4) {
            let from = START.after(random.duration(lasting));
            let until = from.after(random.duration(Duration::from_secs(4)));
            plan.latches.push((from, until.min(plan.cease)));
        }
        plan
    }

    /// The same faults for a link that is made `now`: its own time begins with its first sample.
    pub(super) fn left(&self, faults: &Faults, now: Stamp) -> Faults {
        let left = self.cease.since(now);
        if left.is_zero() { NONE } else { Faults { until_s: Some(left.as_secs_f64()), ..*faults } }
    }

    pub(super) fn is_latched(&self, now: Stamp) -> bool {
        self.latches.iter().any(|&(from, until)| from <= now && now < until)
    }
}

const NONE: Faults = Faults {
    loss: 0.0,
    delay_max_s: 0.0,
    duplicate: 0.0,
    reorder: 0.0,
    corrupt: 0.0,
    stamp_jump: 0.0,
    stamp_jump_max_s: 0.0,
    stall: 0.0,
    stall_s: 0.0,
    from_s: 0.0,
    until_s: None,
};

/// Each kind with a probability of its own, from never to harsh: a tenth of the samples and more.
fn draw_faults(random: &mut Random, is_honest: bool) -> Faults {
    let mut share = |max: f64| {
        let is_at_work = random.happens(0.5);
        let share = random.within(0.0..max);
        if is_at_work { share } else { 0.0 }
    };
    let (loss, duplicate, reorder) = (share(0.3), share(0.2), share(0.2));
    let (delay_max_s, stall, stall_s) = (share(0.15), share(0.01), share(1.5));
    let (corrupt, stamp_jump) = (share(0.2), share(0.2));
    let stamp_jump_max_s = random.one_of(&[0.1, 1.0, 3_600.0]);
    let honest = Faults { loss, delay_max_s, duplicate, reorder, stall, stall_s, ..NONE };
    if is_honest { honest } else { Faults { corrupt, stamp_jump, stamp_jump_max_s, ..honest } }
}

fn draw_blow(random: &mut Random, lasting: Duration) -> Blow {
    let at = START.after(random.duration(lasting));
    let whom = random.one_of(&[Whom::Odometry, Whom::Pairing, Whom::Controller, Whom::Controller]);
    // Often about as long as the dead-man's time-out; or as long as a back-off has grown to.
    let length_max = random.one_of(&[Duration::from_millis(400), Duration::from_secs(3)]);
    let length = random.duration(length_max);
    let what = match (random.below(3), whom) {
        (0, _) => What::Killed(length),
        (1, Whom::Controller) => What::Doubled(length),
        _ => What::Stopped(length),
    };
    Blow { at, whom, what }
}

//! The process: commands of several sources in, those of the one that drives out.

use interfaces::Stamp;
use interfaces::topics::{AUTONOMY_COMMAND, TELEOP_COMMAND, VELOCITY_COMMAND};
use node::config::{self, Place};
use node::{Clock, Gauge, Node, Result, Settings};

use crate::{Config, Multiplexer, Source, TUNABLES, Verdict};

/// Runs the multiplexer as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let config = load(node.settings())?;
    let mut multiplexer = Multiplexer::new(&config);
    let mut tuning = node.tuning(config, &TUNABLES)?;
    let mut teleop = node.subscribe(&TELEOP_COMMAND)?;
    let mut autonomy = node.subscribe(&AUTONOMY_COMMAND)?;
    // It says nothing of its own: a robot that no one drives yet is ready all the same.
    let mut commands = node.publish_on_event(&VELOCITY_COMMAND)?;
    let mut gauges = Gauges::new(node);
    while let Some(tick) = node.tick()? {
        if let Some(config) = tuning.take(node)? {
            multiplexer.retune(config);
        }
        if !teleop.has_publisher() {
            multiplexer.leave(Source::Teleop);
        }
        // The more important first: of what came since the last turn, only theirs counts.
        for (source, received) in [(Source::Teleop, &mut teleop), (Source::Autonomy, &mut autonomy)]
        {
            while let Some(command) = received.receive()? {
                if multiplexer.hear(tick.now, source, &command) == Verdict::Passed {
                    // With its stamp: the age of the data is told at the wheel.
                    commands.send(*command)?;
                }
            }
        }
        gauges.tell(node, &multiplexer, tick.now);
    }
    Ok(())
}

/// Says what is wrong with the parameters, without running anything.
pub fn check(settings: &Settings) -> Result {
    load(settings).map(drop)
}

fn load(settings: &Settings) -> Result<Config> {
    if settings.clock() == Clock::Lockstep {
        let message = "chooses by the wall's time, which a robot in lock-step does not know";
        let help = "run it in real time (--clock realtime), or leave it out";
        return Err(config::Error::new(Place::Default, "multiplexer", message, help).into());
    }
    settings.parameters()
}

/// Who drives, for whoever looks at the node's status.
struct Gauges {
    /// Who was said to drive; nobody has heard that yet where it is empty.
    told: &'static str,
    take_overs: Gauge,
    sources: [SourceGauges; Source::ALL.len()],
}

/// The same of one source.
struct SourceGauges {
    drives: Gauge,
    passed: Gauge,
    outranked: Gauge,
    invalid: Gauge,
}

impl Gauges {
    fn new(node: &mut Node<'_>) -> Self {
        let mut gauge = |source: Source, what| node.gauge(&format!("{}_{what}", source.label()));
        let sources = Source::ALL.map(|source| SourceGauges {
            drives: gauge(source, "drives"),
            passed: gauge(source, "passed"),
            outranked: gauge(source, "outranked"),
            invalid: gauge(source, "invalid"),
        });
        Self { told: "", take_overs: node.gauge("take_overs"), sources }
    }

    fn tell(&mut self, node: &mut Node<'_>, multiplexer: &Multiplexer, now: Stamp) {
        let driver = multiplexer.driver(now);
        for (source, gauges) in Source::ALL.into_iter().zip(&self.sources) {
            let counts = multiplexer.counts(source);
            gauges.drives.set(f64::from(u8::from(driver == Some(source))));
            gauges.passed.set(counts.passed as f64);
            gauges.outranked.set(counts.outranked as f64);
            gauges.invalid.set(counts.invalid as f64);
        }
        self.take_overs.set(multiplexer.take_overs() as f64);
        let name = driver.map_or("nobody", Source::label);
        if std::mem::replace(&mut self.told, name) != name {
            node.say(&format!("{name} drives"));
        }
    }
}

//! The machine against a world of its own: random plans, random faults, injected time. Each rule was
//! seen to fail with the machine broken on purpose: see the comment at its assertion.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::{
    Action, Ask, Backoff, Doing, Ending, Event, Exit, Kill, Machine, News, NodePlan, StartLimit,
    Told,
};
use interfaces::{Stamp, State, Transition};
use node::launch::{Restart, Strategy};
use std::time::Duration;

/// [-] Schedules of one test; the issue of the day is found within some thousand.
const SCHEDULES: u64 = 100_000;

/// While faults happen, and after they have ceased.
const STEPS: usize = 60;

/// However slowly nodes do what they are asked, everything is over after so many more steps.
const STEPS_TO_SETTLE: usize = 4_000;

#[test]
fn no_schedule_breaks_a_rule() {
    for seed in 0..SCHEDULES {
        let mut world = World::new(seed);
        world.carry_out_start();
        for _ in 0..STEPS {
            world.turn(true);
        }
        world.settle();
        world.go_down();
    }
}

#[test]
fn crashes_are_counted_slowed_down_and_given_up() {
    let mut machine = Machine::new(vec![plan(Restart::OnFailure)], Stamp::ZERO);
    let mut now = Stamp::ZERO;
    let mut actions = machine.start(now);
    let mut delays = Vec::new();
    while !actions.iter().any(|action| matches!(action, Action::End(_))) {
        if actions.iter().any(|action| matches!(action, Action::Spawn { .. })) {
            let epoch = machine.node(0).epoch;
            let exit = Exit { code: Some(3), what: "exited with code 3".to_owned() };
            now = now.after(Duration::from_millis(60));
            actions = machine.step(Event::News { node: 0, epoch, news: News::Exited(exit) }, now);
            delays.extend(actions.iter().filter_map(|action| match action {
                Action::Tell(Told::Restarting { delay, .. }) => Some(delay.as_millis()),
                _ => None,
            }));
        } else {
            now = machine.next_deadline().unwrap();
            actions = machine.step(Event::Tick, now);
        }
    }

    assert_eq!(delays, [0, 100, 218, 478], "at once, then 0.1 s growing to 5 s in 5 steps");
    assert!(matches!(actions.last(), Some(Action::End(Ending::NotStarted { .. }))), "{actions:?}");
}

#[test]
fn a_node_that_is_late_is_asked_where_it_is_before_it_has_failed() {
    let mut machine = Machine::new(vec![plan(Restart::Never)], Stamp::ZERO);
    machine.start(Stamp::ZERO);
    let late = machine.next_deadline().unwrap();
    let actions = machine.step(Event::Tick, late);
    assert_eq!(actions, [Action::Query { node: 0 }]);

    let there = News::IsIn(State::Unconfigured);
    let actions = machine.step(Event::News { node: 0, epoch: 1, news: there }, late);
    assert_eq!(actions, [Action::Request { node: 0, transition: Transition::Configure }]);
}

#[test]
fn a_node_that_asks_for_more_time_gets_it() {
    let mut machine = Machine::new(vec![plan(Restart::Never)], Stamp::ZERO);
    machine.start(Stamp::ZERO);
    let more = News::NeedsTime(Duration::from_secs(7));
    machine.step(Event::News { node: 0, epoch: 1, news: more }, Stamp::ZERO);

    assert_eq!(machine.next_deadline(), Some(Stamp::ZERO.after(Duration::from_secs(7))));
}

#[test]
fn what_a_former_life_says_is_no_news() {
    let mut machine = Machine::new(vec![plan(Restart::Always)], Stamp::ZERO);
    machine.start(Stamp::ZERO);
    let exit = || News::Exited(Exit { code: Some(1), what: "exited".to_owned() });
    machine.step(Event::News { node: 0, epoch: 1, news: exit() }, Stamp::ZERO);
    let due = machine.next_deadline().unwrap();
    machine.step(Event::Tick, due);
    assert_eq!(machine.node(0).epoch, 2);

    let actions = machine.step(Event::News { node: 0, epoch: 1, news: exit() }, due);
    assert_eq!(actions, []);
}

fn plan(restart: Restart) -> NodePlan {
    NodePlan {
        name: "node".to_owned(),
        requires: Vec::new(),
        restart,
        strategy: Strategy::RestForOne,
        backoff: Backoff {
            first: Duration::from_millis(100),
            max: Duration::from_secs(5),
            steps: 5,
        },
        start_limit: StartLimit { burst: 5, interval: Duration::from_secs(30) },
        start_timeout: Duration::from_secs(1),
        stop_timeout: Duration::from_millis(500),
        watchdog: None,
        may_end: false,
    }
}

/// What the machine's actions do, and what happens beside them.
struct World {
    seed: u64,
    random: ChaCha8Rng,
    machine: Machine,
    plans: Vec<NodePlan>,
    bodies: Vec<Body>,
    now: Stamp,
    has_faults: bool,
    is_over: bool,
    /// The node that was last told to pause or to end since the robot began to go down.
    going_down: Option<[usize; 2]>,
}

/// A node's process.
#[derive(Default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a fault of its own")]
struct Body {
    epoch: u32,
    lives: bool,
    state: u8,
    /// It does nothing any more, not even on SIGTERM.
    hangs: bool,
    /// What it will say next.
    says: Option<News>,
    spawns: Vec<Stamp>,
    is_permanent: bool,
    is_killed: bool,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let count = 2 + below(&mut random, 4);
        let plans: Vec<_> = (0..count).map(|node| random_plan(&mut random, node)).collect();
        Self {
            seed,
            machine: Machine::new(plans.clone(), Stamp::ZERO),
            bodies: plans.iter().map(|_| Body::default()).collect(),
            plans,
            random,
            now: Stamp::ZERO,
            has_faults: true,
            is_over: false,
            going_down: None,
        }
    }

    fn carry_out_start(&mut self) {
        let actions = self.machine.start(self.now);
        self.carry_out(actions);
    }

    /// One thing happens, or some time passes.
    fn turn(&mut self, has_faults: bool) {
        if self.is_over {
            return;
        }
        self.has_faults = has_faults;
        let node = below(&mut self.random, self.bodies.len());
        match below(&mut self.random, if has_faults { 12 } else { 8 }) {
            0..=4 => self.speak(node),
            5..=6 => self.pass(),
            7 => self.ping(),
            8 => self.kill(node),
            9 => self.bodies[node].hangs = self.bodies[node].lives && !self.bodies[node].is_killed,
            10 => {
                let text = News::Stalled { topic: "scan".to_owned() };
                if self.bodies[node].lives && self.bodies[node].state == State::Active as u8 {
                    self.hear(node, text);
                }
            }
            _ => {
                let asks = [Ask::Restart(node), Ask::Stop(node), Ask::Start(node)];
                let ask = asks[below(&mut self.random, asks.len())];
                self.ask(ask);
            }
        }
    }

    /// What somebody asks for is no failure, and may take others along.
    fn ask(&mut self, ask: Ask) {
        for body in &mut self.bodies {
            body.spawns.clear();
            body.is_permanent = false;
        }
        self.step(Event::Asked(ask));
    }

    fn speak(&mut self, node: usize) {
        if self.bodies[node].hangs || !self.bodies[node].lives {
            return;
        }
        if let Some(news) = self.bodies[node].says.take() {
            if let News::Changed { goal, .. } = news {
                self.bodies[node].state = goal as u8;
            }
            let is_end = matches!(news, News::Exited(_));
            self.bodies[node].lives &= !is_end;
            self.bodies[node].is_killed &= !is_end;
            self.hear(node, news);
        } else if self.bodies[node].state == State::Active as u8 {
            self.hear(node, News::Flows);
        }
    }

    /// Time, up to what is due next or a little.
    fn pass(&mut self) {
        // The kernel does not wait for so long.
        for node in 0..self.bodies.len() {
            if self.bodies[node].is_killed {
                self.speak(node);
            }
        }
        let little = self.now.after(Duration::from_millis(1 + below(&mut self.random, 40) as u64));
        let due = self.machine.next_deadline().filter(|_| below(&mut self.random, 4) == 0);
        self.now = due.unwrap_or(little).max(little);
        self.step(Event::Tick);
    }

    fn ping(&mut self) {
        for node in 0..self.bodies.len() {
            if self.bodies[node].lives && !self.bodies[node].hangs {
                self.hear(node, News::Pinged);
            }
        }
    }

    fn kill(&mut self, node: usize) {
        if !self.bodies[node].lives {
            return;
        }
        let codes = [None, Some(1), Some(0), Some(78)];
        let code = codes[below(&mut self.random, codes.len())];
        // One that goes down anyway is started again: it will say the same, and is heard then.
        let stays = [Doing::Starting, Doing::Running, Doing::Stalled];
        let is_heard = stays.contains(&self.machine.node(node).doing);
        self.bodies[node].lives = false;
        self.bodies[node].is_killed = false;
        self.bodies[node].is_permanent = is_heard && code == Some(78);
        self.hear(node, News::Exited(Exit { code, what: "died".to_owned() }));
    }

    fn hear(&mut self, node: usize, news: News) {
        let epoch = self.bodies[node].epoch;
        self.step(Event::News { node, epoch, news });
    }

    fn step(&mut self, event: Event) {
        let actions = self.machine.step(event, self.now);
        self.carry_out(actions);
    }

    fn carry_out(&mut self, actions: Vec<Action>) {
        let mut questions = Vec::new();
        for action in actions {
            let context = format!("SEED={} at {:?}: {action:?}", self.seed, self.now);
            // Broken by not setting `is_over`.
            assert!(!self.is_over, "{context}: after the end");
            match action {
                Action::Spawn { node, epoch } => self.spawn(node, epoch, &context),
                Action::Request { node, transition } => self.request(node, transition, &context),
                Action::Query { node } => questions.push(node),
                Action::Signal { node, signal } => self.signal(node, signal),
                Action::Tell(Told::GoingDown { .. }) => {
                    self.going_down = Some([usize::MAX; 2]);
                }
                Action::Tell(_) => {}
                Action::End(_) => {
                    // Broken by `has_process` forgetting `Dying`.
                    assert!(
                        self.bodies.iter().all(|body| !body.lives),
                        "{context}: somebody lives"
                    );
                    self.is_over = true;
                }
            }
        }
        for node in questions {
            let state = State::try_from(self.bodies[node].state).unwrap();
            self.hear(node, News::IsIn(state));
        }
    }

    fn spawn(&mut self, node: usize, epoch: u32, context: &str) {
        let now = self.now;
        let body = &mut self.bodies[node];
        // Broken by `fail` not killing.
        assert!(!body.lives, "{context}: beside its former life");
        assert!(body.epoch < epoch, "{context}: an old epoch");
        // Broken by leaving 78 out of `PERMANENT`.
        assert!(!body.is_permanent, "{context}: after exit code 78");
        body.spawns.push(now);
        let limit = self.plans[node].start_limit;
        let lately = body.spawns.iter().filter(|spawn| now.since(**spawn) < limit.interval).count();
        // Those that go down with others come up with them, and do not count as failures; the burst
        // itself is another test's, and broken by a limit ten times as high.
        let others: u32 = self.plans.iter().map(|plan| plan.start_limit.burst).sum();
        assert!(lately <= others as usize + 1, "{context}: {lately} starts");
        *body = Body {
            epoch,
            lives: true,
            says: Some(changed(State::Unconfigured)),
            spawns: std::mem::take(&mut body.spawns),
            ..Body::default()
        };
    }

    fn request(&mut self, node: usize, transition: Transition, context: &str) {
        let state = State::try_from(self.bodies[node].state).unwrap();
        if self.bodies[node].lives {
            // Broken by `advance_down` asking the inactive for `ShutdownActive`.
            assert_eq!(transition.start(), state, "{context}");
        }
        if transition == Transition::Activate {
            for &required in &self.plans[node].requires {
                // Broken by `may_follow` letting everybody pass.
                let is_active = self.bodies[required].state == State::Active as u8;
                let view = self.machine.node(required);
                assert!(is_active, "{context}: {required} is not active, {view:?}");
            }
        }
        if let Some([paused, ended]) = &mut self.going_down {
            let last = if transition == Transition::Deactivate { paused } else { ended };
            // Broken by `advance_down` going forwards.
            assert!(node < *last, "{context}: after {last}");
            *last = node;
        }
        let can_fail = self.has_faults && below(&mut self.random, 10) == 0;
        let refuses = can_fail && below(&mut self.random, 2) == 0;
        let body = &mut self.bodies[node];
        body.says = Some(match transition.goal() {
            // It says why, and then does not end as it should. Broken by `be_due` forgetting `Failing`.
            _ if refuses => News::Changed { goal: state, reason: "it cannot".to_owned() },
            _ if can_fail => News::Exited(Exit { code: Some(1), what: "failed".to_owned() }),
            State::Finalized => News::Exited(Exit { code: Some(0), what: "ended".to_owned() }),
            goal => changed(goal),
        });
    }

    fn signal(&mut self, node: usize, signal: Kill) {
        let body = &mut self.bodies[node];
        if !body.lives {
            return;
        }
        body.hangs &= signal == Kill::Term;
        body.is_killed = signal == Kill::Kill;
        body.says = Some(News::Exited(Exit { code: None, what: "was killed".to_owned() }));
    }

    /// Once faults have ceased the robot is ready, or has ended, or misses whom somebody stopped.
    fn settle(&mut self) {
        for body in &mut self.bodies {
            // Whoever hangs is somebody's to find: a watchdog's or a time-out's.
            body.hangs &= false;
        }
        for node in 0..self.bodies.len() {
            self.ask(Ask::Start(node));
        }
        for _ in 0..STEPS_TO_SETTLE {
            if self.is_over || self.machine.is_ready() {
                return;
            }
            self.turn(false);
        }
        let views: Vec<_> = (0..self.plans.len()).map(|node| self.machine.node(node)).collect();
        // Broken by a delay of a day.
        panic!("SEED={}: stuck at {:?}\n{views:?}\n{:#?}", self.seed, self.now, self.machine);
    }

    /// Whatever happens, the end comes.
    fn go_down(&mut self) {
        self.step(Event::Asked(Ask::Down));
        for _ in 0..STEPS_TO_SETTLE {
            if self.is_over {
                return;
            }
            self.turn(false);
        }
        let views: Vec<_> = (0..self.plans.len()).map(|node| self.machine.node(node)).collect();
        panic!("SEED={}: does not end\n{views:#?}", self.seed);
    }
}

fn changed(goal: State) -> News {
    News::Changed { goal, reason: String::new() }
}

fn random_plan(random: &mut ChaCha8Rng, node: usize) -> NodePlan {
    let restarts = [Restart::OnFailure, Restart::Always, Restart::Always, Restart::Never];
    let strategies = [Strategy::OneForOne, Strategy::RestForOne, Strategy::All];
    let requires = (0..node).filter(|_| below(random, 3) == 0).collect();
    NodePlan {
        requires,
        strategy: strategies[below(random, 3)],
        watchdog: (below(random, 2) == 0).then_some(Duration::from_millis(400)),
        may_end: below(random, 4) == 0,
        ..plan(restarts[below(random, 4)])
    }
}

fn below(random: &mut ChaCha8Rng, limit: usize) -> usize {
    usize::try_from(random.next_u64() % limit as u64).unwrap()
}

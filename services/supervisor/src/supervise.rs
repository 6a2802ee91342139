//! The supervisor: hears what has happened, asks the machine what to do about it, and does it.

use std::collections::VecDeque;
use std::time::Duration;

use interfaces::topics::{
    AUTONOMY_COMMAND, JOINT_STATES, MOTION_REQUEST, MOTION_STATE, ODOMETRY, POSE, ROBOT_POSE, SCAN,
    SENSOR_PAIR, TELEOP_COMMAND, VELOCITY_COMMAND,
};
use interfaces::{Stamp, State, Transition};
use node::{Held, Namespace, Notifier, Result, Session, Settings, Unfinished, clock, signal};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::Signal;
use serde_json::json;

use crate::control::Control;
use crate::desk::{Desk, Goal};
use crate::history::History;
use crate::launcher::Launcher;
use crate::log_book::{Line, LogBook};
use crate::machine::{Action, Ask, Doing, Ending, Event, Machine, News, Told};
use crate::member::Member;
use crate::motion::Motion;
use crate::notify::{Datagram, NotifySocket, Word};
use crate::report::{self, Place, Report};
use crate::screen::Screen;
use crate::tuning::Tuning;
use crate::verdict::Verdict;
use crate::{Options, Render, guardian, pairing, plan, sweep, timeline};

/// The node that pairs scan and odometry lives in the supervisor's process, in a loop of its own.
pub(crate) const PAIRING: &str = "pairing";

/// Hints wake the supervisor at once; this is for what gives none: counters, and what nodes write.
const POLL: Duration = Duration::from_millis(100);

/// Whoever turns at least once every [`POLL`] has been stopped, or starved, if it did not for so long.
const STANDSTILL: Duration = Duration::from_millis(250);

/// A process that was killed in the middle of making a file leaves it unfinished. One that lives is
/// done with it long before this.
pub(crate) const UNFINISHED_AGE: Duration = Duration::from_millis(300);

/// However long something unfinished stays, a life is not put off for longer.
pub(crate) const UNFINISHED_WAIT: Duration = Duration::from_secs(1);

/// Between two looks at what those have left who were none of ours.
const SWEEP_PERIOD: Duration = Duration::from_secs(1);

/// Between two looks at what is unfinished.
pub(crate) const POLL_POSTPONED: Duration = Duration::from_millis(10);

/// The events of a run, in the directory of its records.
const EVENTS: &str = "events.jsonl";

/// On the way up and down, systemd waits this long after the supervisor was last heard. It is the
/// machine that gives up: its time-outs know which node it is, and which have asked for more time.
const EXTENSION: Duration = Duration::from_secs(5);

/// Often enough that some may come late.
const EXTENSION_PERIOD: Duration = Duration::from_secs(1);

/// [-] Of systemd's watchdog, after `sd_watchdog_enabled(3)`, which says half.
const PINGS_PER_WATCHDOG: u32 = 3;

/// Runs the robot of `options` until it is done; returns the exit code.
pub(crate) fn supervise(options: &Options, render: Render) -> Result<u8> {
    signal::listen();
    node::die_with_parent(Signal::TERM);
    sweep::inherit_orphans();
    let settings = Settings::of_supervisor(&options.config, &options.sets())?;
    options.records().map_or(Ok(()), |records| report::begin_records(records, &options.config))?;
    for file in [options.report_file(), options.trace.clone()].into_iter().flatten() {
        report::check_writable(&file)?;
    }
    let mut supervisor = Supervisor::new(&settings, options)?;
    let ending = supervisor.run()?;
    supervisor.conclude(&ending, render)
}

/// The supervisor's whole world.
pub(crate) struct Supervisor<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) options: &'a Options,
    pub(crate) namespace: Namespace,
    pub(crate) machine: Machine,
    pub(crate) members: Vec<Member>,
    pub(crate) names: Vec<String>,
    pub(crate) last_failures: Vec<Option<(Stamp, String)>>,
    pub(crate) history: History,
    pub(crate) log_book: LogBook,
    pub(crate) notify: NotifySocket,
    pub(crate) desk: Desk,
    pub(crate) motion: Motion,
    /// [-] The process that holds the lock with this one.
    pub(crate) guardian: u32,
    pub(crate) started: Stamp,
    /// When it last took in what was said.
    heard: Stamp,
    /// When it looks everywhere, whatever wakes it before.
    look_due: Stamp,
    /// Whether nothing but a message on the notify socket has woken it.
    is_only_notified: bool,
    pub(crate) ready_after: Option<Duration>,
    pub(crate) place: Place,
    launcher: Launcher,
    /// What has happened, and the machine has not been told yet.
    events: VecDeque<Event>,
    /// Lives that wait until what the last one left is out of their way.
    postponed: Vec<(usize, u32, Stamp)>,
    unfinished: Unfinished,
    sweep_due: Stamp,
    /// The last change of shared memory after which nothing in it was unfinished.
    clean_since: Option<(i64, i64)>,
    pub(crate) screen: Screen,
    systemd: Notifier,
    systemd_period: Duration,
    systemd_due: Stamp,
    extension_due: Stamp,
    activated: Option<Stamp>,
    stopped: Option<Stamp>,
    stop_requests: u32,
    ending: Option<Ending>,
    /// Held open by the process that outlives the others, so that a restart finds its topics.
    _topics: Vec<Held>,
    pub(crate) session: Session,
    pub(crate) tuning: Tuning,
}

impl<'a> Supervisor<'a> {
    fn new(settings: &'a Settings, options: &'a Options) -> Result<Self> {
        let now = clock::now();
        let namespace = settings.namespace()?;
        let session = Session::join(&namespace, settings.name(), settings.epoch())?
            .with_clock(settings.clock());
        let mut members = vec![Member::of_thread(&session, PAIRING, pairing::run)?];
        for process in settings.launch().start_order() {
            members.push(Member::of_process(&session, process)?);
        }
        let names: Vec<_> = members.iter().map(|member| member.name.clone()).collect();
        let launcher = Launcher::new(settings, options, &namespace);
        Ok(Self {
            settings,
            options,
            machine: Machine::new(plan::plans(settings.launch()), now),
            last_failures: vec![None; members.len()],
            history: History::new(names.clone()),
            log_book: LogBook::new(names.clone(), options.log_dir.as_deref())?,
            notify: NotifySocket::bind(launcher.notify())?,
            desk: Desk::new(Control::bind(&namespace.directory().join("control"))?),
            motion: Motion::new(&session)?,
            guardian: guardian::pid(),
            started: now,
            heard: now,
            look_due: now,
            is_only_notified: false,
            ready_after: None,
            place: Place::of(settings),
            launcher,
            events: VecDeque::new(),
            postponed: Vec::new(),
            unfinished: Unfinished::default(),
            sweep_due: now,
            clean_since: None,
            screen: Screen::new(now, options.log.format),
            systemd: Notifier::from_environment(),
            systemd_period: watchdog_period(),
            systemd_due: now,
            extension_due: now,
            activated: None,
            stopped: None,
            stop_requests: 0,
            ending: None,
            _topics: hold_topics(&session, settings.name())?,
            session,
            tuning: Tuning::default(),
            namespace,
            members,
            names,
        })
    }

    /// Hears, decides, acts, until everything is down.
    fn run(&mut self) -> Result<Ending> {
        let actions = self.machine.start(clock::now());
        self.carry_out(actions)?;
        loop {
            self.hear()?;
            while let Some(event) = self.events.pop_front() {
                let actions = self.machine.step(event, clock::now());
                self.carry_out(actions)?;
            }
            let actions = self.machine.step(Event::Tick, clock::now());
            self.carry_out(actions)?;
            if let Some(ending) = self.ending.take() {
                return Ok(ending);
            }
            if self.events.is_empty() {
                self.settle();
                self.show();
                self.wait();
            }
        }
    }

    /// Takes in what nodes, people and the kernel have said.
    fn hear(&mut self) -> Result {
        let now = clock::now();
        let mut are_only_pings = self.is_only_notified && self.postponed.is_empty();
        while let Some(datagram) = self.notify.receive() {
            are_only_pings &= datagram.words.iter().all(|word| *word == Word::Watchdog);
            self.hear_datagram(&datagram);
        }
        self.be_fair(now);
        if are_only_pings && now < self.look_due {
            // That a loop turns is no reason to look at all else: most of what wakes us is this.
            return Ok(());
        }
        self.look_due = now.after(POLL);
        for node in 0..self.members.len() {
            while let Some(news) = self.members[node].hear(now)? {
                if matches!(news, News::Exited(_)) {
                    self.see_off(node);
                }
                let epoch = self.members[node].epoch;
                self.events.push_back(Event::News { node, epoch, news });
            }
        }
        self.hear_signals();
        self.hear_of_motion(now)?;
        self.hear_of_parameters(now)?;
        for (client, request) in self.desk.requests(now) {
            let asked = self.answer(client, request);
            self.events.extend(asked.map(Event::Asked));
        }
        self.read_logs(now);
        self.spawn_postponed();
        self.sweep_after_guests(now);
        Ok(())
    }

    /// A supervisor that stood still itself has missed pings: the kernel keeps a few datagrams, and
    /// refuses the rest. Nobody is killed for that.
    fn be_fair(&mut self, now: Stamp) {
        let stood_still = now.since(std::mem::replace(&mut self.heard, now));
        if STANDSTILL < stood_still {
            for (node, member) in self.members.iter().enumerate() {
                let epoch = member.epoch;
                self.events.push_back(Event::News { node, epoch, news: News::Pinged });
            }
        }
    }

    fn hear_datagram(&mut self, datagram: &Datagram) {
        let is_speaker =
            |member: &Member| u32::try_from(datagram.pid).is_ok_and(|pid| member.is(pid));
        let Some(node) = self.members.iter().position(is_speaker) else {
            return self.notify.ignore_stranger();
        };
        let member = &mut self.members[node];
        for word in &datagram.words {
            let news = match word {
                Word::Ready => {
                    member.ready();
                    continue;
                }
                Word::Watchdog => News::Pinged,
                Word::WatchdogTrigger => News::Hung,
                Word::ExtendTimeout(more) => News::NeedsTime(*more),
                Word::Status(text) => {
                    if member.says != *text && !text.is_empty() {
                        let (now, wall) = (clock::now(), clock::wall());
                        let words = self.history.add_words(node, member.epoch, text, now, wall);
                        self.desk.tell(words);
                    }
                    member.says.clone_from(text);
                    continue;
                }
                // Hints: the topics have the truth.
                Word::Other => continue,
            };
            self.events.push_back(Event::News { node, epoch: member.epoch, news });
        }
    }

    fn hear_of_motion(&mut self, now: Stamp) -> Result {
        while let Some((text, details)) = self.motion.hear()? {
            let happening = self.history.add_motion(text, details, now, clock::wall());
            self.desk.tell(happening);
            self.screen.tell_line(now, None, &happening.text);
        }
        Ok(())
    }

    /// Once: down in order. Twice: at once; but who dies has not insisted on anything, though the
    /// kernel may say it for each of the guardian's threads.
    fn hear_signals(&mut self) {
        let requests = signal::stop_requests();
        if self.stop_requests < requests {
            self.stop_requests = requests;
            let insists = 1 < requests && guardian::is_alive(self.guardian);
            let ask = if insists { Ask::DownNow } else { Ask::Down };
            self.events.push_back(Event::Asked(ask));
        }
    }

    /// A process has ended: what it wrote last, and what it started and left.
    fn see_off(&mut self, node: usize) {
        let lines = self.log_book.close(node, clock::now(), clock::wall());
        self.tell_lines(lines);
        let (name, epoch) = (&self.members[node].name, self.members[node].epoch);
        sweep::orphans(name, epoch, |pid| self.members.iter().any(|member| member.is(pid)));
    }

    fn read_logs(&mut self, now: Stamp) {
        let lines = self.log_book.read(now, clock::wall());
        self.tell_lines(lines);
    }

    fn tell_lines(&mut self, lines: Vec<Line>) {
        for line in lines {
            let name = &self.names[line.node];
            self.screen.log(name, &line.text);
            self.desk.tell_line(name, &line);
        }
    }

    fn carry_out(&mut self, actions: Vec<Action>) -> Result {
        for action in actions {
            match action {
                Action::Spawn { node, epoch } => self.spawn(node, epoch, clock::now()),
                Action::Request { node, transition } => self.request(node, transition)?,
                Action::Query { node } => {
                    let news = News::IsIn(self.members[node].state());
                    let epoch = self.members[node].epoch;
                    self.events.push_back(Event::News { node, epoch, news });
                }
                Action::Signal { node, signal } => self.members[node].signal(signal),
                Action::Tell(told) => self.tell(&told),
                Action::End(ending) => self.ending = Some(ending),
            }
        }
        Ok(())
    }

    /// Begins a life, as soon as nothing unfinished of the last one is in its way.
    fn spawn(&mut self, node: usize, epoch: u32, asked: Stamp) {
        let may_wait = 1 < epoch && clock::now().since(asked) < UNFINISHED_WAIT;
        if may_wait && 0 < self.sweep_unfinished() {
            self.postponed.push((node, epoch, asked));
            return;
        }
        let output = self.log_book.open(node, epoch).map_err(|cause| cause.to_string());
        let member = &mut self.members[node];
        let spawned = output.and_then(|output| member.spawn(&self.launcher, epoch, output));
        if let Err(why) = spawned {
            let news = News::NotSpawned { why };
            self.events.push_back(Event::News { node, epoch, news });
        }
    }

    /// [-] What may still be under way, of all that is unfinished.
    fn sweep_unfinished(&mut self) -> usize {
        self.namespace.sweep_unfinished(&mut self.unfinished, UNFINISHED_AGE).unfinished
    }

    /// Those who are none of ours come and go, too, and may be killed at it.
    fn sweep_after_guests(&mut self, now: Stamp) {
        if now < self.sweep_due {
            return;
        }
        let changed = Namespace::memory_changed();
        let is_clean = changed == self.clean_since || self.sweep_unfinished() == 0;
        self.clean_since = changed.filter(|_| is_clean);
        self.sweep_due = now.after(if is_clean { SWEEP_PERIOD } else { UNFINISHED_AGE });
    }

    fn spawn_postponed(&mut self) {
        for (node, epoch, asked) in std::mem::take(&mut self.postponed) {
            self.spawn(node, epoch, asked);
        }
    }

    fn request(&mut self, node: usize, transition: Transition) -> Result {
        if transition == Transition::Activate {
            self.activated.get_or_insert_with(clock::now);
            // All that it shares is there by now: what there is no room for fails before it moves.
            self.namespace.reserve()?;
        }
        self.members[node].request(transition, &self.launcher)
    }

    /// Tells people, programs and systemd what has happened.
    fn tell(&mut self, told: &Told) {
        let now = clock::now();
        let happening = self.history.add(told, now, clock::wall());
        self.desk.tell(happening);
        let name = happening.node.map(|node| self.names[node].as_str());
        self.screen.tell(now, told, name, &happening.text);
        match told {
            Told::Ready { after } => {
                self.ready_after = Some(*after);
                self.systemd.ready();
                self.systemd.status(&format!("{} nodes are active", self.names.len()));
            }
            Told::GoingDown { cause } => {
                self.stopped = Some(now);
                self.extension_due = now;
                self.members.iter_mut().for_each(Member::measure_memory);
                self.systemd.stopping();
                self.systemd.status(&format!("going down: {cause}"));
            }
            Told::Failed { node, cause, .. } => {
                self.last_failures[*node] = Some((now, cause.to_string()));
            }
            Told::Spawned { .. }
            | Told::Changed { .. }
            | Told::Restarting { .. }
            | Told::TakingDown { .. }
            | Told::Flowing { .. }
            | Told::Stalled { .. }
            | Told::Signalled { .. }
            | Told::Ended { .. } => {}
            Told::Refused { why, .. } => self.desk.refuse(why),
        }
    }

    /// Answers those whose node has come to where they asked it to.
    fn settle(&mut self) {
        let (machine, members, now) = (&self.machine, &self.members, clock::now());
        // Who is active and sends nothing for a while may lack what he works on: that is told.
        let silent = |node: usize| members[node].flow.overdue(now);
        let is_moving = |node| match machine.node(node).doing {
            Doing::Starting | Doing::Stopping | Doing::Waiting { .. } => true,
            Doing::Stalled => silent(node).is_none(),
            Doing::Running | Doing::Stopped | Doing::Ended => false,
        };
        // Those that went down with it come up again after it.
        let is_settled = !(0..members.len()).any(is_moving);
        let is_down = |node: &usize| machine.node(*node).doing == Doing::Stopped;
        let down = (0..members.len()).filter(is_down).map(|node| &members[node].name);
        let down: Vec<_> = down.collect();
        self.desk.settle(|node, goal| match goal {
            Goal::Active { epoch } => {
                let view = machine.node(node);
                let is_there = epoch <= view.epoch && view.state == State::Active && is_settled;
                let silent = silent(node).filter(|_| view.doing == Doing::Stalled);
                is_there.then(|| json!({ "ok": true, "silent": silent, "down": down }))
            }
            Goal::Down => (!members[node].lives()).then(|| json!({ "ok": true })),
        });
    }

    /// How long the nodes have been active.
    fn wall(&self) -> Duration {
        let Some(activated) = self.activated else { return Duration::ZERO };
        self.stopped.unwrap_or_else(clock::now).since(activated)
    }

    fn show(&mut self) {
        let now = clock::now();
        let wall = self.wall();
        self.screen.live(now, wall, &self.members, self.motion.hold());
        self.screen.flush();
        if self.systemd_due <= now {
            self.systemd_due = now.after(self.systemd_period);
            self.systemd.watchdog();
        }
        // In between, systemd would take it for the time that the robot may run.
        let is_on_its_way = self.ready_after.is_none() || self.stopped.is_some();
        if is_on_its_way && self.extension_due <= now {
            self.extension_due = now.after(EXTENSION_PERIOD);
            self.systemd.extend_timeout(EXTENSION);
        }
    }

    /// Until something happens, or something is due.
    fn wait(&mut self) {
        let now = clock::now();
        let postponed = self.postponed.first().map(|_| now.after(POLL_POSTPONED));
        let deadlines = [
            Some(self.look_due),
            postponed,
            self.machine.next_deadline(),
            self.desk.next_deadline(),
            self.tuning.next_deadline(),
            Some(self.systemd_due),
        ];
        let due = deadlines.into_iter().flatten().min().unwrap_or(now);
        let timeout = Timespec::try_from(due.since(now)).unwrap_or_default();
        let pidfds = self.members.iter().filter_map(Member::pidfd);
        // The notify socket first.
        let mut fds = vec![PollFd::from_borrowed_fd(self.notify.fd(), PollFlags::IN)];
        fds.extend(pidfds.map(|fd| PollFd::new(fd, PollFlags::IN)));
        fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
        fds.extend(self.desk.fds());
        // Where it ends otherwise, the caller looks everywhere.
        let polled = rustix::event::poll(&mut fds, Some(&timeout));
        self.is_only_notified = polled == Ok(1) && fds[0].revents().contains(PollFlags::IN);
        signal::sleep_again();
    }

    /// What is left of the run: on screen, in the report, in the exit code.
    fn conclude(mut self, ending: &Ending, render: Render) -> Result<u8> {
        sweep::children();
        let wall = self.wall();
        let verdict = Verdict::new(ending, &self.members, self.machine.had_to_kill());
        self.screen.clear();
        let report = Report::new(self.settings, self.options, &self.members, wall, &verdict);
        let text = report.text();
        self.screen.print(if self.activated.is_some() { &text } else { &verdict.line });
        if let Some(path) = self.options.report_file() {
            report.write(&path)?;
        }
        if let Some(trace) = &self.options.trace {
            timeline::join(trace, &self.members)?;
        }
        if let Some(records) = self.options.records() {
            self.history.write(&records.join(EVENTS))?;
            node::save_diaries_of_the_dead(&self.namespace, records)?;
            render(records)?;
        }
        self.desk.end(&verdict, report.code());
        self.screen.finish();
        if !guardian::is_alive(self.guardian) {
            // Nobody is left to do it.
            self.namespace.remove();
        }
        Ok(report.code())
    }
}

fn hold_topics(session: &Session, own: &str) -> Result<Vec<Held>> {
    Ok(vec![
        session.hold(&JOINT_STATES, own)?,
        session.hold(&ROBOT_POSE, own)?,
        session.hold(&SCAN, own)?,
        session.hold(&ODOMETRY, own)?,
        session.hold(&SENSOR_PAIR, own)?,
        session.hold(&VELOCITY_COMMAND, own)?,
        session.hold(&POSE, own)?,
        session.hold(&AUTONOMY_COMMAND, own)?,
        session.hold(&TELEOP_COMMAND, own)?,
        session.hold(&MOTION_STATE, own)?,
        session.hold(&MOTION_REQUEST, own)?,
    ])
}

/// How often systemd wants to hear that this loop turns; where it does not, never.
fn watchdog_period() -> Duration {
    // WATCHDOG_PID is the guardian: what matters to it is whether this process goes on.
    let limit = std::env::var("WATCHDOG_USEC").ok().and_then(|limit| limit.parse().ok());
    limit.map_or(Duration::MAX, |limit| Duration::from_micros(limit) / PINGS_PER_WATCHDOG)
}

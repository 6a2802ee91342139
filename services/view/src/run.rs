//! The process: looks at the robot, draws, hears keys.

use std::io::Write;
use std::time::Duration;

use node::{Error, Namespace, Result, clock, signal};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::{Buffer, Cell};
use ratatui::crossterm::event::{self, Event, KeyEventKind};

use crate::draw::{Look, draw};
use crate::keys::{Action, Desk};
use crate::map::FindMap;
use crate::options::{Options, Stay};
use crate::robot::Robot;
use crate::snapshot::snapshot;
use crate::state::State;
use crate::svg::svg;
use crate::terminal::Screen;

/// Between two frames. As often as people follow, and no oftener: each costs a millisecond of a processor,
/// in which a robot at 1 kHz may want it.
const PERIOD: Duration = Duration::from_millis(100);

/// How long the last picture of a robot stays that is down: it came to its end while somebody looked.
const AFTERGLOW: Duration = Duration::from_secs(2);

/// [-] The least important of all, to the kernel's scheduler.
const LOWEST: i32 = 19;

/// Shows the robot in `namespace` for as long as it shall `stay`, or once. `find_map` reads worlds.
pub fn run(namespace: &Namespace, options: &Options, stay: Stay, find_map: FindMap) -> Result {
    signal::listen();
    // Whoever looks makes room for whoever drives. One who may not lower itself looks all the same.
    let _ = rustix::process::nice(LOWEST);
    let mut robot = Robot::new(namespace, find_map);
    let mut state = State::new(namespace.robot());
    if options.once {
        once(&mut robot, &mut state, options)
    } else {
        live(&mut robot, &mut state, stay, Look::of_environment(options.ascii))
    }
}

fn live(robot: &mut Robot, state: &mut State, stay: Stay, look: Look) -> Result {
    let mut screen = Screen::open()?;
    let mut desk = Desk::default();
    // What is shown while the screen is paused; the robot goes on, and so does whoever drives it.
    let mut still: Option<State> = None;
    let mut seen_alive = clock::now();
    while signal::stop_requests() == 0 {
        let due = clock::now().after(PERIOD);
        robot.look(clock::now(), state)?;
        if state.supervisor.state != "gone" {
            seen_alive = clock::now();
        } else if stay == Stay::UntilTheEnd && AFTERGLOW < clock::now().since(seen_alive) {
            return Ok(());
        }
        still = desk.is_paused.then(|| still.unwrap_or_else(|| state.clone()));
        screen.draw(|frame| draw(frame, still.as_ref().unwrap_or(state), &desk, look))?;
        loop {
            let left = due.since(clock::now());
            let has_come = event::poll(left).map_err(|cause| lost(&cause))?;
            if !has_come {
                break;
            }
            let Event::Key(key) = event::read().map_err(|cause| lost(&cause))? else { break };
            if key.kind != KeyEventKind::Press {
                continue;
            }
            match desk.press(key, state) {
                Some(Action::Quit) => return robot.let_go(),
                Some(action) => desk.note = carry_out(robot, action),
                None => {}
            }
        }
    }
    Ok(())
}

/// Does it, and says how it went.
fn carry_out(robot: &mut Robot, action: Action) -> String {
    let outcome = match action {
        Action::Quit => Ok(String::new()),
        Action::Arm => robot.arm(clock::now()).map(|()| "asked the wheels to be armed".to_owned()),
        Action::Stop => robot.stop().map(|is_new| {
            let before = if is_new { "" } else { "already " };
            format!("emergency stop {before}latched; c clears it")
        }),
        Action::Release => robot.release().map(|was_latched| {
            let what = if was_latched { "released" } else { "was not latched" };
            format!("emergency stop {what}")
        }),
        Action::Drive(key) => robot
            .drive(clock::now(), key)
            .map(|()| "driving by hand: arrows, s stops, esc gives the robot back".to_owned()),
        Action::LetGo => robot.let_go().map(|()| "given back".to_owned()),
        Action::Restart(node) => {
            robot.restart(&node);
            Ok(format!("{node} is started again"))
        }
    };
    outcome.unwrap_or_else(|error| error.to_string())
}

fn once(robot: &mut Robot, state: &mut State, options: &Options) -> Result {
    let until = clock::now().after(Duration::from_secs_f64(options.after_s.clamp(0.0, 3600.0)));
    while clock::now() < until && signal::stop_requests() == 0 {
        robot.look(clock::now(), state)?;
        clock::nap(PERIOD);
    }
    robot.look(clock::now(), state)?;
    let text = if options.json {
        format!("{:#}\n", snapshot(state))
    } else {
        let buffer = picture(state, options)?;
        if let Some(path) = &options.svg {
            let written = std::fs::write(path, svg(&buffer));
            return written.map_err(|cause| Error::File { path: path.clone(), cause });
        }
        text(&buffer)
    };
    // Whoever closed it does not want to know.
    drop(std::io::stdout().write_all(text.as_bytes()));
    Ok(())
}

fn picture(state: &State, options: &Options) -> Result<Buffer> {
    let (width, height) = options.size;
    // A picture has its own colours, and no locale.
    let look = match options.svg {
        Some(_) => Look { ascii: options.ascii, plain: false },
        None => Look::of_environment(options.ascii),
    };
    let failed = |cause| Error::Fault(format!("cannot draw: {cause}"));
    let mut terminal = Terminal::new(TestBackend::new(width, height)).map_err(failed)?;
    let desk = Desk::default();
    terminal.draw(|frame| draw(frame, state, &desk, look)).map_err(failed)?;
    Ok(terminal.backend().buffer().clone())
}

/// Its characters alone.
fn text(buffer: &Buffer) -> String {
    let rows = buffer.content.chunks(usize::from(buffer.area.width).max(1));
    let mut text = String::new();
    for row in rows {
        let line: String = row.iter().map(Cell::symbol).collect();
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

fn lost(cause: &dyn std::fmt::Display) -> Error {
    Error::Fault(format!("cannot read the terminal: {cause}"))
}

//! What keys do: pure, a key in, an action out.

use node::hand::Key;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::state::State;

/// What a screen can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Panel {
    #[default]
    Overview,
    Map,
    Nodes,
    Topics,
    Pairing,
    Events,
}

impl Panel {
    /// In the order of their keys, from 1.
    pub(crate) const ALL: [Self; 6] =
        [Self::Overview, Self::Map, Self::Nodes, Self::Topics, Self::Pairing, Self::Events];

    pub(crate) const fn label(self) -> &'static str {
        match self {
            Self::Overview => "all",
            Self::Map => "map",
            Self::Nodes => "nodes",
            Self::Topics => "topics",
            Self::Pairing => "pairing",
            Self::Events => "events",
        }
    }
}

/// What is to be done that the screen alone cannot do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Away from the screen.
    Quit,
    /// Let the robot move again.
    Arm,
    /// Latch the emergency stop.
    Stop,
    /// Release it.
    Release,
    /// A node and whoever requires it, down and up again.
    Restart(String),
    /// Drive by hand.
    Drive(Key),
    /// Give the robot back to whoever drove it.
    LetGo,
}

/// Where a person sits: what is shown, what is chosen, what was said last.
#[derive(Debug, Default)]
pub struct Desk {
    pub(crate) panel: Panel,
    pub(crate) is_paused: bool,
    /// [-] Which node keys are about.
    pub(crate) node: usize,
    /// The answer to the last key.
    pub(crate) note: String,
    /// The node that `r` was pressed for once.
    pub(crate) restart: Option<String>,
}

impl Desk {
    /// What `key` asks for; what concerns the screen alone is done.
    pub fn press(&mut self, key: KeyEvent, state: &State) -> Option<Action> {
        self.note.clear();
        let restart = self.restart.take();
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            return (key.code == KeyCode::Char('c')).then_some(Action::Quit);
        }
        match key.code {
            KeyCode::Char('q') => return Some(Action::Quit),
            KeyCode::Char('p' | ' ') => self.is_paused = !self.is_paused,
            KeyCode::Tab => self.turn(1),
            KeyCode::BackTab => self.turn(Panel::ALL.len() - 1),
            KeyCode::Char('n' | 'j') => self.choose(state, 1),
            KeyCode::Char('N' | 'k') => self.choose(state, state.nodes.len().max(1) - 1),
            KeyCode::Char('a') => return Some(Action::Arm),
            KeyCode::Char('e') => return Some(Action::Stop),
            KeyCode::Char('c') => return Some(Action::Release),
            KeyCode::Char('r') => return self.restart(state, restart.as_deref()),
            KeyCode::Char(digit @ '1'..='6') => {
                let index = digit.to_digit(10).map_or(0, |digit| digit as usize - 1);
                self.panel = Panel::ALL[index];
            }
            KeyCode::Up => return Some(Action::Drive(Key::Faster)),
            KeyCode::Down => return Some(Action::Drive(Key::Slower)),
            KeyCode::Left => return Some(Action::Drive(Key::Left)),
            KeyCode::Right => return Some(Action::Drive(Key::Right)),
            KeyCode::Char('s') => return Some(Action::Drive(Key::Stop)),
            KeyCode::Esc => return Some(Action::LetGo),
            _ => {}
        }
        None
    }

    fn turn(&mut self, by: usize) {
        let all = Panel::ALL;
        let index = all.iter().position(|panel| *panel == self.panel).unwrap_or_default();
        self.panel = all[(index + by) % all.len()];
    }

    fn choose(&mut self, state: &State, by: usize) {
        self.node = (self.node + by) % state.nodes.len().max(1);
    }

    /// The second time in a row it is meant.
    fn restart(&mut self, state: &State, asked: Option<&str>) -> Option<Action> {
        let name = state.nodes.get(self.node)?.name.clone();
        if asked == Some(&name) {
            self.note = format!("{name} is started again");
            return Some(Action::Restart(name));
        }
        self.note = format!("r again restarts {name}; n chooses another node");
        self.restart = Some(name);
        None
    }
}

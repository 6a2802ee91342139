//! What people ask for.

use interfaces::Stamp;

use super::life::{Phase, Want};
use super::{Ask, Ending, Machine, Told};

impl Machine {
    pub(super) fn obey(&mut self, ask: Ask, now: Stamp) {
        if self.ending.is_some() && ask != Ask::DownNow {
            if ask != Ask::Down {
                let why = "the robot goes down".to_owned();
                self.tell(Told::Refused { ask, why });
            }
            return;
        }
        match ask {
            Ask::Down => self.go_down(Ending::Asked, "somebody asked for it", now),
            Ask::DownNow => {
                self.go_down(Ending::Asked, "somebody insisted on it", now);
                for node in 0..self.lives.len() {
                    if self.lives[node].has_process() {
                        self.had_to_kill = true;
                        self.kill(node, now);
                    }
                }
            }
            Ask::Restart(node) => {
                self.lives[node].forget_failures(now);
                if self.lives[node].want == Want::Down || !self.lives[node].has_process() {
                    self.want_up(node, now);
                } else {
                    self.lives[node].want = Want::Again;
                    self.lives[node].because = None;
                    self.take_down_with(node);
                    self.lives[node].restarts += 1;
                }
            }
            Ask::Stop(node) => {
                let nodes: Vec<_> = self.requirers(node).into_iter().chain([node]).collect();
                for &node in &nodes {
                    self.lives[node].want = Want::Down;
                }
                self.tell_taking_down(nodes, node);
            }
            Ask::Start(node) => self.want_up(node, now),
        }
    }

    /// Has the node come up, and what it requires.
    fn want_up(&mut self, node: usize, now: Stamp) {
        for required in self.plans[node].requires.clone() {
            self.want_up(required, now);
        }
        let life = &mut self.lives[node];
        life.forget_failures(now);
        if matches!(life.phase, Phase::Ended | Phase::Lost) {
            life.phase = Phase::Down;
        }
        // One on its way down goes all the way first.
        let is_leaving = life.want != Want::Up && life.has_process();
        life.want = if is_leaving { Want::Again } else { Want::Up };
    }
}

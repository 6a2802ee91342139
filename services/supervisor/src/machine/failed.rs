//! What goes wrong, and what is done about it.

use interfaces::{Stamp, State};
use node::launch::{Restart, Strategy};

use super::life::{Phase, Want};
use super::{Cause, Ending, Exit, Machine, Told};

impl Machine {
    /// Its process is gone.
    pub(super) fn see_off(&mut self, node: usize, exit: Exit, now: Stamp) {
        let life = &mut self.lives[node];
        life.state = State::Unknown;
        let was_asked = matches!(life.phase, Phase::ShuttingDown(_) | Phase::Dying(_));
        match life.want {
            Want::Up if was_asked => life.phase = Phase::Down,
            Want::Up => {
                let is_end = exit.code == Some(0) && self.may_end(node);
                if is_end {
                    self.lives[node].phase = Phase::Ended;
                    self.tell(Told::Ended { node, what: exit.what });
                } else {
                    self.fail(node, self.cause_of(node, exit), now);
                }
            }
            Want::Down | Want::Again => {
                life.phase = Phase::Down;
                if life.want == Want::Again {
                    life.want = Want::Up;
                }
                if !was_asked {
                    let (epoch, age) = (life.epoch, now.since(life.since));
                    let cause = self.cause_of(node, exit);
                    self.tell(Told::Failed { node, epoch, cause, age });
                }
            }
        }
    }

    fn may_end(&self, node: usize) -> bool {
        let plan = &self.plans[node];
        plan.may_end && plan.restart != Restart::Always && self.requirers(node).is_empty()
    }

    /// What it said before its end explains more than how it ended.
    fn cause_of(&self, node: usize, exit: Exit) -> Cause {
        match self.lives[node].reason.clone() {
            Some(reason) if exit.code.is_some() => Cause::Refused { reason, code: exit.code },
            Some(_) | None => Cause::Exited(exit),
        }
    }

    /// A transition was not done in time, and it has been asked.
    pub(super) fn be_too_slow(&mut self, node: usize, cause: Cause, now: Stamp) {
        if self.lives[node].want == Want::Up {
            self.fail(node, cause, now);
        } else {
            self.terminate(node, now);
        }
    }

    /// A node that is wanted cannot go on: fenced, told, and started again if it may be.
    pub(super) fn fail(&mut self, node: usize, cause: Cause, now: Stamp) {
        let (plan, life) = (&self.plans[node], &mut self.lives[node]);
        let (epoch, age) = (life.epoch, now.since(life.since));
        let was_up = life.phase == Phase::Active && cause.is_of_running();
        life.note_failure(plan, now);
        let failures = life.failures.len();
        let is_over = cause.is_process_gone();
        self.tell(Told::Failed { node, epoch, cause: cause.clone(), age });
        if is_over {
            self.lives[node].phase = Phase::Down;
            self.lives[node].state = State::Unknown;
        } else {
            self.kill(node, now);
        }
        if self.ending.is_some() {
            return;
        }

        let plan = &self.plans[node];
        if !cause.may_restart(plan.restart) || plan.start_limit.burst as usize <= failures {
            let text = format!("{} {cause}", plan.name);
            let failures = u32::try_from(failures).unwrap_or(u32::MAX);
            let ending = if was_up || self.readiness.was_ready {
                Ending::GaveUp { node, cause, failures }
            } else {
                Ending::NotStarted { node, cause }
            };
            return self.go_down(ending, &text, now);
        }

        let delay = self.lives[node].delay(plan, now);
        let (count, burst) = (u32::try_from(failures).unwrap_or(u32::MAX), plan.start_limit.burst);
        let life = &mut self.lives[node];
        life.not_before = now.after(delay);
        life.restarts += 1;
        life.because = None;
        self.tell(Told::Restarting { node, delay, count, burst });
        self.take_down_with(node);
    }

    /// Takes down whoever is started again with `node`.
    pub(super) fn take_down_with(&mut self, node: usize) {
        let with = match self.plans[node].strategy {
            Strategy::OneForOne => self.requirers(node),
            Strategy::RestForOne => ((node + 1)..self.lives.len()).rev().collect(),
            Strategy::All => (0..self.lives.len()).rev().filter(|&other| other != node).collect(),
        };
        let with: Vec<_> =
            with.into_iter().filter(|&other| self.lives[other].goes_with_others()).collect();
        for &other in &with {
            let life = &mut self.lives[other];
            if node < other {
                life.because = Some(node);
            }
            if life.has_process() {
                life.want = Want::Again;
            }
        }
        if !with.is_empty() {
            self.tell_taking_down(with, node);
        }
    }

    /// Those that do not run without `node`, by their own word or another's; the last first.
    pub(super) fn requirers(&self, node: usize) -> Vec<usize> {
        let mut with = vec![node];
        for other in (node + 1)..self.plans.len() {
            if self.plans[other].requires.iter().any(|required| with.contains(required)) {
                with.push(other);
            }
        }
        with.remove(0);
        with.reverse();
        with
    }

    pub(super) fn tell_taking_down(&mut self, nodes: Vec<usize>, because: usize) {
        self.tell(Told::TakingDown { nodes, because });
    }

    pub(super) fn go_down(&mut self, ending: Ending, cause: &str, now: Stamp) {
        if self.ending.is_none() {
            self.ending = Some(ending);
            self.tell(Told::GoingDown { cause: cause.to_owned() });
        }
        for (plan, life) in self.plans.iter().zip(&mut self.lives) {
            life.want = Want::Down;
            // Nobody waits for a start as long as a start may take.
            life.phase.shorten(now, plan.stop_timeout);
        }
    }
}

//! Everybody's next step: whatever may happen next happens.

use interfaces::{Stamp, Transition};

use super::life::{Deadline, Life, Phase, Stopping, Want};
use super::{Action, Machine, Rank, Told};

impl Machine {
    /// Whatever may happen next happens, in order upwards and in reverse downwards.
    pub(super) fn advance(&mut self, now: Stamp) {
        for node in (0..self.lives.len()).rev() {
            self.advance_down(node, now);
        }
        for node in 0..self.lives.len() {
            self.advance_up(node, now);
        }
        self.see_whether_all_are_active(now);
        self.see_whether_ready(now);
        if let Some(ending) = &self.ending
            && self.lives.iter().all(|life| !life.has_process())
        {
            let ending = ending.clone();
            self.is_over = true;
            self.act(Action::End(ending));
        }
    }

    fn advance_up(&mut self, node: usize, now: Stamp) {
        if self.lives[node].want != Want::Up {
            return;
        }
        let deadline = Deadline::new(now, self.plans[node].start_timeout);
        match self.lives[node].phase {
            Phase::Down if self.may_spawn(node, now) => {
                let life = &mut self.lives[node];
                life.begin(now, Phase::Starting(deadline));
                let epoch = life.epoch;
                self.tell(Told::Spawned { node, epoch });
                self.act(Action::Spawn { node, epoch });
            }
            Phase::Unconfigured if self.may_follow(node, Phase::rank_unconfigured, now) => {
                self.lives[node].phase = Phase::Configuring(deadline);
                self.act(Action::Request { node, transition: Transition::Configure });
            }
            Phase::Inactive if self.may_follow(node, Phase::rank_inactive, now) => {
                self.lives[node].phase = Phase::Activating(deadline);
                self.act(Action::Request { node, transition: Transition::Activate });
            }
            Phase::Down
            | Phase::Unconfigured
            | Phase::Inactive
            | Phase::Starting(_)
            | Phase::Configuring(_)
            | Phase::Activating(_)
            | Phase::Active
            | Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_)
            | Phase::Ended
            | Phase::Lost => {}
        }
    }

    /// Not before its time, not before whoever took it down or is required, and not while others are on their way
    /// down, who may be of its kind.
    fn may_spawn(&self, node: usize, now: Stamp) -> bool {
        let life = &self.lives[node];
        let is_pending = |because: usize| {
            self.lives[because].want == Want::Up && !self.lives[because].is_there()
        };
        life.not_before <= now
            && life.because.is_none_or(|because| !is_pending(because))
            && self.lives.iter().all(|other| other.want == Want::Up || !other.has_process())
            && self.plans[node].requires.iter().all(|&other| self.lives[other].is_there())
    }

    /// Whether all that are on their way up have come as far as it has, and those before it further.
    fn may_follow(&self, node: usize, is_there: fn(Phase) -> Rank, now: Stamp) -> bool {
        (0..self.lives.len()).all(|other| {
            let life = &self.lives[other];
            // One that waits for its next life, or is not wanted, holds nobody up.
            let is_absent = life.want == Want::Down || !life.has_process() && now < life.not_before;
            is_absent
                || match is_there(life.phase) {
                    Rank::Behind => false,
                    Rank::There => node <= other,
                    Rank::Beyond => true,
                }
        })
    }

    fn advance_down(&mut self, node: usize, now: Stamp) {
        let life = &self.lives[node];
        if life.want == Want::Up {
            return;
        }
        let stop_timeout = self.plans[node].stop_timeout;
        let deadline = Deadline::new(now, stop_timeout);
        match life.phase {
            // Nothing has begun that would have to be ended in order.
            Phase::Starting(_) => self.terminate(node, now),
            // A foreign process that does not become ready is told to go.
            Phase::Activating(_) if self.plans[node].may_end => self.terminate(node, now),
            Phase::Active if self.all_later_are_paused(node) => {
                self.lives[node].phase = Phase::Deactivating(deadline);
                self.act(Action::Request { node, transition: Transition::Deactivate });
            }
            Phase::Inactive | Phase::Unconfigured if self.all_later_are_gone(node) => {
                let shutdown = match life.phase {
                    Phase::Inactive => Transition::ShutdownInactive,
                    _ => Transition::ShutdownUnconfigured,
                };
                let stopping = Stopping { until: deadline.until, told: None };
                self.lives[node].phase = Phase::ShuttingDown(stopping);
                self.act(Action::Request { node, transition: shutdown });
            }
            Phase::Down if life.want == Want::Again => self.lives[node].want = Want::Up,
            Phase::Down
            | Phase::Active
            | Phase::Inactive
            | Phase::Unconfigured
            | Phase::Configuring(_)
            | Phase::Activating(_)
            | Phase::Deactivating(_)
            | Phase::Failing(_)
            | Phase::ShuttingDown(_)
            | Phase::Dying(_)
            | Phase::Ended
            | Phase::Lost => {}
        }
    }

    fn leaving(&self) -> impl Iterator<Item = (usize, &Life)> {
        let lives = self.lives.iter().enumerate();
        lives.filter(|(_, life)| life.want != Want::Up && life.has_process())
    }

    fn all_later_are_paused(&self, node: usize) -> bool {
        self.leaving().all(|(other, life)| other <= node || life.phase.is_paused())
    }

    /// And all are paused, the earlier too: nobody ends while another is still at work.
    fn all_later_are_gone(&self, node: usize) -> bool {
        self.leaving().all(|(other, life)| other <= node && life.phase.is_paused())
    }

    fn see_whether_all_are_active(&mut self, now: Stamp) {
        let is_active = |life: &Life| {
            life.want == Want::Up && matches!(life.phase, Phase::Active | Phase::Ended)
        };
        if !self.lives.iter().all(is_active) {
            self.all_active_since = None;
        } else if self.all_active_since.is_none() {
            self.all_active_since = Some(now);
        }
    }

    fn see_whether_ready(&mut self, now: Stamp) {
        let is_ready = self.ending.is_none() && self.lives.iter().all(Life::is_ready);
        if is_ready == self.readiness.is_ready {
            return;
        }
        let after = now.since(self.readiness.since);
        self.readiness.is_ready = is_ready;
        self.readiness.since = now;
        if is_ready {
            self.readiness.was_ready = true;
            self.tell(Told::Ready { after });
        }
    }
}

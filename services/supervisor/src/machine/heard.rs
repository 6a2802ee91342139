//! What nodes say: one match for each phase.

use std::time::Duration;

use interfaces::{Stamp, State};

use super::life::{Deadline, Phase};
use super::{Cause, Ending, Kill, Machine, News, Told};

impl Machine {
    pub(super) fn hear(&mut self, node: usize, news: News, now: Stamp) {
        let news = match news {
            News::Changed { goal, reason } => {
                self.note_change(node, goal, reason.clone());
                News::Changed { goal, reason }
            }
            News::Pinged => return self.lives[node].pinged = now,
            News::NeedsTime(more) => return self.extend(node, more, now),
            News::Finished { is_success, why } => return self.finish(is_success, why, now),
            News::IsIn(_)
            | News::Hung
            | News::Flows
            | News::Stalled { .. }
            | News::NotSpawned { .. }
            | News::Exited(_) => news,
        };
        match self.lives[node].phase {
            Phase::Starting(deadline) => {
                self.hear_on_the_way(node, deadline, State::Unconfigured, news, now);
            }
            Phase::Configuring(deadline) | Phase::Deactivating(deadline) => {
                self.hear_on_the_way(node, deadline, State::Inactive, news, now);
            }
            Phase::Activating(deadline) => {
                self.hear_on_the_way(node, deadline, State::Active, news, now);
            }
            Phase::Unconfigured | Phase::Inactive => self.hear_at_rest(node, news, now),
            Phase::Active => self.hear_active(node, news, now),
            Phase::Failing(_) | Phase::ShuttingDown(_) | Phase::Dying(_) => {
                self.hear_leaving(node, news, now);
            }
            // Its process is gone; whatever it said before is history.
            Phase::Down | Phase::Ended | Phase::Lost => {}
        }
    }

    /// For what it is doing; where it is active, for its first data.
    fn extend(&mut self, node: usize, more: Duration, now: Stamp) {
        let life = &mut self.lives[node];
        if life.phase != Phase::Active {
            life.phase.extend(now, more);
        } else if !life.has_flowed {
            self.data_awaited_until = self.data_awaited_until.max(now.after(more));
        }
    }

    /// In a transition, to `goal`.
    fn hear_on_the_way(
        &mut self,
        node: usize,
        deadline: Deadline,
        goal: State,
        news: News,
        now: Stamp,
    ) {
        match news {
            News::Changed { goal: is, .. } | News::IsIn(is) if is == goal => {
                self.arrive(node, goal, now);
            }
            News::Changed { reason, .. } if !reason.is_empty() => self.expect_end(node, now),
            News::IsIn(is) if deadline.is_asked => {
                let after = deadline.limit;
                self.be_too_slow(node, Cause::TooSlow { goal, is, after }, now);
            }
            News::Flows => self.lives[node].flow(),
            News::Hung => self.fail(node, Cause::Hung { silence: Duration::ZERO }, now),
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            // The states on the way, and what does not matter there.
            News::Changed { .. } | News::IsIn(_) | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    /// Unconfigured or inactive, until its turn comes.
    fn hear_at_rest(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Changed { reason, .. } if !reason.is_empty() => self.expect_end(node, now),
            News::Hung => self.fail(node, Cause::Hung { silence: Duration::ZERO }, now),
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            News::Changed { .. } | News::IsIn(_) | News::Flows | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    fn hear_active(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Flows => {
                if self.lives[node].has_flowed && !self.lives[node].flows {
                    self.tell(Told::Flowing { node });
                }
                self.lives[node].flow();
            }
            News::Stalled { topic } => {
                self.lives[node].flows = false;
                self.tell(Told::Stalled { node, topic });
            }
            // It goes by itself: where it comes from its supervisor it is in another phase.
            News::Changed { goal, .. } if goal != State::Active => self.expect_end(node, now),
            News::Hung => {
                let silence = now.since(self.lives[node].pinged);
                self.fail(node, Cause::Hung { silence }, now);
            }
            News::NotSpawned { why } => self.fail(node, Cause::NotSpawned(why), now),
            News::Exited(exit) => self.see_off(node, exit, now),
            News::Changed { .. } | News::IsIn(_) => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    /// On its way out: only its end matters.
    fn hear_leaving(&mut self, node: usize, news: News, now: Stamp) {
        match news {
            News::Exited(exit) => self.see_off(node, exit, now),
            // It was told to go before it had come, and may not have noticed: no signal reaches a
            // thread.
            News::Changed { goal: State::Unconfigured, reason }
                if reason.is_empty() && self.lives[node].phase.was_told(Kill::Term) =>
            {
                self.lives[node].phase = Phase::Unconfigured;
            }
            News::NotSpawned { .. }
            | News::Changed { .. }
            | News::IsIn(_)
            | News::Hung
            | News::Flows
            | News::Stalled { .. } => {}
            News::Pinged | News::NeedsTime(_) | News::Finished { .. } => {
                unreachable!("taken in before")
            }
        }
    }

    fn note_change(&mut self, node: usize, goal: State, reason: String) {
        let life = &mut self.lives[node];
        let mut start = std::mem::replace(&mut life.state, goal);
        if goal.is_primary() {
            // People think from rest to rest: what lies between is told for itself.
            start = std::mem::replace(&mut life.rest, goal);
        }
        if !reason.is_empty() {
            life.reason.get_or_insert_with(|| reason.clone());
        }
        let epoch = life.epoch;
        if start != goal || !reason.is_empty() {
            self.tell(Told::Changed { node, epoch, start, goal, reason });
        }
    }

    fn arrive(&mut self, node: usize, state: State, now: Stamp) {
        let life = &mut self.lives[node];
        // It may have answered before it told.
        life.state = state;
        life.phase = match life.phase {
            Phase::Starting(_) => Phase::Unconfigured,
            Phase::Configuring(_) | Phase::Deactivating(_) => Phase::Inactive,
            Phase::Activating(_) => {
                life.pinged = now;
                life.active_since = now;
                Phase::Active
            }
            other => other,
        };
    }

    /// It has said why it cannot go on; its exit code says more.
    fn expect_end(&mut self, node: usize, now: Stamp) {
        let deadline = Deadline::new(now, self.plans[node].stop_timeout);
        self.lives[node].phase = Phase::Failing(deadline);
    }

    fn finish(&mut self, is_success: bool, why: String, now: Stamp) {
        if self.ending.is_none() {
            let cause = why.clone();
            let ending = if is_success { Ending::Done(why) } else { Ending::Failed(why) };
            self.go_down(ending, &cause, now);
        }
    }
}

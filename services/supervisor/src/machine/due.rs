//! What happens because time has passed.

use interfaces::Stamp;

use super::life::{Phase, Want};
use super::{ANSWER_TIMEOUT, Action, Cause, Machine};

impl Machine {
    pub(super) fn check_deadlines(&mut self, now: Stamp) {
        for node in 0..self.lives.len() {
            if self.deadline(node).is_some_and(|due| due <= now) {
                self.be_due(node, now);
            }
        }
    }

    fn be_due(&mut self, node: usize, now: Stamp) {
        let life = &mut self.lives[node];
        match life.phase {
            Phase::Starting(deadline)
            | Phase::Configuring(deadline)
            | Phase::Activating(deadline)
            | Phase::Deactivating(deadline) => {
                if deadline.is_asked {
                    // It was asked, and nobody answered.
                    let (goal, is) = (life.phase.goal(), life.state);
                    let after = deadline.limit;
                    self.be_too_slow(node, Cause::TooSlow { goal, is, after }, now);
                } else {
                    life.phase.ask(now.after(ANSWER_TIMEOUT));
                    self.act(Action::Query { node });
                }
            }
            Phase::Active => self.be_due_active(node, now),
            Phase::Failing(_) => self.give_reason_up(node, now),
            Phase::ShuttingDown(stopping) | Phase::Dying(stopping) => {
                self.insist(node, stopping, now);
            }
            // Its turn may have come, which `advance` knows.
            Phase::Down | Phase::Unconfigured | Phase::Inactive | Phase::Ended | Phase::Lost => {}
        }
    }

    fn be_due_active(&mut self, node: usize, now: Stamp) {
        if self.lives[node].want != Want::Up {
            // It waits for its turn to go, and its watchdog with it.
            self.lives[node].pinged = now;
            return;
        }
        let silence = now.since(self.lives[node].pinged);
        let is_hung = self.plans[node].watchdog.is_some_and(|limit| limit <= silence);
        let cause = if is_hung {
            Cause::Hung { silence }
        } else {
            Cause::NoData { after: self.plans[node].start_timeout }
        };
        self.fail(node, cause, now);
    }

    /// It said why it would end, and did not.
    fn give_reason_up(&mut self, node: usize, now: Stamp) {
        let reason = self.lives[node].reason.clone().unwrap_or_default();
        if self.lives[node].want == Want::Up {
            self.fail(node, Cause::Refused { reason, code: None }, now);
        } else {
            self.terminate(node, now);
        }
    }
}

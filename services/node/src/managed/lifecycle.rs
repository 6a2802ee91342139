//! Where a node is in its life, and where it was asked to go.

use std::time::Duration;

use interfaces::topics::{CHANGE_STATE, TRANSITION_EVENT};
use interfaces::{ChangeState, Stamp, State, Text, Transition, TransitionEvent};

use crate::{Publisher, Result, Session, Settings, Subscriber, clock, signal};

/// How long a node may finish what it has begun before it is deactivated all the same.
const HOLD_MAX: Duration = Duration::from_secs(1);

/// Where a node is in its life, and where it was asked to go.
#[derive(Debug)]
pub(super) struct Lifecycle {
    requests: Subscriber<ChangeState>,
    events: Publisher<TransitionEvent>,
    state: State,
    pending: Option<(Transition, Stamp)>,
    is_held: bool,
    had_last_turn: bool,
}

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// Nothing was asked for, or it has to wait.
    Stay,
    /// One more turn: what has come before is still seen to.
    LastTurn,
    /// What was asked for.
    Go(Transition),
}

impl Lifecycle {
    pub(super) fn open(session: &Session) -> Result<Self> {
        Ok(Self {
            requests: session.subscriber(&CHANGE_STATE)?,
            events: session.publisher(&TRANSITION_EVENT)?,
            state: State::Unknown,
            pending: None,
            is_held: false,
            had_last_turn: false,
        })
    }

    pub(super) const fn state(&self) -> State {
        self.state
    }

    /// Puts off what is asked for, or no longer.
    pub(super) const fn set_held(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    pub(super) const fn is_leaving(&self) -> bool {
        self.pending.is_some()
    }

    pub(super) fn has_requests(&self) -> Result<bool> {
        self.requests.has_samples()
    }

    /// Tells those who have come late where the node is.
    pub(super) fn greet(&self) -> Result {
        self.events.greet()
    }

    pub(super) fn next(&mut self, now: Stamp) -> Next {
        let Some((transition, since)) = self.pending else { return Next::Stay };
        if self.is_held && now.since(since) <= HOLD_MAX {
            return Next::Stay;
        }
        if self.state == State::Active && !std::mem::replace(&mut self.had_last_turn, true) {
            return Next::LastTurn;
        }
        self.had_last_turn = false;
        self.pending = None;
        self.is_held = false;
        Next::Go(transition)
    }

    /// Notes the next request that fits the node's state; a signal is a request to end.
    pub(super) fn take_request(&mut self, settings: &Settings, now: Stamp) -> Result {
        if self.pending.is_some() {
            return Ok(());
        }
        if settings.heeds_signals() && 0 < signal::stop_requests() {
            self.pending = Transition::shutdown_from(self.state).map(|end| (end, now));
            return Ok(());
        }
        while let Some(request) = self.requests.receive()? {
            match Transition::try_from(request.transition) {
                Ok(transition) if transition.start() == self.state => {
                    self.pending = Some((transition, now));
                    return Ok(());
                }
                Ok(transition) => {
                    tracing::warn!(%transition, state = %self.state, "refused a transition");
                    self.announce(self.state, "refused a transition that does not start here")?;
                }
                Err(cause) => tracing::warn!(%cause, "refused a transition"),
            }
        }
        if settings.autostart() {
            self.pending = self.own_next().map(|next| (next, now));
        }
        Ok(())
    }

    /// What a node does that nobody supervises.
    fn own_next(&self) -> Option<Transition> {
        match self.state {
            State::Unconfigured => Some(Transition::Configure),
            State::Inactive => Some(Transition::Activate),
            _ => None,
        }
    }

    /// Is in state `goal` from now on; returns where it was.
    pub(super) fn enter(&mut self, goal: State) -> State {
        let start = std::mem::replace(&mut self.state, goal);
        tracing::debug!(%start, %goal, "changed state");
        start
    }

    /// Tells everybody where it is, where it was, and why.
    pub(super) fn announce(&mut self, start: State, reason: &str) -> Result {
        let goal = self.state;
        self.events.send_with(|event| {
            event.header.stamp = clock::now();
            event.start_state = start as u8;
            event.goal_state = goal as u8;
            event.reason = Text::new(reason);
        })
    }
}

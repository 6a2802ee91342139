//! Notices that a clock ran backwards, and keeps what is from before from meeting what is from
//! after.

use std::time::Duration;

use interfaces::Stamp;

use super::{Config, Policy, Reason, TOPICS_MAX, nanoseconds};

/// The clock as the stamps show it. Bagged data that starts over, a simulator that starts again, or
/// one absurd stamp in the future all look the same: a topic steps back.
#[derive(Debug)]
pub(super) struct Timeline {
    tracks: Vec<Track>,
    /// [ns] Stamps of one moment are less than this apart.
    slop: u64,
    /// [ns] How long a topic may lag behind the others in turning back.
    patience: u64,
    /// Whether the policy wants every topic in order.
    strict: bool,
}

#[derive(Debug, Clone, Copy, Default)]
struct Track {
    /// [ns] The newest stamp since the last step back.
    newest: Option<u64>,
    /// What this topic showed before another one stepped back, while it has not followed.
    old: Option<Old>,
    /// [ns] When this topic last stepped back, in receive time.
    stepped: Option<u64>,
    /// Whether the last sample was refused for being behind its predecessor.
    behind: bool,
}

#[derive(Debug, Clone, Copy)]
struct Old {
    /// [ns] The newest stamp.
    newest: u64,
    /// [ns] When the other topic stepped back, in receive time.
    since: u64,
}

/// What a stamp says about the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It runs on.
    Onward,
    /// It runs on, but this sample must not be used.
    Refuse(Reason),
    /// It ran backwards, and this sample is from after that.
    Backward {
        /// By topic, whether the queue is from before.
        gone: [bool; TOPICS_MAX],
    },
}

impl Timeline {
    pub(super) fn new(config: &Config, max_age: Duration) -> Self {
        Self {
            tracks: vec![Track::default(); config.topics],
            slop: nanoseconds(config.slop),
            patience: nanoseconds(max_age),
            strict: matches!(config.policy, Policy::Adaptive { .. }),
        }
    }

    pub(super) fn retune(&mut self, config: &Config, max_age: Duration) {
        self.slop = nanoseconds(config.slop);
        self.patience = nanoseconds(max_age);
    }

    pub(super) fn judge(&mut self, topic: usize, stamp: Stamp, now: Stamp) -> Verdict {
        let (stamp, now) = (stamp.nanoseconds, now.nanoseconds);
        if self.is_straggler(topic, stamp, now) {
            return Verdict::Refuse(Reason::Reset);
        }

        let track = &mut self.tracks[topic];
        if track.old.take().is_some() {
            track.stepped = Some(now);
        }
        let lag = track.newest.unwrap_or(0).saturating_sub(stamp);
        if lag == 0 {
            track.newest = Some(stamp);
            track.behind = false;
            return Verdict::Onward;
        }
        track.stepped = Some(now);
        // A single sample may have been held up; two in a row mean that the clock itself is back.
        if self.slop < lag || track.behind {
            return self.turn_back(topic, stamp, lag, now);
        }
        if self.strict {
            track.behind = true;
            return Verdict::Refuse(Reason::OutOfOrder);
        }
        Verdict::Onward
    }

    /// Forgets every stamp.
    pub(super) fn forget(&mut self) {
        self.tracks.fill(Track::default());
    }

    /// Whether a sample is from before another topic's step back: it goes on where its own topic
    /// was, and ahead of all that has turned back. One that never does is believed in the end, and
    /// at once where the others have returned: then theirs was the false clock.
    fn is_straggler(&self, topic: usize, stamp: u64, now: u64) -> bool {
        let Some(old) = self.tracks[topic].old else { return false };
        let present = self.tracks.iter().filter_map(|track| track.newest).max();
        let follows = stamp < old.newest;
        let ahead = present.is_some_and(|present| {
            present < old.newest && present.saturating_add(self.slop) < stamp
        });
        !follows && ahead && now - old.since <= self.patience
    }

    /// The stepping topic starts afresh, and so do those that are ahead of it by more than the
    /// slop. The others are where it is now: if it was one absurd stamp, they lose nothing. And
    /// those that have just stepped back were merely faster.
    ///
    /// A step that is far longer than samples live cannot be mistaken for a sample's way: there,
    /// a topic may be ahead by as much, if it is served sooner.
    fn turn_back(&mut self, topic: usize, stamp: u64, lag: u64, now: u64) -> Verdict {
        let mut gone = [false; TOPICS_MAX];
        let is_far = self.patience.saturating_mul(2) < lag;
        let ahead_max = if is_far { self.slop.max(self.patience) } else { self.slop };
        let limit = stamp.saturating_add(ahead_max);
        let lately = now.saturating_sub(self.patience);
        for (track, gone) in self.tracks.iter_mut().zip(&mut gone) {
            let Some(newest) = track.newest else { continue };
            let was_faster = track.stepped.is_some_and(|stepped| lately <= stepped);
            if limit < newest && !was_faster {
                *track = Track { old: Some(Old { newest, since: now }), ..Track::default() };
                *gone = true;
            }
        }
        self.tracks[topic] = Track { newest: Some(stamp), stepped: Some(now), ..Track::default() };
        gone[topic] = true;
        Verdict::Backward { gone }
    }
}

//! Plays a recording as a camera: its frames arrive at their stamps.

use crate::system::LiveSystem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use stillpoint_imaging::{FrameSource, SourceError};

/// Maximum wait between two frames, s: after a longer gap, or when a clock was set, the next frame comes at once.
const LONGEST_GAP: f64 = 5.0;
const NAP: Duration = Duration::from_millis(50);

/// How playing a recording ended.
#[derive(Debug)]
pub enum Played {
    /// All frames were pushed.
    ToTheEnd,
    /// The user asked to stop.
    Stopped,
    /// The source failed permanently.
    SourceFailed(SourceError),
    /// Tracking panicked and takes no more frames.
    TrackingEnded,
}

struct Clock {
    anchor: Option<(Instant, f64)>,
    last: f64,
}

impl Clock {
    /// The moment at which a frame with this stamp arrives.
    fn due(&mut self, stamp: f64, now: Instant) -> Instant {
        let gap = stamp - self.last;
        self.last = stamp;
        if let Some((at, first)) = self.anchor
            && (0.0..=LONGEST_GAP).contains(&gap)
            && stamp >= first
        {
            return at + Duration::from_secs_f64(stamp - first);
        }
        self.anchor = Some((now, stamp));
        now
    }
}

impl LiveSystem {
    /// Plays a source: each frame is pushed when the time since the first one equals the difference of their stamps; frames of a camera
    /// ([`FrameSource::is_live`]) as they come. `skipped` is called with the error of unreadable frames. Ends with the source, or soon
    /// after `stop` was set; call [`LiveSystem::finish`] next.
    pub fn play(
        &mut self,
        source: &mut dyn FrameSource,
        stop: &AtomicBool,
        mut skipped: impl FnMut(SourceError),
    ) -> Played {
        let mut clock = Clock {
            anchor: None,
            last: f64::NAN,
        };
        loop {
            if stop.load(Ordering::Relaxed) {
                return Played::Stopped;
            }
            match source.next_frame() {
                None => return Played::ToTheEnd,
                Some(Err(e)) if e.recoverable => skipped(e),
                Some(Err(e)) => return Played::SourceFailed(e),
                Some(Ok(frame)) => {
                    let now = Instant::now();
                    let due = if source.is_live() {
                        now
                    } else {
                        clock.due(frame.stamp, now)
                    };
                    if !wait(due, stop) {
                        return Played::Stopped;
                    }
                    let told = self.tell_inertial(source.take_inertial())
                        && self.tell_odometry(source.take_odometry());
                    if !(told && self.push(frame)) {
                        return Played::TrackingEnded;
                    }
                }
            }
        }
    }
}

/// Waits for a moment. False if the user asked to stop.
fn wait(due: Instant, stop: &AtomicBool) -> bool {
    loop {
        let left = due.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return true;
        }
        if stop.load(Ordering::Relaxed) {
            return false;
        }
        std::thread::sleep(left.min(NAP));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_arrive_at_their_stamps_without_waiting_for_jumps() {
        let mut clock = Clock {
            anchor: None,
            last: f64::NAN,
        };
        let start = Instant::now();
        let after = |ms: u64| start + Duration::from_millis(ms);
        // Stamp, time of the query, and due time; ms after the start.
        for (stamp, now, due) in [
            (100.0, 0, 0),
            (100.25, 10, 250),
            (100.5, 700, 500),
            (100.75, 700, 750),
            // A gap that is too long, and a clock that jumps back.
            (200.0, 800, 800),
            (200.5, 900, 1300),
            (50.0, 1400, 1400),
            (50.25, 1500, 1650),
            (f64::NAN, 1700, 1700),
            (50.75, 1800, 1800),
        ] {
            assert_eq!(clock.due(stamp, after(now)), after(due), "{stamp}");
        }
    }
}

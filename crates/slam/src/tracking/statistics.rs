//! How often landmarks were expected, found and seen through since the last keyframe.

use super::sight::Sight;
use crate::association::Matches;
use crate::messages::LandmarkStatistic;
use std::collections::BTreeMap;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::LandmarkId;

/// Frames per second for which what a frame says was measured.
const RATE: f64 = 30.0;
/// What a frame says is at most this much, in frames of 30 Hz: after a gap it is still a single look.
const MOST: f64 = 3.0;

/// How much a frame says of what it shows, in frames of 30 Hz, from the time since the one before (s): twice as many looks at the same thing in the
/// same time do not prove twice as much. Rounded to halves, so that jitter does not count.
fn worth(seconds: Option<f64>) -> f32 {
    let frames = RATE * seconds.filter(|s| *s > 0.0).unwrap_or(1.0 / RATE);
    let rounded = if frames < 0.5 {
        frames
    } else {
        0.5 * libm::round(2.0 * frames)
    };
    rounded.min(MOST) as f32
}

/// How fast frames come, from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    last: Option<(FrameId, f64)>,
    /// Time between the last two frames, s.
    gap: Option<f64>,
    /// In frames of 30 Hz; 0 before the first frame.
    worth: f32,
}

impl Pace {
    /// Takes a frame, and tells its [`worth`]. A frame that was dropped makes the next one no better a look, so that the shorter of the last two gaps counts.
    pub(super) fn next(&mut self, frame: &RgbdFrame) -> f32 {
        let since = |(id, stamp): (FrameId, f64)| {
            (frame.stamp - stamp) / f64::from(frame.id.0.saturating_sub(id.0).max(1))
        };
        let gap = self.last.map(since).filter(|s| *s > 0.0);
        let shorter = match (gap, self.gap) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        self.last = Some((frame.id, frame.stamp));
        self.gap = gap;
        self.worth = worth(shorter);
        self.worth
    }

    /// Time that a frame stands for, s.
    pub(super) fn seconds(&self) -> f64 {
        f64::from(self.worth) / RATE
    }
}

/// Counts per landmark that was expected at least once.
#[derive(Debug, Default)]
pub(super) struct Statistics {
    counts: BTreeMap<LandmarkId, LandmarkStatistic>,
}

/// What was seen of landmarks in one frame, from a pose that may still be refused.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings(Vec<(LandmarkId, Seen)>);

/// What was seen of a landmark.
#[derive(Clone, Copy, Debug)]
enum Seen {
    Expected(Sight),
    Found,
}

impl Sightings {
    /// Notes how a landmark looked that was expected in the frame.
    pub(super) fn expected(&mut self, id: LandmarkId, sight: Sight) {
        self.0.push((id, Seen::Expected(sight)));
    }

    /// Notes the landmarks whose matches agree with the pose.
    pub(super) fn found(&mut self, matches: &Matches) {
        let ids = matches.targets.iter().flatten().filter_map(|t| t.landmark);
        self.0.extend(ids.map(|id| (id, Seen::Found)));
    }
}

impl Statistics {
    /// Counts what was seen from a pose that is taken, in a frame of this [`worth`].
    pub(super) fn count(&mut self, sightings: Sightings, worth: f32) {
        for (id, seen) in sightings.0 {
            let s = self.of(id);
            match seen {
                // Of the landmarks that look hidden most are wrong, at the edge of something near: they must prove themselves
                // like all others.
                Seen::Expected(Sight::Open | Sight::Hidden) => s.visible += 1,
                Seen::Expected(Sight::Through) => {
                    s.gone += 1;
                    s.gone_worth += worth;
                }
                Seen::Found => {
                    s.found += 1;
                    s.found_worth += worth;
                }
            }
        }
    }

    /// Hands over all counts, by id, and starts over.
    pub(super) fn take(&mut self) -> Vec<LandmarkStatistic> {
        std::mem::take(&mut self.counts).into_values().collect()
    }

    fn of(&mut self, id: LandmarkId) -> &mut LandmarkStatistic {
        self.counts.entry(id).or_insert(LandmarkStatistic {
            id,
            visible: 0,
            found: 0,
            gone: 0,
            found_worth: 0.0,
            gone_worth: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::{DepthImage, GrayImage};

    #[test]
    fn what_frames_say_counts_by_time() {
        for (seconds, expected) in [
            (None, 1.0),
            (Some(1.0 / 30.0), 1.0),
            (Some(0.0276), 1.0),
            (Some(0.0402), 1.0),
            (Some(1.0 / 15.0), 2.0),
            (Some(1.0 / 60.0), 0.5),
            (Some(1.0 / 120.0), 0.25),
            (Some(0.1), 3.0),
            (Some(10.0), 3.0),
            (Some(-1.0), 1.0),
            (Some(f64::NAN), 1.0),
        ] {
            assert!((worth(seconds) - expected).abs() < 1e-6, "{seconds:?}");
        }
        // A second of looking is a second, whatever the rate.
        for rate in [10.0, 15.0, 30.0, 60.0, 120.0, 200.0] {
            let mut statistics = Statistics::default();
            for _ in 0..rate as usize {
                let mut sightings = Sightings::default();
                sightings.expected(LandmarkId(1), Sight::Through);
                statistics.count(sightings, worth(Some(1.0 / rate)));
            }
            let seen = statistics.take()[0];
            assert_eq!(seen.gone, rate as u32);
            assert!((seen.gone_worth - 30.0).abs() < 1e-3, "{rate} Hz");
        }
    }

    #[test]
    fn a_dropped_frame_does_not_change_the_pace() {
        let worths = |frames: &[(u32, f64)]| -> Vec<f32> {
            let mut pace = Pace::default();
            let frame = |(id, stamp): (u32, f64)| RgbdFrame {
                id: FrameId(id),
                stamp,
                depth_stamp: stamp,
                gray: GrayImage::new(1, 1),
                colour: None,
                depth: DepthImage::default(),
            };
            frames.iter().map(|f| pace.next(&frame(*f))).collect()
        };
        let dt = 1.0 / 30.0;
        // Missing in the recording, and left out by a live run, which numbers what it leaves out.
        assert_eq!(
            worths(&[(0, 0.0), (1, dt), (2, 3.0 * dt), (3, 4.0 * dt)]),
            [1.0; 4]
        );
        assert_eq!(worths(&[(0, 0.0), (4, 4.0 * dt), (6, 6.0 * dt)]), [1.0; 3]);
        // Another pace is taken up with the second gap, and a clock that is set back says nothing.
        assert_eq!(
            worths(&[(0, 0.0), (1, dt), (2, 3.0 * dt), (3, 5.0 * dt)]),
            [1.0, 1.0, 1.0, 2.0]
        );
        assert_eq!(worths(&[(0, 9.0), (1, 1.0), (2, 1.1)]), [1.0, 1.0, 3.0]);
    }

    #[test]
    fn counts_are_by_landmark_and_start_over() {
        let mut statistics = Statistics::default();
        for (id, sight) in [
            (7, Sight::Open),
            (3, Sight::Through),
            (7, Sight::Hidden),
            (7, Sight::Through),
        ] {
            let mut sightings = Sightings::default();
            sightings.expected(LandmarkId(id), sight);
            statistics.count(sightings, 1.0);
        }
        let counts = |s: &LandmarkStatistic| (s.id.0, s.visible, s.found, s.gone);
        let taken: Vec<_> = statistics.take().iter().map(counts).collect();
        assert_eq!(taken, [(3, 0, 0, 1), (7, 2, 0, 1)]);
        assert!(statistics.take().is_empty());
    }
}

//! How fast frames come, and how much one of them says: what was measured at 30 Hz holds at any rate.

use stillpoint_imaging::{FrameId, RgbdFrame};

/// Frames per second for which what a frame says was measured.
pub(crate) const RATE: f64 = 30.0;
/// What a frame says is at most this much, in frames of 30 Hz: after a gap it is still a single look. Chosen: each frame of a camera of 10 Hz counts
/// in full.
const MOST: f64 = 3.0;

/// How much a frame says of what it shows, in frames of 30 Hz, from the time since the one before (s): twice as many looks at the same thing in the
/// same time do not prove twice as much. Rounded to halves, so that jitter does not count.
pub(crate) fn worth(seconds: Option<f64>) -> f32 {
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
pub(crate) struct Pace {
    last: Option<(FrameId, f64)>,
    /// Time between the last two frames, s.
    gap: Option<f64>,
    /// In frames of 30 Hz; 0 before the first frame.
    worth: f32,
}

impl Pace {
    /// Takes a frame. A frame that was dropped makes the next one no better a look, so that the shorter of the last two gaps counts.
    pub(crate) fn next(&mut self, frame: &RgbdFrame) {
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
    }

    /// The [`worth`] of the last frame.
    pub(crate) fn worth(&self) -> f32 {
        self.worth
    }

    /// Time that a frame stands for, s.
    pub(crate) fn seconds(&self) -> f64 {
        f64::from(self.worth) / RATE
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
            let worth = |f: &(u32, f64)| {
                pace.next(&frame(*f));
                pace.worth()
            };
            frames.iter().map(worth).collect()
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
}

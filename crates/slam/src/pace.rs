//! Weights frames by time, so that constants measured at 30 Hz hold at any frame rate.

use stillpoint_imaging::{FrameId, RgbdFrame};

/// Frame rate at which the weight of a frame was measured, Hz.
pub(crate) const RATE: f64 = 30.0;
/// Maximum weight of a frame, in frames of 30 Hz: after a gap it is still a single observation. Chosen: each frame of a
/// camera of 10 Hz counts in full.
const MOST: f64 = 3.0;

/// Weight of a frame as evidence, in frames of 30 Hz, from the time since the one before (s): twice the observations in
/// the same time are not twice the evidence. Rounded to halves to ignore jitter.
pub(crate) fn worth(seconds: Option<f64>) -> f32 {
    let frames = RATE * seconds.filter(|s| *s > 0.0).unwrap_or(1.0 / RATE);
    let rounded = if frames < 0.5 {
        frames
    } else {
        0.5 * libm::round(2.0 * frames)
    };
    rounded.min(MOST) as f32
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pace {
    last: Option<(FrameId, f64)>,
    /// Time between the last two frames, s.
    gap: Option<f64>,
    /// In frames of 30 Hz; 0 before the first frame.
    worth: f32,
}

impl Pace {
    /// Takes a frame. Uses the shorter of the last two gaps, so that a dropped frame does not raise the weight of the
    /// next.
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
    fn frame_weight_is_proportional_to_its_interval() {
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
    fn dropped_frame_keeps_the_frame_weight() {
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
        // Frames missing in the recording, and frames dropped (but numbered) in a live run.
        assert_eq!(
            worths(&[(0, 0.0), (1, dt), (2, 3.0 * dt), (3, 4.0 * dt)]),
            [1.0; 4]
        );
        assert_eq!(worths(&[(0, 0.0), (4, 4.0 * dt), (6, 6.0 * dt)]), [1.0; 3]);
        // A change of rate takes effect at the second gap; a clock set back has no effect.
        assert_eq!(
            worths(&[(0, 0.0), (1, dt), (2, 3.0 * dt), (3, 5.0 * dt)]),
            [1.0, 1.0, 1.0, 2.0]
        );
        assert_eq!(worths(&[(0, 9.0), (1, 1.0), (2, 1.1)]), [1.0, 1.0, 3.0]);
    }
}

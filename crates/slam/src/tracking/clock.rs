//! Recovers exposure times: sensors run at a steady rate, while stamps give times of arrival.
//!
//! USB polling delays frames: the stamps of a Kinect are 28, 32 and 40 ms apart in turn for frames of 33 ms. A velocity
//! from such an interval is off by a fifth, and with it rolling-shutter and depth-delay corrections. Stamps are
//! projected onto a straight line through the last ones, if they follow one. (docs/algorithm.md, the frames' clock.)

use std::collections::VecDeque;
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Maximum number of stamps in the line fit: 1.3 s at 30 Hz, so that its error is a third of a stamp's (2 / sqrt(n) at
/// the end of a line), and clock drift is negligible (decision 28).
const WINDOW: usize = 40;
/// Minimum number of stamps of a line: two make one, and the third tests it.
const LEAST: usize = 3;
/// Maximum deviation of stamps from the line for a steady sensor, share of the frame interval, rms. Chosen: the polled
/// stamps of decision 28 (28, 32 and 40 ms apart at 30 Hz) are off by 0.09.
const JITTER: f64 = 0.12;
/// Deviation of a single stamp at which a new line begins, share of the frame interval. It is about three times
/// [`JITTER`].
const BREAK: f64 = 0.35;
/// Deviation below which stamps are taken as exact, rms, s: chosen, as a turn of 150 deg/s moves the image by 0.3 px
/// meanwhile (f = 535 px).
const EXACT: f64 = 2e-4;
/// Gap in frames after which a new line begins, since its number of frames is uncertain. Chosen: a period that is wrong
/// by 3.5 % makes it wrong by [`BREAK`].
const GAP: f64 = 10.0;
/// Number of frames whose times are kept. Chosen: a first keyframe waits for one frame more (decision 43), and two are
/// to spare.
const REMEMBERED: usize = 4;

/// Exposure times of a frame's images, s, on the clock of the stamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Times {
    pub(super) colour: f64,
    pub(super) depth: f64,
}

/// The clocks of the colour camera and of the depth camera.
#[derive(Clone, Debug, Default)]
pub(super) struct FrameClock {
    colour: SensorClock,
    depth: SensorClock,
    newest: VecDeque<(FrameId, Times)>,
}

impl FrameClock {
    pub(super) fn take(&mut self, frame: &RgbdFrame) {
        let times = Times {
            colour: self.colour.take(frame.stamp),
            depth: self.depth.take(frame.depth_stamp),
        };
        self.newest.push_back((frame.id, times));
        if self.newest.len() > REMEMBERED {
            self.newest.pop_front();
        }
    }

    /// Exposure times of a recent frame; other frames return their stamps.
    pub(super) fn times(&self, frame: &RgbdFrame) -> Times {
        let found = self.newest.iter().rev().find(|(id, _)| *id == frame.id);
        found.map_or(
            Times {
                colour: frame.stamp,
                depth: frame.depth_stamp,
            },
            |(_, times)| *times,
        )
    }

    /// Exposure time of the newest frame's colour image, s.
    pub(super) fn now(&self) -> f64 {
        self.newest.back().map_or(0.0, |(_, times)| times.colour)
    }

    /// The clock for frames in reverse order, with stamps mirrored at `pivot`.
    pub(super) fn mirrored(&self, pivot: f64) -> Self {
        Self {
            colour: self.colour.mirrored(pivot),
            depth: self.depth.mirrored(pivot),
            newest: VecDeque::new(),
        }
    }
}

#[derive(Clone, Debug, Default)]
struct SensorClock {
    /// The newest stamps, s, with frame numbers since the start of the line; missing frames are skipped.
    stamps: VecDeque<(f64, f64)>,
    /// A line known in advance.
    known: Option<Line>,
    gaps: Vec<f64>,
}

/// `start + period n` for frame n, s, and the rms deviation of the stamps.
#[derive(Clone, Copy, Debug)]
struct Line {
    start: f64,
    period: f64,
    sigma: f64,
}

impl Line {
    fn is_steady(&self) -> bool {
        self.sigma <= JITTER * self.period
    }

    /// The time on this line for a stamp.
    fn nearest(&self, stamp: f64) -> f64 {
        if self.sigma < EXACT || !self.is_steady() {
            return stamp;
        }
        let n = libm::round((stamp - self.start) / self.period);
        let time = self.start + n * self.period;
        if (time - stamp).abs() > BREAK * self.period {
            return stamp;
        }
        time
    }
}

impl SensorClock {
    /// Exposure time of the image with this stamp.
    fn take(&mut self, stamp: f64) -> f64 {
        let number = self.number(stamp);
        if number == 0.0 {
            self.stamps.clear();
        }
        self.stamps.push_back((number, stamp));
        if self.stamps.len() > WINDOW {
            self.stamps.pop_front();
        }
        let line = match self.known {
            Some(known) => known,
            None => match self.line() {
                Some(line) => line,
                None => return stamp,
            },
        };
        if self.known.is_none()
            && (line.start + number * line.period - stamp).abs() > BREAK * line.period
        {
            // Restart the line with this stamp.
            self.stamps.clear();
            self.stamps.push_back((0.0, stamp));
            return stamp;
        }
        line.nearest(stamp)
    }

    /// Number of the frame with this stamp; 0 if a line begins.
    fn number(&mut self, stamp: f64) -> f64 {
        let Some(&(last, before)) = self.stamps.back() else {
            return 0.0;
        };
        let gap = stamp - before;
        let gaps = self.stamps.iter().zip(self.stamps.iter().skip(1));
        let gaps = gaps.map(|(a, b)| (b.1 - a.1) / (b.0 - a.0));
        self.gaps.clear();
        self.gaps.extend(gaps.chain([gap]));
        let gaps = &mut self.gaps;
        gaps.sort_unstable_by(f64::total_cmp);
        let frames = libm::round(gap / gaps[gaps.len() / 2]);
        if !(gap > 0.0 && frames <= GAP) {
            return 0.0;
        }
        last + frames.max(1.0)
    }

    /// The least-squares line; `None` with too few stamps.
    fn line(&self) -> Option<Line> {
        if self.stamps.len() < LEAST {
            return None;
        }
        let count = self.stamps.len() as f64;
        // Relative to the newest stamp, for precision.
        let (last, newest) = *self.stamps.back()?;
        let near = || self.stamps.iter().map(|(n, t)| (n - last, t - newest));
        let (mut n_sum, mut t_sum) = (0.0, 0.0);
        for (n, t) in near() {
            n_sum += n;
            t_sum += t;
        }
        let (n_mean, t_mean) = (n_sum / count, t_sum / count);
        let (mut nn, mut nt) = (0.0, 0.0);
        for (n, t) in near() {
            nn += (n - n_mean) * (n - n_mean);
            nt += (n - n_mean) * (t - t_mean);
        }
        let period = nt / nn;
        let off = near().map(|(n, t)| t - t_mean - period * (n - n_mean));
        let sum: f64 = off.map(|d| d * d).sum();
        Some(Line {
            start: newest + t_mean - period * (n_mean + last),
            period,
            // Two degrees of freedom went into the line.
            sigma: (sum / (count - 2.0)).sqrt(),
        })
    }

    fn mirrored(&self, pivot: f64) -> Self {
        let mirror = |line: Line| Line {
            start: 2.0 * pivot - line.start,
            ..line
        };
        Self {
            stamps: VecDeque::new(),
            known: self.known.or_else(|| self.line()).map(mirror),
            gaps: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests;

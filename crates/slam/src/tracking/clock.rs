//! When frames were taken: sensors run at a steady rate, and stamps say when a frame arrived.
//!
//! USB is asked for data every few milliseconds, and a frame waits for that: the stamps of a Kinect are 28, 32 and 40 ms apart in turn, where its
//! frames are 33. A velocity over such an interval is wrong by a fifth, and with it where a rolling shutter and a late depth image saw
//! things. Each stamp is brought to a straight line through the last ones; where they follow none, it is taken as it is. (docs/algorithm.md,
//! the frames' clock.)

use std::collections::VecDeque;
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Stamps through which the line is laid, at most: of 1.3 s at 30 Hz, so that what they err by is a third (2 / sqrt(n) at the end of a line), and
/// that clocks drift makes nothing (decision 28).
const WINDOW: usize = 40;
/// Fewer give no line, a number: two make one, and the third tells whether stamps lie on it.
const LEAST: usize = 3;
/// Stamps may be off the line by this share of the time between two frames, rms; who is farther off takes frames when he likes. Chosen: the polled
/// stamps of decision 28 (28, 32 and 40 ms apart at 30 Hz) are off by 0.09.
const JITTER: f64 = 0.12;
/// What is farther off than this share does not belong to the line: a new one begins. It is about three times [`JITTER`].
const BREAK: f64 = 0.35;
/// Stamps that are off by less, rms, are those of the sensor's own clock, s: chosen, as a turn of 150 deg/s moves the image by 0.3 px meanwhile
/// (f = 535 px).
const EXACT: f64 = 2e-4;
/// After a gap of so many frames a new line begins: nobody knows how many frames it was to one. Chosen: a period that is wrong by 3.5 % makes it
/// wrong by [`BREAK`].
const GAP: f64 = 10.0;
/// Frames whose times are remembered, a number: the newest and those before it that something is still asked of. Chosen: a first keyframe waits for
/// one frame more (decision 43), and two are to spare.
const REMEMBERED: usize = 4;

/// When the images of a frame were taken, s, on the clock of the stamps.
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
    /// Takes a frame.
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

    /// When a frame was taken: one of the newest, else as its stamps say.
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

    /// When the newest frame's colour image was taken, s.
    pub(super) fn now(&self) -> f64 {
        self.newest.back().map_or(0.0, |(_, times)| times.colour)
    }

    /// The clock of frames that come newest first, with stamps mirrored at `pivot`.
    pub(super) fn mirrored(&self, pivot: f64) -> Self {
        Self {
            colour: self.colour.mirrored(pivot),
            depth: self.depth.mirrored(pivot),
            newest: VecDeque::new(),
        }
    }
}

/// The clock of one sensor.
#[derive(Clone, Debug, Default)]
struct SensorClock {
    /// The newest stamps, s, with the number of the frame since the line began; of frames that are missing none.
    stamps: VecDeque<(f64, f64)>,
    /// The line that was known before the first of them.
    known: Option<Line>,
    /// Memory that is used again.
    gaps: Vec<f64>,
}

/// `start + period n` for frame n, s, and what the stamps are off it by, rms.
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

    /// The time that is meant by a stamp on this line.
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
    /// When the image with this stamp was taken.
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
            // Begins anew with this one.
            self.stamps.clear();
            self.stamps.push_back((0.0, stamp));
            return stamp;
        }
        line.nearest(stamp)
    }

    /// The number of the frame with this stamp; 0 where a line begins.
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

    /// The line of least squares; none of too few stamps.
    fn line(&self) -> Option<Line> {
        if self.stamps.len() < LEAST {
            return None;
        }
        let count = self.stamps.len() as f64;
        // About the newest stamp, for the sake of the digits.
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
            // Two of the stamps' numbers went into the line.
            sigma: (sum / (count - 2.0)).sqrt(),
        })
    }

    /// The same clock for stamps mirrored at `pivot`.
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

//! Detects frozen images: a stream that repeats an image with new stamps.
//!
//! A repeated depth or colour image is detected when it is identical to the previous one in every pixel while the other
//! image has changed. Sensors are noisy, so a repeated image indicates a frozen driver. Simulators may have no noise in
//! one or both images, so the other image must show real change. When both repeat, noise decides: with noise the stream
//! is frozen; without noise the camera is at rest or the stream was paused.

mod evidence;

use crate::{FrameId, RgbdFrame};
use evidence::{
    goes_on_as_before, has_changed, has_contrast, has_depth, has_edges, has_noise, steps,
};
use std::sync::Arc;

/// Depth has moved when its change since an image exceeds its change since the previous frame by this factor: noise
/// alone gives 1.
const GOES_ON: f32 = 1.3;

/// The repeated part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Still {
    /// The depth image: not a measurement of this frame.
    Depth,
    /// The colour image: not a new view.
    Colour,
    /// Both, with noise: the stream is frozen, and the frame is not a new view.
    Frame,
    /// Both, without noise: the camera is at rest, or the stream was paused.
    Rest,
}

/// A repeated image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standstill {
    /// The repeated part.
    pub what: Still,
    /// The frame whose image is repeated.
    pub since: FrameId,
    /// Number of repetitions, including this frame.
    pub frames: u32,
    /// Duration, s.
    pub seconds: f64,
}

impl Still {
    /// True when the frame contains no information on the camera's pose.
    #[must_use]
    pub fn is_no_view(self) -> bool {
        matches!(self, Self::Colour | Self::Frame)
    }

    /// Name for messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "the depth image",
            Self::Colour => "the colour image",
            Self::Frame | Self::Rest => "the whole frame",
        }
    }
}

/// E.g. `the depth image has stood still for 0.40 s (12 frames)`.
impl std::fmt::Display for Standstill {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let frames = if self.frames == 1 { "frame" } else { "frames" };
        write!(
            f,
            "{} has stood still for {:.2} s ({} {frames})",
            self.what.name(),
            self.seconds,
            self.frames
        )
    }
}

/// Watches a stream for repeated images. Costs a comparison that ends at the first different pixel; keeps two to four
/// frames.
#[derive(Clone, Debug, Default)]
pub struct StillWatch {
    before: Option<Arc<RgbdFrame>>,
    /// The frame before `before`.
    earlier: Option<Arc<RgbdFrame>>,
    depth: Repeats,
    colour: Repeats,
    /// Whether repeated depth, together with its colour image, has noise.
    noisy: Option<bool>,
}

#[derive(Clone, Debug, Default)]
struct Repeats {
    /// The first frame with this image; `None` if not repeated.
    first: Option<Arc<RgbdFrame>>,
    frames: u32,
    /// Whether the other image has shown that time passed.
    stale: bool,
}

impl Repeats {
    fn note(&mut self, repeats: bool, before: &Arc<RgbdFrame>) {
        if !repeats {
            *self = Self::default();
            return;
        }
        self.first.get_or_insert_with(|| Arc::clone(before));
        self.frames += 1;
    }

    fn standstill(&self, what: Still, frame: &RgbdFrame) -> Option<Standstill> {
        let first = self.first.as_ref()?;
        Some(Standstill {
            what,
            since: first.id,
            frames: self.frames,
            seconds: (frame.stamp - first.stamp).max(0.0),
        })
    }
}

impl StillWatch {
    /// Processes the next frame; returns its repeated part.
    pub fn look(&mut self, frame: &Arc<RgbdFrame>) -> Option<Standstill> {
        let before = self.before.replace(Arc::clone(frame))?;
        let earlier = self.earlier.replace(Arc::clone(&before));
        let same_depth = frame.depth.data() == before.depth.data() && has_depth(&frame.depth);
        let same_colour = frame.gray.data() == before.gray.data() && has_contrast(&frame.gray);
        self.depth.note(same_depth, &before);
        self.colour.note(same_colour, &before);
        if let Some(first) = &self.depth.first {
            let stale = self.depth.stale || {
                let changed = !same_colour && has_changed(&first.gray, &frame.gray);
                changed && (has_noise(&frame.depth) || has_edges(&frame.depth))
            };
            self.depth.stale = stale;
        }
        if let Some(first) = self.colour.first.as_ref().filter(|_| !same_depth) {
            self.colour.stale = self.colour.stale || {
                let [all, step] = steps([&first.depth, &before.depth, &frame.depth]);
                self.colour.frames > 1 && all > GOES_ON * step
                    || earlier.is_some_and(|earlier| goes_on_as_before(&earlier, &before, frame))
            };
        }
        let both = same_depth && same_colour;
        let noisy = both.then(|| self.noisy.unwrap_or_else(|| has_noise(&frame.depth)));
        self.noisy = noisy;
        match noisy {
            _ if self.depth.stale => self.depth.standstill(Still::Depth, frame),
            _ if self.colour.stale => self.colour.standstill(Still::Colour, frame),
            None => None,
            Some(noisy) => {
                let what = if noisy { Still::Frame } else { Still::Rest };
                // Both repeat since the later of their first frames.
                let fewer = self.depth.frames < self.colour.frames;
                let shorter = if fewer { &self.depth } else { &self.colour };
                shorter.standstill(what, frame)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DepthImage, GrayImage};

    const SIZE: (usize, usize) = (64, 48);

    /// Pseudo-random noise from -1 to 1.
    fn noise(seed: usize) -> f32 {
        let mixed = (seed as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed >> 40) % 2001) as f32 / 1000.0 - 1.0
    }

    /// A patterned wall, seen from `colour_at` and `depth_at` (steps of 1 px and of 1 %), with noise of `levels` and
    /// `share`.
    fn frame(
        id: u32,
        (colour_at, depth_at): (u32, u32),
        (levels, share): (f32, f32),
    ) -> Arc<RgbdFrame> {
        let (w, h) = SIZE;
        let pixel = |i: usize| {
            let x = i % w + colour_at as usize;
            let pattern = if (x / 5 + i / w / 5).is_multiple_of(2) {
                60.0
            } else {
                180.0
            };
            (pattern + levels * noise(i + 7919 * id as usize)) as u8
        };
        let z = |i: usize| {
            let wall = 2.0 + 0.02 * depth_at as f32;
            wall * (1.0 + share * noise(i + 104_729 * id as usize))
        };
        Arc::new(RgbdFrame {
            id: FrameId(id),
            stamp: f64::from(id) / 10.0,
            depth_stamp: f64::from(id) / 10.0,
            gray: GrayImage::from_vec(w, h, (0..w * h).map(pixel).collect()).unwrap(),
            colour: None,
            depth: DepthImage::from_vec(w, h, (0..w * h).map(z).collect()).unwrap(),
        })
    }

    /// Replaces the depth or grey image by that of another frame.
    fn with(
        frame: &RgbdFrame,
        depth: Option<&RgbdFrame>,
        gray: Option<&RgbdFrame>,
    ) -> Arc<RgbdFrame> {
        Arc::new(RgbdFrame {
            depth: depth.unwrap_or(frame).depth.clone(),
            gray: gray.unwrap_or(frame).gray.clone(),
            ..frame.clone()
        })
    }

    fn watched(frames: &[Arc<RgbdFrame>]) -> Vec<Option<Still>> {
        let mut watch = StillWatch::default();
        frames
            .iter()
            .map(|f| watch.look(f).map(|s| s.what))
            .collect()
    }

    fn moving() -> Vec<Arc<RgbdFrame>> {
        (0..12).map(|i| frame(i, (i, i), (3.0, 0.01))).collect()
    }

    #[test]
    fn repeated_depth_is_detected_until_fresh() {
        let mut frames = moving();
        assert_eq!(watched(&frames), [None; 12]);
        for i in 4..9 {
            frames[i] = with(&frames[i], Some(&frames[3].clone()), None);
        }
        let found = watched(&frames);
        for (i, what) in found.iter().enumerate() {
            assert_eq!(*what, (4..9).contains(&i).then_some(Still::Depth), "{i}");
        }
        let mut watch = StillWatch::default();
        let looks: Vec<_> = frames[..9].iter().map(|f| watch.look(f)).collect();
        let last = looks[8].unwrap();
        assert_eq!((last.since, last.frames), (FrameId(3), 5));
        assert_eq!(
            last.to_string(),
            "the depth image has stood still for 0.50 s (5 frames)"
        );
        // A repeated colour image in between does not validate the depth.
        frames[7] = with(&frames[7], None, Some(&frames[6].clone()));
        assert_eq!(watched(&frames)[7], Some(Still::Depth));
    }

    #[test]
    fn repeated_colour_image_is_detected() {
        let mut frames = moving();
        for i in 4..9 {
            frames[i] = with(&frames[i], None, Some(&frames[3].clone()));
        }
        let found = watched(&frames);
        for (i, what) in found.iter().enumerate() {
            assert_eq!(*what, (4..9).contains(&i).then_some(Still::Colour), "{i}");
        }
    }

    #[test]
    fn half_rate_colour_is_repeated_every_second_frame() {
        let frames = moving();
        let halved: Vec<_> = (0..12)
            .map(|i| with(&frames[i], None, Some(&frames[i - i % 2])))
            .collect();
        let found = watched(&halved);
        for (i, what) in found.iter().enumerate().skip(2) {
            assert_eq!(*what, (i % 2 == 1).then_some(Still::Colour), "{i}");
        }
    }

    #[test]
    fn noise_distinguishes_a_frozen_stream_from_rest() {
        for (share, expected) in [(0.01, Still::Frame), (0.0, Still::Rest)] {
            let mut frames: Vec<_> = (0..12).map(|i| frame(i, (i, i), (3.0, share))).collect();
            let third = frames[3].clone();
            for frame in &mut frames[4..9] {
                *frame = with(frame, Some(&third), Some(&third));
            }
            for (i, what) in watched(&frames).iter().enumerate() {
                assert_eq!(*what, (4..9).contains(&i).then_some(expected), "{i}");
            }
        }
    }

    #[test]
    fn noise_free_image_at_rest_is_not_frozen() {
        let still = |noise| (0..12).map(|i| frame(i, (0, 0), noise)).collect::<Vec<_>>();
        assert_eq!(watched(&still((4.0, 0.0))), [None; 12]);
        assert_eq!(watched(&still((0.0, 0.01))), [None; 12]);
    }

    #[test]
    fn equal_depth_of_a_plane_is_not_frozen() {
        let frames: Vec<_> = (0..12).map(|i| frame(i, (i, 0), (3.0, 0.0))).collect();
        assert_eq!(watched(&frames), [None; 12]);
    }

    #[test]
    fn blank_images_are_not_detected_as_repeated() {
        let blank = |i| {
            let (w, h) = SIZE;
            let frame = frame(i, (i, i), (3.0, 0.01));
            let depth = DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap();
            let covered = RgbdFrame {
                gray: GrayImage::new(w, h),
                ..RgbdFrame::clone(&frame)
            };
            [
                Arc::new(covered),
                Arc::new(RgbdFrame {
                    depth,
                    ..RgbdFrame::clone(&frame)
                }),
            ]
        };
        for k in 0..2 {
            let frames: Vec<_> = (0..6).map(|i| blank(i)[k].clone()).collect();
            assert_eq!(watched(&frames), [None; 6]);
        }
    }
}

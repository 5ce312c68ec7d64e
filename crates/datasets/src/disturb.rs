//! What happens to a camera in somebody's hands: a covered lens, a jump of the exposure.
//!
//! Answers: what a stream would have shown if its lens had been covered, or its exposure had jumped, for some of its frames.
//! Stamps, ids and the order of frames stay as they are, and so does the ground truth.

use crate::splice::AdaptorError;
use std::ops::Range;
use std::sync::Arc;
use stillpoint_imaging::{ColourImage, DepthImage, FrameSource, GrayImage, RgbdFrame, SourceError};

/// What is wrong with some frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    /// Images are zero everywhere, and so is depth.
    Black,
    /// A hand on the lens: dark images with a little noise (grey levels 2 to 6), no depth.
    Covered,
    /// Grey levels are multiplied by this, 0 or more, and clipped at 255; depth stays.
    Exposure(f64),
}

/// A stream with disturbances. Every frame is a pure function of the source's frame.
#[derive(Debug)]
pub struct Disturbed<S> {
    source: S,
    when: Vec<(Range<u32>, Disturbance)>,
}

impl<S: FrameSource> Disturbed<S> {
    /// Disturbs the frames whose ids are in a range (its end is not); where ranges overlap, in the order given.
    ///
    /// # Errors
    /// [`AdaptorError`] for a range without frames, or an exposure that is negative or not finite.
    pub fn new(source: S, when: Vec<(Range<u32>, Disturbance)>) -> Result<Self, AdaptorError> {
        for (ids, what) in &when {
            if ids.is_empty() {
                let found = format!("{} to before {}", ids.start, ids.end);
                return Err(AdaptorError::new("a range of frame ids", found));
            }
            if let Disturbance::Exposure(gain) = what
                && !(gain.is_finite() && *gain >= 0.0)
            {
                let expected = "a factor of exposure of 0 or more";
                return Err(AdaptorError::new(expected, format!("{gain}")));
            }
        }
        Ok(Self { source, when })
    }
}

impl<S: FrameSource> FrameSource for Disturbed<S> {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let item = self.source.next_frame()?;
        Some(item.map(|mut frame| {
            for (ids, what) in &self.when {
                if ids.contains(&frame.id.0) {
                    apply(*what, &mut frame);
                }
            }
            frame
        }))
    }

    fn remaining(&self) -> Option<usize> {
        self.source.remaining()
    }
}

fn apply(what: Disturbance, frame: &mut RgbdFrame) {
    let (w, h) = (frame.gray.width(), frame.gray.height());
    match what {
        Disturbance::Black => {
            frame.gray = GrayImage::new(w, h);
            frame.colour = frame.colour.take().map(|_| Arc::new(black_colour(w, h)));
            frame.depth = no_depth(w, h);
        }
        Disturbance::Covered => {
            for (i, v) in frame.gray.data_mut().iter_mut().enumerate() {
                *v = dark(frame.id.0, i);
            }
            let gray = frame.gray.data();
            let of = |_| colour_of(w, h, gray.iter().flat_map(|v| [*v; 3]).collect());
            frame.colour = frame.colour.take().map(of);
            frame.depth = no_depth(w, h);
        }
        Disturbance::Exposure(gain) => {
            // The cast rounds down and clips at 255.
            let table: Vec<u8> = (0..=255)
                .map(|v| (f64::from(v) * gain + 0.5) as u8)
                .collect();
            for v in frame.gray.data_mut() {
                *v = table[usize::from(*v)];
            }
            frame.colour = frame.colour.take().map(|colour| {
                let data = colour.data().iter().map(|v| table[usize::from(*v)]);
                colour_of(w, h, data.collect())
            });
        }
    }
}

/// A colour image without light.
pub(crate) fn black_colour(w: usize, h: usize) -> ColourImage {
    ColourImage::from_vec(w, h, vec![0; 3 * w * h]).unwrap_or_default()
}

/// A depth image without measurements.
pub(crate) fn no_depth(w: usize, h: usize) -> DepthImage {
    DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap_or_default()
}

fn colour_of(w: usize, h: usize, data: Vec<u8>) -> Arc<ColourImage> {
    Arc::new(ColourImage::from_vec(w, h, data).unwrap_or_default())
}

/// Grey level of a pixel behind a hand: 2 and four fair coins, by the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
fn dark(id: u32, pixel: usize) -> u8 {
    let mut z = (u64::from(id) << 32 | pixel as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    2 + ((z >> 60).count_ones()) as u8
}

//! Simulates disturbances of a camera: a covered lens, an exposure jump, blur, missing depth.
//!
//! Modifies the images of some frames. Stamps, ids and the order of frames stay unchanged, and so does the ground truth.

use crate::splice::AdaptorError;
use std::ops::Range;
use std::sync::Arc;
use stillpoint_imaging::{ColourImage, DepthImage, FrameSource, GrayImage, RgbdFrame, SourceError};

/// A disturbance of some frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    /// Black images without depth.
    Black,
    /// A hand on the lens: dark images with a little noise (grey levels 2 to 6), no depth.
    Covered,
    /// Grey levels are multiplied by this, 0 or more, and clipped at 255; depth stays.
    Exposure(f64),
    /// White images, as when looking into a lamp; depth stays.
    Saturated,
    /// Box blur with this radius, px; depth stays.
    Blurred(usize),
    /// No depth; images stay.
    NoDepth,
    /// No depth in the right half of the image; images stay.
    HalfDepth,
}

/// A stream with disturbances. Every frame is a pure function of the source's frame.
#[derive(Debug)]
pub struct Disturbed<S> {
    source: S,
    when: Vec<(Range<u32>, Disturbance)>,
}

impl<S: FrameSource> Disturbed<S> {
    /// Disturbs the frames with ids in the given ranges (end exclusive); overlapping ranges apply in order.
    ///
    /// # Errors
    /// [`AdaptorError`] for an empty range, or an exposure that is negative or not finite.
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
            map_levels(frame, |v| (f64::from(v) * gain + 0.5) as u8);
        }
        Disturbance::Saturated => map_levels(frame, |_| 255),
        Disturbance::Blurred(radius) => blur(frame, radius),
        Disturbance::NoDepth => frame.depth = no_depth(w, h),
        Disturbance::HalfDepth => {
            let mut data = frame.depth.data().to_vec();
            for row in data.chunks_exact_mut(w.max(1)) {
                row[w / 2..].fill(0.0);
            }
            frame.depth = DepthImage::from_vec(w, h, data).unwrap_or_default();
        }
    }
}

fn map_levels(frame: &mut RgbdFrame, to: impl Fn(u8) -> u8) {
    let (w, h) = (frame.gray.width(), frame.gray.height());
    let table: Vec<u8> = (0..=255).map(to).collect();
    for v in frame.gray.data_mut() {
        *v = table[usize::from(*v)];
    }
    frame.colour = frame.colour.take().map(|colour| {
        let data = colour.data().iter().map(|v| table[usize::from(*v)]);
        colour_of(w, h, data.collect())
    });
}

fn blur(frame: &mut RgbdFrame, radius: usize) {
    let (w, h) = (frame.gray.width(), frame.gray.height());
    if let Some(colour) = frame.colour.take() {
        let blurred = colour_of(w, h, means(colour.data(), [w, h], 3, radius));
        frame.gray = blurred.to_gray();
        frame.colour = Some(blurred);
    } else {
        let data = means(frame.gray.data(), [w, h], 1, radius);
        frame.gray.data_mut().copy_from_slice(&data);
    }
}

/// Box filter per channel, by summed area tables.
fn means(data: &[u8], [w, h]: [usize; 2], channels: usize, radius: usize) -> Vec<u8> {
    // Sums over everything left of and above each pixel corner.
    let stride = (w + 1) * channels;
    let mut sums = vec![0_u64; stride * (h + 1)];
    for y in 0..h {
        for i in 0..w * channels {
            let (above, below) = (y * stride + i, (y + 1) * stride + i);
            let own = u64::from(data[y * w * channels + i]);
            sums[below + channels] = own + sums[below] + sums[above + channels] - sums[above];
        }
    }
    let mut out = Vec::with_capacity(data.len());
    for y in 0..h {
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(h));
        for x in 0..w {
            let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(w));
            let count = ((bottom - top) * (right - left)) as u64;
            for c in 0..channels {
                let at = |x: usize, y: usize| sums[y * stride + x * channels + c];
                let sum = at(right, bottom) + at(left, top) - at(left, bottom) - at(right, top);
                out.push(((sum + count / 2) / count) as u8);
            }
        }
    }
    out
}

pub(crate) fn black_colour(w: usize, h: usize) -> ColourImage {
    ColourImage::from_vec(w, h, vec![0; 3 * w * h]).unwrap_or_default()
}

pub(crate) fn no_depth(w: usize, h: usize) -> DepthImage {
    DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap_or_default()
}

fn colour_of(w: usize, h: usize, data: Vec<u8>) -> Arc<ColourImage> {
    Arc::new(ColourImage::from_vec(w, h, data).unwrap_or_default())
}

/// Grey level of a pixel behind a hand: 2 plus four random bits, by the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
fn dark(id: u32, pixel: usize) -> u8 {
    let mut z = (u64::from(id) << 32 | pixel as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    2 + ((z >> 60).count_ones()) as u8
}

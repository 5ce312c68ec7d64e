//! Reduced images of frames, as WebP.

use crate::encode;
use stillpoint_imaging::RgbdFrame;

/// Minimum width of an image, px, if the camera's is at least that: faces and edges can be recognised, on dense screens too.
const WIDTH: usize = 320;
/// Quality of the first image, percent, chosen: WebP's artefacts are not seen from there on.
const BEST: u8 = 70;
/// The lowest quality, percent, chosen: faces and edges are still told apart.
const WORST: u8 = 10;
/// Average size of a report's image, bytes: 300 of them, as text, take 1.8 of the 3 MB that a page of as many frames may have.
const MEAN_BYTES: usize = 4400;
/// Effort of the encoder, 0 to 6: 2 takes half of the time of 4, for some 3 % more bytes.
const METHOD: i32 = 2;

/// Makes images, and adapts their quality to a mean size.
#[derive(Clone, Debug)]
pub(crate) struct Thumbnails {
    mean_bytes: usize,
    quality: u8,
    made: usize,
    bytes: usize,
}

impl Default for Thumbnails {
    fn default() -> Self {
        Self::new(MEAN_BYTES)
    }
}

impl Thumbnails {
    /// For images of this average size, bytes.
    pub(crate) fn new(mean_bytes: usize) -> Self {
        Self {
            mean_bytes,
            quality: BEST,
            made: 0,
            bytes: 0,
        }
    }

    pub(crate) fn size(&self, width: usize, height: usize) -> (usize, usize) {
        size(width, height, step(width))
    }

    /// A frame as WebP, in colour if available.
    pub(crate) fn make(&mut self, frame: &RgbdFrame) -> Vec<u8> {
        let (width, height, pixels) = match &frame.colour {
            Some(colour) => {
                let (w, h) = (colour.width(), colour.height());
                reduced::<3>(colour.data(), w, h, step(w))
            }
            None => {
                let (w, h) = (frame.gray.width(), frame.gray.height());
                let (w, h, small) = reduced::<1>(frame.gray.data(), w, h, step(w));
                (w, h, small.into_iter().flat_map(|v| [v; 3]).collect())
            }
        };
        // The size matches the pixels, so this does not fail.
        let webp = encode::webp(&pixels, (width, height), (self.quality, METHOD));
        let webp = webp.unwrap_or_default();
        self.made += 1;
        self.bytes += webp.len();
        if self.bytes > self.made * self.mean_bytes {
            self.quality = self.quality.saturating_sub(3).max(WORST);
        } else if self.bytes < self.made * (self.mean_bytes - self.mean_bytes / 8) {
            self.quality = (self.quality + 1).min(BEST);
        }
        webp
    }
}

/// Number of camera pixels along each side of a pixel.
fn step(width: usize) -> usize {
    (width / WIDTH).max(1)
}

fn size(width: usize, height: usize, step: usize) -> (usize, usize) {
    ((width / step).max(1), (height / step).max(1))
}

/// The mean of every square of pixels.
fn reduced<const N: usize>(
    data: &[u8],
    width: usize,
    height: usize,
    step: usize,
) -> (usize, usize, Vec<u8>) {
    let (w, h) = size(width, height, step);
    let mut small = vec![0; w * h * N];
    // Summing whole rows first is fast.
    let mut columns = vec![0_u32; w * step * N];
    for (y, out) in small.chunks_exact_mut(w * N).enumerate() {
        columns.fill(0);
        let rows = y * step..((y + 1) * step).min(height);
        let count = (rows.len() * step) as u32;
        for row in rows {
            let row = &data[row * width * N..][..w * step * N];
            for (sum, value) in columns.iter_mut().zip(row) {
                *sum += u32::from(*value);
            }
        }
        for (out, columns) in out.chunks_exact_mut(N).zip(columns.chunks_exact(step * N)) {
            for (channel, out) in out.iter_mut().enumerate() {
                let sums = columns[channel..].iter().step_by(N);
                *out = (sums.sum::<u32>() / count) as u8;
            }
        }
    }
    (w, h, small)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stillpoint_imaging::{ColourImage, DepthImage, FrameId, GrayImage};

    fn frame(width: usize, height: usize, colour: bool) -> RgbdFrame {
        let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 7) as u8;
        let pixels = (0..3 * width * height).map(noise).collect();
        let colours = ColourImage::from_vec(width, height, pixels).unwrap();
        RgbdFrame {
            id: FrameId(0),
            stamp: 0.0,
            depth_stamp: 0.0,
            gray: GrayImage::new(width, height),
            colour: colour.then(|| Arc::new(colours)),
            depth: DepthImage::from_vec(width, height, vec![0.0; width * height]).unwrap(),
        }
    }

    #[test]
    fn every_image_size_has_a_thumbnail() {
        for (w, h, expected) in [
            (640, 480, (320, 240)),
            (192, 10, (192, 10)),
            (1, 1, (1, 1)),
            (848, 480, (424, 240)),
            (1281, 2, (320, 1)),
        ] {
            assert_eq!(Thumbnails::default().size(w, h), expected);
            for colour in [true, false] {
                let webp = Thumbnails::default().make(&frame(w, h, colour));
                let read = image::load_from_memory(&webp).unwrap();
                assert_eq!((read.width() as usize, read.height() as usize), expected);
            }
        }
    }

    #[test]
    fn thumbnail_pixels_are_block_means() {
        let data: Vec<u8> = (0..8 * 2).map(|i| i * 10).collect();
        assert_eq!(reduced::<1>(&data, 8, 2, 1), (8, 2, data.clone()));
        let wide: Vec<u8> = (0..400 * 2)
            .map(|i| if i % 400 < 200 { 10 } else { 30 })
            .collect();
        let (w, h, small) = reduced::<1>(&wide, 400, 2, 3);
        // Three columns each; the last one is left out.
        assert_eq!((w, h), (133, 1));
        assert_eq!((small[0], small[66], small[132]), (10, 16, 30));
    }

    #[test]
    fn quality_falls_for_hard_images() {
        let (mut thumbnails, frame) = (Thumbnails::default(), frame(160, 120, true));
        let sizes: Vec<usize> = (0..40).map(|_| thumbnails.make(&frame).len()).collect();
        assert!(sizes[39] < sizes[0], "{sizes:?}");
        assert!(thumbnails.quality < BEST);
    }
}

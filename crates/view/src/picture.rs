//! An RGB image with basic drawing operations.

use crate::Colour;
use stillpoint_imaging::{ColourImage, GrayImage, RgbdFrame};

/// An RGB image of `height` x `width`. Drawing is clipped to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl Picture {
    /// An image of one colour.
    ///
    /// # Panics
    /// Sizes beyond the available memory.
    #[must_use]
    pub fn new(width: usize, height: usize, colour: Colour) -> Self {
        // Saturates on overflow, so that an oversized allocation fails instead of being too small.
        let data = [colour.0, colour.1, colour.2].repeat(width.saturating_mul(height));
        Self {
            width,
            height,
            data,
        }
    }

    /// The colour image of a frame, else its grey one.
    #[must_use]
    pub(crate) fn from_frame(frame: &RgbdFrame) -> Self {
        match &frame.colour {
            Some(colour) => Self::from_colour(colour),
            None => Self::from_gray(&frame.gray),
        }
    }

    #[must_use]
    pub(crate) fn from_colour(image: &ColourImage) -> Self {
        Self {
            width: image.width(),
            height: image.height(),
            data: image.data().to_vec(),
        }
    }

    /// A copy of a grey image.
    #[must_use]
    pub fn from_gray(image: &GrayImage) -> Self {
        Self {
            width: image.width(),
            height: image.height(),
            data: image.data().iter().flat_map(|&v| [v, v, v]).collect(),
        }
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, interleaved RGB, row by row.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// One pixel; `None` outside.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> Option<Colour> {
        let i = self.index(x as i64, y as i64)?;
        Some(Colour(self.data[i], self.data[i + 1], self.data[i + 2]))
    }

    /// The mean of every 2 x 2 pixels; an odd last row or column is dropped. An image of one pixel in either direction becomes empty.
    #[must_use]
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut data = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            for x in 0..width {
                let first = 3 * (2 * y * self.width + 2 * x);
                for c in first..first + 3 {
                    let below = c + 3 * self.width;
                    let sum = [c, c + 3, below, below + 3]
                        .iter()
                        .map(|&i| u16::from(self.data[i]))
                        .sum::<u16>();
                    data.push(((sum + 2) / 4) as u8);
                }
            }
        }
        Self {
            width,
            height,
            data,
        }
    }

    /// Resizes by area averaging.
    #[must_use]
    pub fn scaled(&self, width: usize, height: usize) -> Self {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let rows = shares(self.height, height);
        let mut data = Vec::with_capacity(3 * width * height);
        // Separable: first along one direction, then along the other.
        let columns = shares(self.width, width);
        for (y, row) in &rows {
            let mut sums = vec![0.0f32; 3 * self.width];
            for (share, line) in row.iter().zip(*y..) {
                let line = &self.data[3 * line * self.width..][..3 * self.width];
                for (sum, v) in sums.iter_mut().zip(line) {
                    *sum += share * f32::from(*v);
                }
            }
            for (x, column) in &columns {
                for c in 0..3 {
                    let values = column.iter().zip(*x..);
                    let sum: f32 = values.map(|(share, x)| share * sums[3 * x + c]).sum();
                    data.push((sum + 0.5) as u8);
                }
            }
        }
        Self {
            width,
            height,
            data,
        }
    }

    fn index(&self, x: i64, y: i64) -> Option<usize> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        (x < self.width && y < self.height).then_some(3 * (y * self.width + x))
    }

    /// Blends a colour into a pixel, with opacity `coverage` from 0 to 1.
    pub(crate) fn blend(&mut self, x: i64, y: i64, colour: Colour, coverage: f32) {
        let Some(i) = self.index(x, y) else { return };
        for (old, new) in self.data[i..i + 3]
            .iter_mut()
            .zip([colour.0, colour.1, colour.2])
        {
            *old = mixed(*old, new, coverage);
        }
    }

    /// Table of [`Self::blend`]'s results for every value of each channel, for [`Self::replace`].
    pub(crate) fn mixed_with(colour: Colour, coverage: f32) -> [[u8; 256]; 3] {
        [colour.0, colour.1, colour.2]
            .map(|new| std::array::from_fn(|old| mixed(old as u8, new, coverage)))
    }

    /// Replaces the channels of a pixel by their entries in a table. The pixel must be inside.
    pub(crate) fn replace(&mut self, x: usize, y: usize, by: &[[u8; 256]; 3]) {
        let i = 3 * (y * self.width + x);
        for (value, by) in self.data[i..i + 3].iter_mut().zip(by) {
            *value = by[usize::from(*value)];
        }
    }

    /// Fills the pixels from `(x0, y0)` up to and excluding `(x1, y1)`.
    pub(crate) fn fill(
        &mut self,
        (x0, y0): (i64, i64),
        (x1, y1): (i64, i64),
        colour: Colour,
        coverage: f32,
    ) {
        // Clip first: the corners may be anywhere.
        let cut = |v: i64, end: usize| v.clamp(0, end as i64);
        for y in cut(y0, self.height)..cut(y1, self.height) {
            for x in cut(x0, self.width)..cut(x1, self.width) {
                self.blend(x, y, colour, coverage);
            }
        }
    }

    /// Copies an image into this one, with its first pixel at `(x, y)`.
    pub(crate) fn paste(&mut self, other: &Self, x: usize, y: usize) {
        let columns = other.width.min(self.width.saturating_sub(x));
        if columns == 0 {
            return;
        }
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = 3 * row * other.width;
            let to = 3 * ((y + row) * self.width + x);
            self.data[to..to + 3 * columns].copy_from_slice(&other.data[from..from + 3 * columns]);
        }
    }

    /// Adds a strip of one colour below.
    pub(crate) fn with_strip(mut self, height: usize, colour: Colour) -> Self {
        for _ in 0..height * self.width {
            self.data.extend([colour.0, colour.1, colour.2]);
        }
        self.height += height;
        self
    }
}

fn mixed(old: u8, new: u8, coverage: f32) -> u8 {
    let (old, new) = (f32::from(old), f32::from(new));
    (old + coverage.clamp(0.0, 1.0) * (new - old) + 0.5) as u8
}

/// For each of `to` pixels that cover `from`: the first source pixel, and the shares of it and its successors.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to.max(1) as f64;
    let pixel = |i: usize| {
        let (low, high) = (step * i as f64, step * (i + 1) as f64);
        let first = (low as usize).min(from.saturating_sub(1));
        let last = (high.ceil() as usize).clamp(first + 1, from.max(first + 1));
        let share = |p: usize| ((p + 1) as f64).min(high) - (p as f64).max(low);
        let shares = (first..last.min(from)).map(|p| (share(p).max(0.0) / step) as f32);
        (first, shares.collect())
    };
    (0..to).map(pixel).collect()
}

impl From<Picture> for ColourImage {
    fn from(picture: Picture) -> Self {
        // The data of an image always match its size.
        Self::from_vec(picture.width, picture.height, picture.data).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halved_pixels_are_means() {
        let mut p = Picture::new(5, 3, Colour::BLACK);
        p.fill((0, 0), (1, 2), Colour::WHITE, 1.0);
        let half = p.halved();
        assert_eq!((half.width(), half.height()), (2, 1));
        assert_eq!(half.at(0, 0), Some(Colour(128, 128, 128)));
        assert_eq!(half.at(1, 0), Some(Colour::BLACK));
        assert_eq!(half.at(2, 0), None);
    }

    #[test]
    fn scaled_pixels_are_means_of_areas() {
        let mut p = Picture::new(6, 3, Colour(100, 100, 100));
        p.fill((0, 0), (3, 3), Colour(200, 0, 100), 1.0);
        let third = p.scaled(2, 1);
        assert_eq!(third.at(0, 0), Some(Colour(200, 0, 100)));
        assert_eq!(third.at(1, 0), Some(Colour(100, 100, 100)));
        // The middle pixel covers a half of each.
        assert_eq!(p.scaled(3, 2).at(1, 1), Some(Colour(150, 50, 100)));
        let large = p.scaled(12, 7);
        assert_eq!((large.width(), large.height()), (12, 7));
        assert_eq!(large.at(11, 6), Some(Colour(100, 100, 100)));
        assert_eq!(
            Picture::new(7, 5, Colour::RIGID).scaled(3, 4).at(2, 3),
            Some(Colour::RIGID)
        );
        assert_eq!(
            Picture::new(0, 0, Colour::RIGID).scaled(2, 2).data(),
            [0; 12]
        );
    }

    #[test]
    fn drawing_outside_the_picture_is_clipped() {
        let mut p = Picture::new(4, 4, Colour::BLACK);
        p.fill((i64::MIN, i64::MIN), (-1, i64::MAX), Colour::WHITE, 1.0);
        p.blend(4, 0, Colour::WHITE, 1.0);
        p.blend(0, -1, Colour::WHITE, 1.0);
        assert_eq!(p, Picture::new(4, 4, Colour::BLACK));
        p.paste(&Picture::new(9, 9, Colour::WHITE), 3, 3);
        assert_eq!(p.at(3, 3), Some(Colour::WHITE));
        assert_eq!(p.at(2, 3), Some(Colour::BLACK));
        p.paste(&Picture::new(9, 9, Colour::STATIC), 7, 0);
        assert_eq!(p.at(3, 0), Some(Colour::BLACK));
    }

    #[test]
    fn picture_converts_to_a_colour_image() {
        let gray = GrayImage::from_vec(2, 1, vec![7, 200]).unwrap();
        let image = ColourImage::from(Picture::from_gray(&gray));
        assert_eq!(image.at(1, 0), [200, 200, 200]);
        assert_eq!(Picture::from_colour(&image).at(0, 0), Some(Colour(7, 7, 7)));
    }
}

//! An image brought to a network's input size: scaled to fit, at the top left, padded.

use stillpoint_imaging::ColourImage;

/// Value of the pixels beside the image, as in YOLOX's training.
const PADDING: f32 = 114.0;

/// Scales images to fit a network's input, bilinearly with half-pixel centres and no filter against aliasing: output pixel
/// `i` takes its value at `(i + 0.5) * size / scaled_size - 0.5`, clamped to the image, and stays unrounded. The crate
/// `image` has no such resize, since its filters widen when they shrink.
pub(crate) struct Letterbox {
    width: usize,
    height: usize,
    /// Size of the images that the columns and rows are for.
    source: (usize, usize),
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    /// Planes B, G, R of `height` x `width`, 0 to 255.
    data: Vec<f32>,
}

/// Between which two source pixels an output pixel lies, and how far from the first, 0 to 1.
#[derive(Clone, Copy)]
struct Tap {
    low: usize,
    high: usize,
    share: f32,
}

impl Letterbox {
    /// For a network's input of this size, px.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            source: (0, 0),
            columns: Vec::new(),
            rows: Vec::new(),
            data: vec![PADDING; 3 * width * height],
        }
    }

    /// The network's input for an image: planes B, G, R. The image must have pixels.
    pub(crate) fn fill(&mut self, image: &ColourImage) -> &[f32] {
        let size = (image.width(), image.height());
        if self.source != size {
            self.prepare(size);
        }
        let plane = self.width * self.height;
        let stride = 3 * image.width();
        let (blue, rest) = self.data.split_at_mut(plane);
        let (green, red) = rest.split_at_mut(plane);
        for (y, row) in self.rows.iter().enumerate() {
            let low = &image.data()[row.low * stride..][..stride];
            let high = &image.data()[row.high * stride..][..stride];
            let at = y * self.width..y * self.width + self.columns.len();
            let outputs = blue[at.clone()]
                .iter_mut()
                .zip(&mut green[at.clone()])
                .zip(&mut red[at]);
            for (column, ((b, g), r)) in self.columns.iter().zip(outputs) {
                let value = |channel| mix(low, high, column, row.share, channel);
                (*r, *g, *b) = (value(0), value(1), value(2));
            }
        }
        &self.data
    }

    /// Pixels of the image per pixel of the network's input, in x and y. Of the image last filled in.
    pub(crate) fn scale(&self) -> (f64, f64) {
        let ratio = |size: usize, taps: &[Tap]| size as f64 / taps.len().max(1) as f64;
        (
            ratio(self.source.0, &self.columns),
            ratio(self.source.1, &self.rows),
        )
    }

    fn prepare(&mut self, (width, height): (usize, usize)) {
        // The tighter side fills the input exactly; the other is rounded down, as YOLOX does, in integers.
        let (scaled_width, scaled_height) = if self.width * height <= self.height * width {
            (self.width, (height * self.width / width).max(1))
        } else {
            ((width * self.height / height).max(1), self.height)
        };
        self.columns = taps(width, scaled_width);
        self.rows = taps(height, scaled_height);
        self.source = (width, height);
        self.data.fill(PADDING);
    }
}

fn taps(size: usize, scaled: usize) -> Vec<Tap> {
    let step = size as f64 / scaled as f64;
    let last = size - 1;
    (0..scaled)
        .map(|i| {
            let at = ((i as f64 + 0.5) * step - 0.5).clamp(0.0, last as f64);
            let low = at as usize;
            Tap {
                low,
                high: (low + 1).min(last),
                share: (at - low as f64) as f32,
            }
        })
        .collect()
}

/// The bilinear value of one channel: first along both rows, then between them.
#[inline]
fn mix(low: &[u8], high: &[u8], column: &Tap, share: f32, channel: usize) -> f32 {
    let along = |row: &[u8]| {
        let a = f32::from(row[3 * column.low + channel]);
        let b = f32::from(row[3 * column.high + channel]);
        a + (b - a) * column.share
    };
    let (top, bottom) = (along(low), along(high));
    top + (bottom - top) * share
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 3]) -> ColourImage {
        let data = (0..width * height)
            .flat_map(|i| pixel(i % width, i / width))
            .collect();
        ColourImage::from_vec(width, height, data).unwrap()
    }

    #[test]
    fn an_image_of_the_input_size_is_copied_into_planes() {
        let source = image(4, 3, |x, y| [x as u8, 10 * y as u8, 200]);
        let mut letterbox = Letterbox::new(4, 3);
        let planes = letterbox.fill(&source).to_vec();
        for i in 0..12 {
            assert_eq!(
                [planes[i], planes[12 + i], planes[24 + i]],
                [200.0, 10.0 * (i / 4) as f32, (i % 4) as f32]
            );
        }
        assert_eq!(letterbox.scale(), (1.0, 1.0));
    }

    /// A ramp stays a ramp: an output pixel's centre lies at `(i + 0.5) * 2 - 0.5` of the source.
    #[test]
    fn halving_takes_values_between_pixels() {
        let source = image(16, 8, |x, y| [10 * x as u8, 20 * y as u8, 0]);
        let mut letterbox = Letterbox::new(8, 8);
        let planes = letterbox.fill(&source).to_vec();
        for (y, x) in (0..4).flat_map(|y| (0..8).map(move |x| (y, x))) {
            let i = 8 * y + x;
            assert_eq!(
                planes[128 + i],
                10.0 * (2.0 * x as f32 + 0.5),
                "red at {x}, {y}"
            );
            assert_eq!(
                planes[64 + i],
                20.0 * (2.0 * y as f32 + 0.5),
                "green at {x}, {y}"
            );
        }
        assert!(
            planes[32..64].iter().all(|&v| v == PADDING),
            "the lower half is padding"
        );
        assert_eq!(letterbox.scale(), (2.0, 2.0));
    }

    #[test]
    fn enlarging_clamps_at_the_border() {
        let source = image(2, 2, |x, _| [100 * x as u8; 3]);
        let mut letterbox = Letterbox::new(4, 4);
        assert_eq!(letterbox.fill(&source)[..4], [0.0, 25.0, 75.0, 100.0]);
    }

    /// The padding of a wide image must not stay in a tall one that follows, nor the other way round.
    #[test]
    fn images_of_another_size_leave_no_traces() {
        let wide = image(8, 4, |_, _| [9; 3]);
        let tall = image(4, 8, |_, _| [7; 3]);
        let mut letterbox = Letterbox::new(8, 8);
        letterbox.fill(&wide);
        let second = letterbox.fill(&tall).to_vec();
        assert_eq!(second, Letterbox::new(8, 8).fill(&tall));
        assert_eq!(second.iter().filter(|&&v| v == 7.0).count(), 3 * 32);
    }
}

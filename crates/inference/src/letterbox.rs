//! Fits an image to a network's input: scaled, padded, split into channels and normalised.

use super::card::{CardInput, ColourOrder, Resize};
use super::size::Size;
use stillpoint_imaging::ColourImage;

/// Scales images to a network's input, bilinearly with half-pixel centres and no filter against aliasing: output pixel `i` samples `(i +
/// 0.5) * size / scaled_size - 0.5`, clamped to the image, and is not rounded. The crate `image` has no such resize, since its filters
/// widen when they shrink.
#[derive(Default)]
pub(super) struct Letterbox {
    /// Image and input size of the columns, rows and padding.
    made_for: Option<(Size, Size)>,
    placement: Placement,
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    /// One interpolated image row, interleaved.
    line: Vec<f32>,
    data: Vec<f32>,
}

/// Position of an image in a network's input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Placement {
    /// First column and row of the input that hold the image, px.
    pub(super) offset: [usize; 2],
    /// Pixels of the image per pixel of the input, in x and y.
    pub(super) scale: [f64; 2],
}

/// The two source pixels around an output pixel, and the weight of the second, 0 to 1.
#[derive(Clone, Copy)]
struct Tap {
    low: usize,
    high: usize,
    share: f32,
}

impl Letterbox {
    /// The network's input of this size for an image: three planes. The image must have pixels, and the card must be the same in all calls.
    pub(super) fn fill(&mut self, image: &ColourImage, card: &CardInput, size: Size) -> &[f32] {
        let source = Size {
            width: image.width(),
            height: image.height(),
        };
        if self.made_for != Some((source, size)) {
            self.prepare(source, card, size);
        }
        let norm = Norm::of(card);
        let unscaled = self.placement.scale == [1.0, 1.0];
        let [x, y] = self.placement.offset;
        let (first, rest) = self.data.split_at_mut(size.width * size.height);
        let (second, third) = rest.split_at_mut(size.width * size.height);
        for (i, row) in self.rows.iter().enumerate() {
            let begin = (y + i) * size.width + x;
            let at = begin..begin + self.columns.len();
            let planes = [
                &mut first[at.clone()],
                &mut second[at.clone()],
                &mut third[at],
            ];
            if unscaled {
                let pixels = &image.data()[3 * image.width() * i..][..3 * image.width()];
                match card.colour {
                    ColourOrder::Rgb => straight::<0, 2>(pixels, &norm, planes),
                    ColourOrder::Bgr => straight::<2, 0>(pixels, &norm, planes),
                }
                continue;
            }
            between(image, row, &mut self.line);
            match card.colour {
                ColourOrder::Rgb => across::<0, 2>(&self.line, &self.columns, &norm, planes),
                ColourOrder::Bgr => across::<2, 0>(&self.line, &self.columns, &norm, planes),
            }
        }
        &self.data
    }

    pub(super) fn placement(&self) -> Placement {
        self.placement
    }

    fn prepare(&mut self, source: Size, card: &CardInput, size: Size) {
        let scaled = match card.resize {
            Resize::Stretch => size,
            Resize::TopLeft | Resize::Centre => inside(source, size),
        };
        let offset = match card.resize {
            Resize::Centre => [
                (size.width - scaled.width) / 2,
                (size.height - scaled.height) / 2,
            ],
            Resize::TopLeft | Resize::Stretch => [0, 0],
        };
        self.placement = Placement {
            offset,
            scale: [
                source.width as f64 / scaled.width as f64,
                source.height as f64 / scaled.height as f64,
            ],
        };
        self.columns = taps(source.width, scaled.width);
        self.rows = taps(source.height, scaled.height);
        self.line = vec![0.0; 3 * source.width];
        self.data = plain(card, size);
        self.made_for = Some((source, size));
    }
}

pub(super) fn plain(card: &CardInput, size: Size) -> Vec<f32> {
    let norm = Norm::of(card);
    let plane = size.width * size.height;
    let values = [0, 1, 2].map(|c| norm.apply(card.padding, c));
    values
        .iter()
        .flat_map(|&v| std::iter::repeat_n(v, plane))
        .collect()
}

/// Normalisation of values of 0 to 255, by channel.
struct Norm {
    mean: [f32; 3],
    factor: [f32; 3],
}

impl Norm {
    fn of(card: &CardInput) -> Self {
        Self {
            mean: card.mean,
            factor: card.std.map(|s| 1.0 / s),
        }
    }

    #[inline]
    fn apply(&self, value: f32, channel: usize) -> f32 {
        (value - self.mean[channel]) * self.factor[channel]
    }
}

/// Size of an image scaled to fit: the tighter side fills the input, the other is rounded down, as YOLOX does, in integers.
fn inside(source: Size, size: Size) -> Size {
    if size.width * source.height <= size.height * source.width {
        Size {
            width: size.width,
            height: (source.height * size.width / source.width).max(1),
        }
    } else {
        Size {
            width: (source.width * size.height / source.height).max(1),
            height: size.height,
        }
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

/// The pixels of an output row from a row of an unscaled image; equal to [`between`] and [`across`], but faster. Otherwise a network at the
/// camera's own size would wait longest for its input.
fn straight<const FIRST: usize, const LAST: usize>(
    row: &[u8],
    norm: &Norm,
    [first, second, third]: [&mut [f32]; 3],
) {
    let (pixels, _) = row.as_chunks::<3>();
    for (plane, (channel, out)) in [(FIRST, first), (1, second), (LAST, third)]
        .into_iter()
        .enumerate()
    {
        for (pixel, value) in pixels.iter().zip(out) {
            *value = norm.apply(f32::from(pixel[channel]), plane);
        }
    }
}

/// The line between two rows of an image: contiguous, so that the compiler vectorises it.
fn between(image: &ColourImage, row: &Tap, line: &mut [f32]) {
    let stride = 3 * image.width();
    let low = &image.data()[row.low * stride..][..stride];
    let high = &image.data()[row.high * stride..][..stride];
    for ((out, &a), &b) in line.iter_mut().zip(low).zip(high) {
        let (a, b) = (f32::from(a), f32::from(b));
        *out = a + (b - a) * row.share;
    }
}

/// The pixels of an output row from a line: channel `FIRST` goes into the first plane, green into the second, `LAST` into the third.
fn across<const FIRST: usize, const LAST: usize>(
    line: &[f32],
    columns: &[Tap],
    norm: &Norm,
    [first, second, third]: [&mut [f32]; 3],
) {
    let (pixels, _) = line.as_chunks::<3>();
    let planes = first.iter_mut().zip(second).zip(third);
    for (column, ((p, q), r)) in columns.iter().zip(planes) {
        let (a, b) = (&pixels[column.low], &pixels[column.high]);
        let mix = |channel: usize| a[channel] + (b[channel] - a[channel]) * column.share;
        *p = norm.apply(mix(FIRST), 0);
        *q = norm.apply(mix(1), 1);
        *r = norm.apply(mix(LAST), 2);
    }
}

#[cfg(test)]
mod tests {
    use super::super::card::Head;
    use super::*;
    use proptest::prelude::*;

    fn image(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 3]) -> ColourImage {
        let data = (0..width * height)
            .flat_map(|i| pixel(i % width, i / width))
            .collect();
        ColourImage::from_vec(width, height, data).unwrap()
    }

    fn size(width: usize, height: usize) -> Size {
        Size { width, height }
    }

    /// Blue, green, red from 0 to 255, at the top left.
    fn yolox() -> CardInput {
        CardInput::usual(Head::Yolox)
    }

    #[test]
    fn image_of_input_size_is_copied_into_planes() {
        let source = image(4, 3, |x, y| [x as u8, 10 * y as u8, 200]);
        let mut letterbox = Letterbox::default();
        let planes = letterbox.fill(&source, &yolox(), size(4, 3)).to_vec();
        for i in 0..12 {
            assert_eq!(
                [planes[i], planes[12 + i], planes[24 + i]],
                [200.0, 10.0 * (i / 4) as f32, (i % 4) as f32]
            );
        }
        assert_eq!(letterbox.placement().scale, [1.0, 1.0]);
    }

    /// The fast path for unscaled images gives the same values.
    #[test]
    fn unscaled_fast_path_equals_scaling() {
        let source = image(37, 5, |x, y| [7 * x as u8, 50 * y as u8, (x * y) as u8]);
        let norm = Norm {
            mean: [103.53, 116.28, 123.675],
            factor: [57.375, 57.12, 58.395].map(|s: f32| 1.0 / s),
        };
        let (columns, rows) = (taps(37, 37), taps(5, 5));
        let mut line = vec![0.0; 3 * 37];
        for row in &rows {
            let mut long = [[0.0; 37]; 3];
            let mut short = long;
            between(&source, row, &mut line);
            across::<2, 0>(&line, &columns, &norm, long.each_mut().map(|p| &mut p[..]));
            let pixels = &source.data()[3 * 37 * row.low..][..3 * 37];
            straight::<2, 0>(pixels, &norm, short.each_mut().map(|p| &mut p[..]));
            assert_eq!(long, short);
        }
    }

    #[test]
    fn channels_are_ordered_and_normalised_by_the_card() {
        let source = image(2, 2, |_, _| [10, 20, 30]);
        let card = CardInput {
            colour: ColourOrder::Rgb,
            mean: [1.0, 2.0, 3.0],
            std: [2.0, 4.0, 8.0],
            ..yolox()
        };
        let planes = Letterbox::default()
            .fill(&source, &card, size(2, 2))
            .to_vec();
        assert_eq!([planes[0], planes[4], planes[8]], [4.5, 4.5, 3.375]);
        let empty = plain(&card, size(1, 1));
        assert_eq!(empty, [56.5, 28.0, 13.875], "padding is normalised too");
    }

    /// A ramp stays a ramp: an output pixel's centre is at `(i + 0.5) * 2 - 0.5` of the source.
    #[test]
    fn halving_interpolates_between_pixels() {
        let source = image(16, 8, |x, y| [10 * x as u8, 20 * y as u8, 0]);
        let mut letterbox = Letterbox::default();
        let planes = letterbox.fill(&source, &yolox(), size(8, 8)).to_vec();
        for (y, x) in (0..4).flat_map(|y| (0..8).map(move |x| (y, x))) {
            let i = 8 * y + x;
            let (red, green) = (planes[128 + i], planes[64 + i]);
            assert_eq!(red, 10.0 * (2.0 * x as f32 + 0.5), "red at {x}, {y}");
            assert_eq!(green, 20.0 * (2.0 * y as f32 + 0.5), "green at {x}, {y}");
        }
        assert!(
            planes[32..64].iter().all(|&v| v == 114.0),
            "the lower half is padding"
        );
        assert_eq!(letterbox.placement().scale, [2.0, 2.0]);
    }

    #[test]
    fn enlarging_clamps_at_the_border() {
        let source = image(2, 2, |x, _| [100 * x as u8; 3]);
        let mut letterbox = Letterbox::default();
        let planes = letterbox.fill(&source, &yolox(), size(4, 4));
        assert_eq!(planes[..4], [0.0, 25.0, 75.0, 100.0]);
    }

    #[test]
    fn image_placement_follows_the_card() {
        let source = image(8, 4, |_, _| [9; 3]);
        let lit = |resize, input: Size| {
            let card = CardInput { resize, ..yolox() };
            let mut letterbox = Letterbox::default();
            let planes =
                letterbox.fill(&source, &card, input)[..input.width * input.height].to_vec();
            let rows: Vec<usize> = planes
                .chunks(input.width)
                .map(|row| row.iter().filter(|&&v| v == 9.0).count())
                .collect();
            (rows, letterbox.placement())
        };
        let (rows, placement) = lit(Resize::TopLeft, size(4, 4));
        assert_eq!((rows, placement.offset), (vec![4, 4, 0, 0], [0, 0]));
        let (rows, placement) = lit(Resize::Centre, size(4, 4));
        assert_eq!((rows, placement.offset), (vec![0, 4, 4, 0], [0, 1]));
        let (rows, placement) = lit(Resize::Centre, size(8, 2));
        assert_eq!((rows, placement.offset), (vec![4, 4], [2, 0]));
        let (rows, placement) = lit(Resize::Stretch, size(4, 4));
        assert_eq!((rows, placement.scale), (vec![4; 4], [2.0, 1.0]));
    }

    /// The padding of a wide image must not remain in a tall one that follows, nor one input size in the next.
    #[test]
    fn earlier_images_leave_no_traces() {
        let wide = image(8, 4, |_, _| [9; 3]);
        let tall = image(4, 8, |_, _| [7; 3]);
        let mut letterbox = Letterbox::default();
        letterbox.fill(&wide, &yolox(), size(8, 8));
        letterbox.fill(&wide, &yolox(), size(8, 4));
        let second = letterbox.fill(&tall, &yolox(), size(8, 8)).to_vec();
        let fresh = Letterbox::default()
            .fill(&tall, &yolox(), size(8, 8))
            .to_vec();
        assert_eq!(second, fresh);
        assert_eq!(second.iter().filter(|&&v| v == 7.0).count(), 3 * 32);
    }

    proptest! {
        #[test]
        fn letterbox_pixels_match_the_definition(
            (w, h) in (1_usize..20, 1_usize..20),
            (u, v) in (1_usize..20, 1_usize..20),
            seed in any::<u64>(),
        ) {
            let source = image(w, h, |x, y| {
                let n = (seed ^ (x * 31 + y * 17) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                [(n >> 40) as u8, (n >> 48) as u8, (n >> 56) as u8]
            });
            let card = CardInput { resize: Resize::Stretch, ..yolox() };
            let planes = Letterbox::default().fill(&source, &card, size(u, v)).to_vec();
            for i in 0..u * v {
                let place = |i: usize, from: usize, to: usize| {
                    let at = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5)
                        .clamp(0.0, from as f64 - 1.0);
                    (at as usize, (at as usize + 1).min(from - 1), at.fract())
                };
                let ((x0, x1, fx), (y0, y1, fy)) = (place(i % u, w, u), place(i / u, h, v));
                for channel in 0..3 {
                    let at = |x: usize, y: usize| f64::from(source.data()[3 * (y * w + x) + channel]);
                    let expected = (at(x0, y0) * (1.0 - fx) + at(x1, y0) * fx) * (1.0 - fy)
                        + (at(x0, y1) * (1.0 - fx) + at(x1, y1) * fx) * fy;
                    let found = f64::from(planes[(2 - channel) * u * v + i]);
                    prop_assert!((found - expected).abs() < 1e-3, "{found} for {expected}");
                }
            }
        }
    }
}

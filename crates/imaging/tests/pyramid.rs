//! Pyramids and smoothing through the public interface.

use proptest::prelude::*;
use stillpoint_imaging::{Blur, GrayImage, Pyramid, Simd};

/// Random images of odd and even, tiny and ordinary sizes.
fn images() -> impl Strategy<Value = GrayImage> {
    (0_usize..200, 0_usize..60).prop_flat_map(|(width, height)| {
        prop::collection::vec(any::<u8>(), width * height).prop_map(move |data| {
            GrayImage::from_vec(width, height, data).expect("as many pixels as the size asks for")
        })
    })
}

fn drawn(width: usize, height: usize, value: impl Fn(f64, f64) -> f64) -> GrayImage {
    let data = (0..width * height)
        .map(|i| value((i % width) as f64, (i / width) as f64).round() as u8)
        .collect();
    GrayImage::from_vec(width, height, data).expect("as many pixels as the size asks for")
}

proptest! {
    #[test]
    fn vector_and_scalar_pyramids_agree(
        image in images(), levels in 1_usize..6, factor in 1.01_f32..2.2,
    ) {
        let mut scalar = Pyramid::new(levels, factor, Simd::Scalar);
        let mut vector = Pyramid::new(levels, factor, Simd::detect());
        for pyramid in [&mut scalar, &mut vector] {
            pyramid.build(&image);
            pyramid.smooth_all();
        }
        for level in 0..levels {
            prop_assert_eq!(scalar.level(level), vector.level(level));
            prop_assert_eq!(scalar.smooth(level), vector.smooth(level));
        }
    }

    #[test]
    fn positions_round_trip_to_the_base_level(
        level in 0_usize..8, x in -50.0_f32..700.0, y in -50.0_f32..500.0,
    ) {
        let pyramid = Pyramid::new(8, 1.2, Simd::Scalar);
        // Pixel edges scale, so the centre of the first pixel is half a pixel from the corner.
        let down = |c: f32| (c + 0.5) / pyramid.scale(level) - 0.5;
        let (u, v) = (down(x), down(y));
        let (back_x, back_y) = pyramid.to_base(level, u, v);
        prop_assert!((back_x - x).abs() < 1e-3 && (back_y - y).abs() < 1e-3);
    }

    #[test]
    fn smoothing_and_scaling_keep_a_constant_image(
        width in 1_usize..100, height in 1_usize..50, grey in any::<u8>(),
    ) {
        let image = drawn(width, height, |_, _| f64::from(grey));
        let mut pyramid = Pyramid::new(5, 1.2, Simd::detect());
        pyramid.build(&image);
        pyramid.smooth_all();
        for level in 0..5 {
            prop_assert!(pyramid.level(level).data().iter().all(|&pixel| pixel == grey));
            prop_assert!(pyramid.smooth(level).data().iter().all(|&pixel| pixel == grey));
        }
    }
}

#[test]
fn levels_have_rounded_sizes() {
    let mut pyramid = Pyramid::new(8, 1.2, Simd::detect());
    pyramid.build(&GrayImage::new(640, 480));
    let sizes: Vec<_> = (0..8)
        .map(|level| (pyramid.level(level).width(), pyramid.level(level).height()))
        .collect();
    let expected = [
        (640, 480),
        (533, 400),
        (444, 333),
        (370, 278),
        (309, 231),
        (257, 193),
        (214, 161),
        (179, 134),
    ];
    assert_eq!(sizes, expected);
}

/// On a grey ramp, a pixel's value is its sampling position in the base image. A falling ramp cancels the rounding bias
/// of greys.
#[test]
fn every_level_samples_the_base_at_its_mapping() {
    for along_x in [true, false] {
        let (width, height) = if along_x { (255, 200) } else { (200, 255) };
        let place = |x: f64, y: f64| if along_x { x } else { y };
        let mut rising = Pyramid::new(8, 1.2, Simd::detect());
        let mut falling = rising.clone();
        rising.build(&drawn(width, height, place));
        falling.build(&drawn(width, height, |x, y| 254.0 - place(x, y)));
        for level in 0..8 {
            let (up, down) = (rising.level(level), falling.level(level));
            let (mut shift, mut count) = (0.0, 0.0);
            for y in 2..up.height() - 2 {
                for x in 2..up.width() - 2 {
                    let base = rising.to_base(level, x as f32, y as f32);
                    let expected = if along_x { base.0 } else { base.1 };
                    let found = (f32::from(up.at(x, y)) + 254.0 - f32::from(down.at(x, y))) / 2.0;
                    let error = found - expected;
                    assert!(error.abs() < 1.0, "level {level}, ({x}, {y}): {error}");
                    shift += error;
                    count += 1.0;
                }
            }
            assert!(
                (shift / count).abs() < 0.02,
                "level {level}: {} px",
                shift / count
            );
        }
    }
}

#[test]
fn smoothing_matches_a_gaussian_of_sigma_two() {
    // The response to a point of 255 is too faint at the rim for 8 bits; to a bright column the sum over rows is 1.
    let column = drawn(21, 21, |x, _| if x == 10.0 { 255.0 } else { 0.0 });
    let mut smooth = GrayImage::default();
    Blur::new(Simd::Scalar).run(&column, &mut smooth);
    let weight = |d: f64| libm::exp(-d * d / 8.0);
    let total: f64 = (-3..=3).map(|d| weight(f64::from(d))).sum();
    for x in 0..21 {
        let d = (x as f64 - 10.0).abs();
        let expected = if d <= 3.0 {
            255.0 * weight(d) / total
        } else {
            0.0
        };
        for y in 0..21 {
            let found = f64::from(smooth.at(x, y));
            assert!(
                (found - expected).abs() <= 1.5,
                "({x}, {y}): {found}, expected {expected}"
            );
        }
    }
}

#[test]
fn pyramid_is_reusable_for_other_image_sizes() {
    let mut pyramid = Pyramid::new(4, 1.2, Simd::detect());
    for (width, height) in [(640, 480), (33, 17), (0, 0), (1, 1), (640, 480)] {
        let image = drawn(width, height, |x, y| (x * 7.0 + y * 13.0) % 256.0);
        pyramid.build(&image);
        pyramid.smooth_all();
        let mut fresh = Pyramid::new(4, 1.2, Simd::detect());
        fresh.build(&image);
        fresh.smooth_all();
        for level in 0..4 {
            assert_eq!(pyramid.level(level), fresh.level(level));
            assert_eq!(pyramid.smooth(level), fresh.smooth(level));
        }
    }
}

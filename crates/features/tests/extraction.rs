//! Tests of the extractor.

use crate::common::{hash, render};
use proptest::prelude::*;
use stillpoint_features::{Features, OrbConfig, OrbExtractor, match_brute_force};
use stillpoint_imaging::{GrayImage, Simd};

fn extract(image: &GrayImage, simd: Simd) -> Features {
    let mut out = Features::default();
    OrbExtractor::new(&OrbConfig::default(), simd).extract(image, &mut out);
    out
}

/// Matches of `a` and `b`, as pairs of indices.
fn matches(a: &Features, b: &Features) -> Vec<(usize, usize)> {
    let found = match_brute_force(&a.descriptors, &b.descriptors, 50, 0.9);
    let pairs = found.iter().enumerate();
    pairs
        .filter_map(|(i, j)| Some((i, (*j)? as usize)))
        .collect()
}

#[test]
fn extraction_gives_about_the_requested_number() {
    let features = extract(&render(640, 480, |x, y| (x, y)), Simd::detect());
    assert!(
        (950..=1050).contains(&features.len()),
        "{} features",
        features.len()
    );
    assert_eq!(features.keypoints.len(), features.descriptors.len());
}

/// Squares, and a long border in steps of 2 px below them.
#[test]
fn corners_have_no_edge_and_points_of_a_line_lie_along_it() {
    const SLOPE: f32 = 0.15;
    let square = |x: usize, y: usize| y < 120 && x % 80 > 40 && y % 60 > 20;
    let border = |x: f32| 170.0 + 2.0 * (0.5 * SLOPE * x).floor();
    let pixel = |i: usize| {
        let (x, y) = (i % 320, i / 320);
        if square(x, y) || y as f32 > border(x as f32) {
            200
        } else {
            60
        }
    };
    let image = GrayImage::from_vec(320, 280, (0..320 * 280).map(pixel).collect()).unwrap();
    let (mut corners, mut line) = (0, 0);
    for k in extract(&image, Simd::detect()).keypoints {
        let [x, y] = k.edge.vector();
        let length = x * x + y * y;
        if k.y < 125.0 && k.level == 0 {
            assert!(length < 0.1, "{k:?}");
            corners += 1;
        } else if (k.y - border(k.x)).abs() < 6.0 && k.level == 0 {
            assert!(length > 0.4, "{k:?}");
            let across = (y - f64::from(SLOPE) * x).abs() / length.sqrt();
            assert!(across < 0.15, "{k:?}");
            line += 1;
        }
    }
    assert!(corners > 10 && line > 10, "{corners} {line}");
}

#[test]
fn features_are_spread_over_image_and_levels() {
    let features = extract(&render(640, 480, |x, y| (x, y)), Simd::detect());
    let mut cells = [0; 48];
    let mut levels = [0; 5];
    for keypoint in &features.keypoints {
        assert!((18.0..622.0).contains(&keypoint.x) && (18.0..462.0).contains(&keypoint.y));
        assert!((-std::f32::consts::PI..=std::f32::consts::PI).contains(&keypoint.angle));
        assert!(keypoint.response > 5.0);
        cells[(keypoint.y / 80.0) as usize * 8 + (keypoint.x / 80.0) as usize] += 1;
        levels[usize::from(keypoint.level)] += 1;
    }
    let full = cells.iter().filter(|&&count| count >= 4).count();
    assert!(full >= 44, "features per cell of 80 px: {cells:?}");
    assert!(
        cells.iter().all(|&count| count <= 60),
        "features per cell of 80 px: {cells:?}"
    );
    // Areas shrink by 2.1 per level: 537, 256, 122, 58, 27 of 1000.
    assert!(
        (497..=577).contains(&levels[0]) && (18..=45).contains(&levels[4]),
        "{levels:?}"
    );
    assert!(
        features
            .keypoints
            .is_sorted_by_key(|keypoint| keypoint.level)
    );
}

/// The texture shifted by a fraction of a pixel: most features are found at the shifted positions.
#[test]
fn shifted_image_gives_shifted_features() {
    let (dx, dy) = (7.3, -4.6);
    let first = extract(&render(640, 480, |x, y| (x, y)), Simd::detect());
    let second = extract(&render(640, 480, |x, y| (x + dx, y + dy)), Simd::detect());
    let pairs = matches(&first, &second);
    let (mut near, mut sum) = (0, [0.0, 0.0]);
    for &(i, j) in &pairs {
        let (a, b) = (first.keypoints[i], second.keypoints[j]);
        let error = [a.x - dx as f32 - b.x, a.y - dy as f32 - b.y];
        // One and a half pixels of its level.
        let most = 1.5 * libm::powf(1.45, f32::from(a.level));
        if error[0] * error[0] + error[1] * error[1] < most * most {
            near += 1;
            sum = [sum[0] + error[0], sum[1] + error[1]];
        }
    }
    assert!(pairs.len() > 500, "{} matches", pairs.len());
    assert!(
        near * 100 > pairs.len() * 93,
        "{near} of {} matches agree",
        pairs.len()
    );
    let mean = [sum[0] / near as f32, sum[1] / near as f32];
    assert!(
        mean[0].abs() < 0.05 && mean[1].abs() < 0.05,
        "features are off by {mean:?} px on average"
    );
}

/// Features of an image scaled by two levels: positions have no level-dependent bias.
#[test]
fn scaled_image_gives_unbiased_features_at_other_levels() {
    let scale = 1.45 * 1.45;
    let first = extract(&render(640, 480, |x, y| (x, y)), Simd::detect());
    let second = extract(
        &render(304, 228, |x, y| {
            ((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5)
        }),
        Simd::detect(),
    );
    let (mut near, mut sum, mut down) = (0, [0.0, 0.0], 0);
    let pairs = matches(&first, &second);
    for &(i, j) in &pairs {
        let (a, b) = (first.keypoints[i], second.keypoints[j]);
        let mapped = [
            (b.x + 0.5) * scale as f32 - 0.5,
            (b.y + 0.5) * scale as f32 - 0.5,
        ];
        let error = [a.x - mapped[0], a.y - mapped[1]];
        if error[0] * error[0] + error[1] * error[1] < 3.0 * 3.0 {
            near += 1;
            down += i32::from(a.level) - i32::from(b.level);
            sum = [sum[0] + error[0], sum[1] + error[1]];
        }
    }
    assert!(
        near > 150 && near * 100 > pairs.len() * 80,
        "{near} of {} matches agree",
        pairs.len()
    );
    let levels = f64::from(down) / near as f64;
    assert!((levels - 2.0).abs() < 0.3, "{levels} levels apart");
    let mean = [sum[0] / near as f32, sum[1] / near as f32];
    assert!(
        mean[0].abs() < 0.12 && mean[1].abs() < 0.12,
        "features are off by {mean:?} px on average"
    );
}

#[test]
fn rotated_image_gives_rotated_angles_and_same_descriptors() {
    for degrees in [20.0_f64, 75.0, 160.0, -110.0] {
        let (sin, cos) = libm::sincos(degrees.to_radians());
        let turn = |x: f64, y: f64| {
            let (u, v) = (x - 199.5, y - 199.5);
            (cos * u - sin * v + 199.5, sin * u + cos * v + 199.5)
        };
        let first = extract(&render(400, 400, |x, y| (x, y)), Simd::detect());
        let second = extract(&render(400, 400, turn), Simd::detect());
        let pairs = matches(&first, &second);
        let mut good = 0;
        for &(i, j) in &pairs {
            let (a, b) = (first.keypoints[i], second.keypoints[j]);
            let (x, y) = turn(f64::from(b.x), f64::from(b.y));
            let (dx, dy) = (f64::from(a.x) - x, f64::from(a.y) - y);
            let apart = dx * dx + dy * dy;
            // The second image shows the first rotated by -degrees.
            let angle = f64::from(a.angle - b.angle) - degrees.to_radians();
            let angle =
                (angle / std::f64::consts::TAU - (angle / std::f64::consts::TAU).round()) * 360.0;
            good += usize::from(apart < 9.0 && angle.abs() < 15.0);
        }
        assert!(
            good > 200,
            "{good} features found again after {degrees} degrees"
        );
        assert!(
            good * 100 > pairs.len() * 85,
            "{good} of {} matches agree after {degrees} degrees",
            pairs.len()
        );
    }
}

#[test]
fn extraction_does_not_depend_on_earlier_images() {
    let image = render(320, 240, |x, y| (x, y));
    let other = render(333, 200, |x, y| (x + 500.0, y));
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), Simd::detect());
    let (mut first, mut second) = (Features::default(), Features::default());
    extractor.extract(&image, &mut first);
    extractor.extract(&other, &mut second);
    extractor.extract(&image, &mut second);
    assert!(!first.is_empty());
    assert_eq!(first, second);
}

#[test]
fn flat_or_tiny_images_give_no_features() {
    for simd in [Simd::Scalar, Simd::detect()] {
        for (width, height) in [(0, 0), (1, 1), (38, 38), (38, 500), (7, 3)] {
            let data = (0..width * height).map(|i| (i * 97 % 251) as u8).collect();
            let image = GrayImage::from_vec(width, height, data)
                .expect("as many pixels as the size asks for");
            assert!(extract(&image, simd).is_empty(), "{width}x{height}");
        }
        for grey in [0, 128, 255] {
            let image = GrayImage::from_vec(640, 480, vec![grey; 640 * 480])
                .expect("as many pixels as the size asks for");
            assert!(extract(&image, simd).is_empty(), "constant {grey}");
        }
    }
}

#[test]
fn low_threshold_fills_empty_cells() {
    // Contrast 60 on the left, 12 on the right: the right has corners at the low threshold only.
    let data = (0..480 * 640)
        .map(|i| {
            let (x, y) = (i % 640, i / 640);
            let contrast = if x < 320 { 60 } else { 12 };
            if (x / 16 + y / 16) % 3 == 0 {
                100 + contrast
            } else {
                100
            }
        })
        .collect();
    let image = GrayImage::from_vec(640, 480, data).expect("as many pixels as the size asks for");
    let right = |low: u8| {
        let config = OrbConfig {
            fast_threshold_low: low,
            ..OrbConfig::default()
        };
        let mut out = Features::default();
        OrbExtractor::new(&config, Simd::detect()).extract(&image, &mut out);
        out.keypoints
            .iter()
            .filter(|keypoint| keypoint.x > 345.0)
            .count()
    };
    assert!(right(5) > 100, "{} features", right(5));
    assert_eq!(right(20), 0);
}

#[test]
fn out_of_range_configuration_is_reported_and_tolerated() {
    assert_eq!(OrbConfig::default().problems(), Vec::<String>::new());
    let odd = OrbConfig {
        features: 0,
        levels: 0,
        scale_factor: f32::NAN,
        fast_threshold: 3,
        fast_threshold_low: 9,
        subpixel: true,
    };
    assert_eq!(odd.problems().len(), 4, "{:?}", odd.problems());
    let mut out = Features::default();
    OrbExtractor::new(&odd, Simd::detect()).extract(&render(100, 100, |x, y| (x, y)), &mut out);
    assert!(out.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn vector_and_scalar_extraction_agree(
        width in 1_usize..260, height in 1_usize..180, seed in any::<u64>(), contrast in 1_u64..256,
    ) {
        let data = (0..width * height)
            .map(|i| ((hash((i % width) as i64 / 3, (i / width) as i64 / 3, seed) % contrast) + hash(i as i64, 0, seed) % 9).min(255) as u8)
            .collect();
        let image = GrayImage::from_vec(width, height, data).expect("as many pixels as the size asks for");
        let (scalar, vector) = (extract(&image, Simd::Scalar), extract(&image, Simd::detect()));
        prop_assert_eq!(scalar, vector);
    }
}

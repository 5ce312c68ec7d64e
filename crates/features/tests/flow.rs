//! Tests of the flow on images with known motion.

use crate::common::{hash, render};
use proptest::prelude::*;
use stillpoint_features::{Features, Flow, FlowConfig, FlowMatch, OrbConfig, OrbExtractor};
use stillpoint_imaging::{GrayImage, Pyramid, Simd};

type Matches = Vec<Option<FlowMatch>>;

fn pyramid(image: &GrayImage) -> Pyramid {
    let mut pyramid = Pyramid::new(5, 1.45, Simd::detect());
    pyramid.build(image);
    pyramid
}

fn track(
    config: FlowConfig,
    images: (&GrayImage, &GrayImage),
    points: &[[f32; 2]],
    guesses: Option<&[[f32; 2]]>,
) -> Matches {
    let mut out = Vec::new();
    let pyramids = (pyramid(images.0), pyramid(images.1));
    Flow::new(config, Simd::detect()).track(&pyramids.0, &pyramids.1, points, guesses, &mut out);
    out
}

fn corners(image: &GrayImage) -> Vec<[f32; 2]> {
    let mut features = Features::default();
    OrbExtractor::new(&OrbConfig::default(), Simd::detect()).extract(image, &mut features);
    features.keypoints.iter().map(|k| [k.x, k.y]).collect()
}

fn still(width: usize, height: usize) -> GrayImage {
    render(width, height, |x, y| (x, y))
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    libm::hypotf(a[0] - b[0], a[1] - b[1])
}

/// For points at least 10 px inside the second image: the share that was found, and their sorted errors.
fn errors(
    points: &[[f32; 2]],
    found: &Matches,
    truth: impl Fn([f32; 2]) -> [f32; 2],
) -> (f32, Vec<f32>) {
    let (mut total, mut errors) = (0, Vec::new());
    for (&point, found) in points.iter().zip(found) {
        let [x, y] = truth(point);
        if (10.0..390.0).contains(&x) && (10.0..290.0).contains(&y) {
            total += 1;
            errors.extend(found.map(|found| distance(found.position, [x, y])));
        }
    }
    assert!(total > 300, "{total} points to judge");
    errors.sort_by(f32::total_cmp);
    (errors.len() as f32 / total as f32, errors)
}

/// Bounds on the share found, on the median error and on that of 95 of 100 points.
#[track_caller]
fn expect((share, errors): (f32, Vec<f32>), least: f32, median: f32, most: f32) {
    let at = |share: f32| errors[((errors.len() - 1) as f32 * share) as usize];
    let figures = (share, at(0.5), at(0.95));
    assert!(
        figures.0 >= least && figures.1 <= median && figures.2 <= most,
        "share, median and 95th percentile: {figures:?}"
    );
}

#[test]
fn shifts_are_tracked_to_subpixel_accuracy() {
    let first = still(400, 300);
    let points = corners(&first);
    for (dx, dy) in [(0.0, 0.0), (0.37, -0.81), (7.3, -4.6), (-17.2, 9.7)] {
        let second = render(400, 300, |x, y| (x + dx, y + dy));
        let found = track(FlowConfig::default(), (&first, &second), &points, None);
        let truth = |p: [f32; 2]| [p[0] - dx as f32, p[1] - dy as f32];
        expect(errors(&points, &found, truth), 0.95, 0.05, 0.2);
    }
}

/// Good guesses give the same results as a search; bad ones are not corrected.
#[test]
fn local_search_needs_accurate_guesses() {
    let first = still(400, 300);
    let points = corners(&first);
    let second = render(400, 300, |x, y| (x + 17.3, y - 9.6));
    let truth = |p: [f32; 2]| [p[0] - 17.3, p[1] + 9.6];
    let look = |guesses: &[[f32; 2]]| {
        let mut out = Vec::new();
        let pyramids = (pyramid(&first), pyramid(&second));
        let mut flow = Flow::new(FlowConfig::default(), Simd::detect());
        flow.look(&pyramids.0, &pyramids.1, &points, guesses, &mut out);
        assert_eq!(out.len(), points.len());
        out
    };
    let beside = |p: &[f32; 2]| [truth(*p)[0] + 1.5, truth(*p)[1] - 1.0];
    let guesses: Vec<[f32; 2]> = points.iter().map(beside).collect();
    expect(errors(&points, &look(&guesses), truth), 0.9, 0.05, 0.2);
    // Without guesses, 20 px away, few are found; a search on all scales finds nearly all.
    let (near, _) = errors(&points, &look(&[]), truth);
    let all = track(FlowConfig::default(), (&first, &second), &points, None);
    let (far, _) = errors(&points, &all, truth);
    assert!(near < 0.3 && far > 0.95, "{near} and {far}");
}

/// A rotation by 2 degrees with a zoom of 3 %, and 15 grey levels brighter.
#[test]
fn flow_follows_rotation_zoom_and_brightness() {
    let first = still(400, 300);
    let points = corners(&first);
    let (sin, cos) = libm::sincos(0.035);
    let map = |x: f64, y: f64, scale: f64| {
        let (u, v) = (x - 200.0, y - 150.0);
        let turned = (cos * u - sin * v, sin * u + cos * v);
        (200.0 + scale * turned.0, 150.0 + scale * turned.1)
    };
    let mut second = render(400, 300, |x, y| map(x, y, 1.0 / 1.03));
    for pixel in second.data_mut() {
        *pixel = pixel.saturating_add(15);
    }
    let truth = |p: [f32; 2]| {
        let (u, v) = (1.03 * (p[0] - 200.0), 1.03 * (p[1] - 150.0));
        let (sin, cos) = (sin as f32, cos as f32);
        [200.0 + cos * u + sin * v, 150.0 - sin * u + cos * v]
    };
    let found = track(FlowConfig::default(), (&first, &second), &points, None);
    expect(errors(&points, &found, truth), 0.9, 0.15, 0.5);
    // The residual excludes the brightness change.
    let residuals = found.iter().flatten().map(|found| found.residual);
    assert!(residuals.clone().all(|residual| residual < 14.0));
    assert!(residuals.sum::<f32>() < 7.0 * found.iter().flatten().count() as f32);
}

#[test]
fn points_at_or_beyond_the_border_are_refused() {
    let first = still(400, 300);
    let second = render(400, 300, |x, y| (x + 20.0, y));
    let border = [
        [3.0, 150.0],
        [200.0, 5.0],
        [396.0, 150.0],
        [200.0, 296.5],
        [-50.0, 20.0],
        [1e9, 20.0],
        [f32::NAN, 20.0],
        [20.0, f32::INFINITY],
    ];
    let found = track(FlowConfig::default(), (&first, &first), &border, None);
    assert!(found.iter().all(Option::is_none), "{found:?}");
    // Points left of column 28 leave the image or reach its border.
    let leaving: Vec<_> = (0..60)
        .map(|i| [10.0 + 0.25 * i as f32, 20.0 + 4.0 * i as f32])
        .collect();
    let found = track(FlowConfig::default(), (&first, &second), &leaving, None);
    assert!(found.iter().all(Option::is_none), "{found:?}");
    // Near the border, but inside both, motion is found although coarse windows do not fit.
    let near: Vec<_> = corners(&first)
        .into_iter()
        .filter(|p| (30.0..45.0).contains(&p[0]))
        .collect();
    let found = track(FlowConfig::default(), (&first, &second), &near, None);
    let right = |(p, found): (&[f32; 2], &Option<FlowMatch>)| {
        found.is_some_and(|found| distance(found.position, [p[0] - 20.0, p[1]]) < 0.5)
    };
    let count = near.iter().zip(&found).filter(|pair| right(*pair)).count();
    assert!(
        near.len() > 15 && count * 10 > near.len() * 8,
        "{count} of {}",
        near.len()
    );
}

/// Points without texture, or on a straight edge, give no result.
#[test]
fn flat_patches_and_straight_edges_give_no_flow() {
    let flat = GrayImage::from_vec(200, 200, vec![90; 40_000]).unwrap();
    let noisy = |pixel: u8, i: usize| pixel + (hash(i as i64, 1, 7) % 3) as u8;
    let edge = (0..40_000).map(|i| noisy(if i % 200 < 100 { 60 } else { 160 }, i));
    let edge = GrayImage::from_vec(200, 200, edge.collect()).unwrap();
    let corner = |i: usize| {
        if i % 200 < 100 && i / 200 < 100 {
            60
        } else {
            160
        }
    };
    let corner = GrayImage::from_vec(200, 200, (0..40_000).map(|i| noisy(corner(i), i)).collect());
    let point = [[99.5, 99.5]];
    let found = |image: &GrayImage| track(FlowConfig::default(), (image, image), &point, None)[0];
    assert_eq!(found(&flat), None);
    assert_eq!(found(&edge), None);
    assert!(found(&corner.unwrap()).is_some());
}

/// A square with another texture covers part of the image; covered points must be rejected by the final tests.
#[test]
fn occluded_points_are_refused() {
    let first = still(400, 300);
    let covered = |x: f64, y: f64| (120.0..280.0).contains(&x) && (80.0..220.0).contains(&y);
    let second = render(400, 300, |x, y| {
        if covered(x, y) {
            (3.0 * x + 5000.0, 3.0 * y)
        } else {
            (x + 1.0, y)
        }
    });
    let inside = |p: &[f32; 2]| (135.0..265.0).contains(&p[0]) && (95.0..205.0).contains(&p[1]);
    let points: Vec<_> = corners(&first).into_iter().filter(inside).collect();
    assert!(points.len() > 80, "{} points", points.len());
    let count = |config| {
        let found = track(config, (&first, &second), &points, None);
        found.iter().flatten().count() as f32 / points.len() as f32
    };
    let none = FlowConfig {
        forward_backward: f32::MAX,
        max_residual: f32::MAX,
        ..FlowConfig::default()
    };
    let return_only = FlowConfig {
        max_residual: f32::MAX,
        ..FlowConfig::default()
    };
    let shares = [
        count(none),
        count(return_only),
        count(FlowConfig::default()),
    ];
    assert!(
        shares[0] > 0.3 && shares[1] < 0.5 * shares[0] && shares[2] < 0.12,
        "found without tests, with the way back, with the residual too: {shares:?}"
    );
}

#[test]
fn guesses_do_not_change_the_result() {
    let first = still(400, 300);
    let (dx, dy) = (22.4, -13.7);
    let second = render(400, 300, |x, y| (x + dx, y + dy));
    let points = corners(&first);
    let truth = |p: [f32; 2]| [p[0] - dx as f32, p[1] - dy as f32];
    for wrong in [0.0, 1.0, 2.0, 12.0, 20.0] {
        let guess = |(i, p): (usize, &[f32; 2])| {
            let (sin, cos) = libm::sincosf(i as f32);
            let [x, y] = truth(*p);
            [x + wrong * cos, y + wrong * sin]
        };
        let guesses: Vec<_> = points.iter().enumerate().map(guess).collect();
        let found = track(
            FlowConfig::default(),
            (&first, &second),
            &points,
            Some(&guesses),
        );
        expect(errors(&points, &found, truth), 0.93, 0.05, 0.2);
    }
    // Points beyond the list of guesses have none.
    let few = track(FlowConfig::default(), (&first, &second), &points, Some(&[]));
    assert_eq!(
        few,
        track(FlowConfig::default(), (&first, &second), &points, None)
    );
}

#[test]
fn extractor_keeps_the_previous_pyramid() {
    let (first, second) = (still(400, 300), render(400, 300, |x, y| (x + 3.5, y + 1.0)));
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), Simd::detect());
    let mut flow = Flow::new(FlowConfig::default(), Simd::detect());
    let (mut features, mut out) = <(Features, Matches)>::default();
    extractor.extract(&first, &mut features);
    let points = corners(&first);
    // Before the second image there is nothing to compare with.
    flow.track(
        extractor.previous_pyramid(),
        extractor.pyramid(),
        &points,
        None,
        &mut out,
    );
    assert_eq!(out, vec![None; points.len()]);
    extractor.extract(&second, &mut features);
    flow.track(
        extractor.previous_pyramid(),
        extractor.pyramid(),
        &points,
        None,
        &mut out,
    );
    assert!(out.iter().flatten().count() > 300);
    assert_eq!(
        out,
        track(FlowConfig::default(), (&first, &second), &points, None)
    );
    assert_eq!(extractor.previous_pyramid().level(0), &first);
    assert_eq!(extractor.pyramid().level(0), &second);
}

#[test]
fn out_of_range_configuration_is_reported_and_tolerated() {
    assert_eq!(FlowConfig::default().problems(), Vec::<String>::new());
    let odd = FlowConfig {
        radius: 0,
        levels: 0,
        level_step: 0,
        iterations: 0,
        epsilon: f32::NAN,
        forward_backward: -1.0,
        max_residual: 0.0,
        min_eigenvalue: -0.5,
        guess_error: f32::NAN,
    };
    assert_eq!(odd.problems().len(), 9, "{:?}", odd.problems());
    let image = still(120, 100);
    let many = FlowConfig {
        radius: 99,
        levels: 99,
        level_step: 99,
        ..FlowConfig::default()
    };
    for config in [odd, many] {
        let found = track(
            config,
            (&image, &image),
            &[[60.0, 50.0]],
            Some(&[[61.0, 50.0]]),
        );
        assert_eq!(found.len(), 1);
    }
    // Images of different size have no flow.
    let other = still(121, 100);
    let found = track(
        FlowConfig::default(),
        (&image, &other),
        &[[60.0, 50.0]],
        None,
    );
    assert_eq!(found, [None]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn vector_and_scalar_flow_agree(
        (width, height) in (1_usize..200, 1_usize..150), seed in any::<u64>(), contrast in 1_u64..256,
        (dx, dy) in (-9_i64..10, -9_i64..10), radius in 2_usize..=7, guessed in any::<bool>(),
    ) {
        let image = |dx: i64, dy: i64| {
            let pixel = |i: usize| {
                let (x, y) = ((i % width) as i64 + dx, (i / width) as i64 + dy);
                (hash(x.div_euclid(4), y.div_euclid(5), seed) % contrast + hash(x, y, seed) % 9).min(255) as u8
            };
            GrayImage::from_vec(width, height, (0..width * height).map(pixel).collect()).unwrap()
        };
        let (first, second) = (pyramid(&image(0, 0)), pyramid(&image(dx, dy)));
        let any = |i: u64, length: usize| (hash(i as i64, 3, seed) % (16 * length as u64 + 320)) as f32 / 16.0 - 10.0;
        let points: Vec<_> = (0..80).map(|i| [any(2 * i, width), any(2 * i + 1, height)]).collect();
        let guesses: Vec<_> = points.iter().map(|p| [p[0] - dx as f32 + 0.7, p[1] - dy as f32 - 1.1]).collect();
        let guesses = guessed.then_some(&guesses[..]);
        let config = FlowConfig { radius, max_residual: 40.0, ..FlowConfig::default() };
        let run = |simd: Simd| {
            let mut out = Vec::new();
            Flow::new(config.clone(), simd).track(&first, &second, &points, guesses, &mut out);
            out
        };
        let bits = |out: Matches| -> Vec<_> {
            let bits = |m: FlowMatch| [m.position[0], m.position[1], m.residual, m.forward_backward].map(f32::to_bits);
            out.into_iter().map(|found| found.map(bits)).collect()
        };
        prop_assert_eq!(bits(run(Simd::Scalar)), bits(run(Simd::detect())));
    }
}

//! Accuracy of the flow compared with depth and poses: on simulated rooms, and on real frames if there are any under
//! `STILLPOINT_DATA` (else `../shared/data`).
// Tests may read environment variables and print; the library may not.
#![allow(clippy::disallowed_methods, clippy::print_stderr)]

use std::path::PathBuf;

use stillpoint_features::{Features, Flow, FlowConfig, FlowMatch, OrbConfig, OrbExtractor};
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec2, Vec3};
use stillpoint_imaging::{ColourImage, DepthImage, GrayImage, Simd};
use stillpoint_simulator::{Simulator, SimulatorConfig};

/// Tracks the corners of the first image to the second; returns points and results. The bounds hold for corners of
/// ORB-SLAM2's thresholds.
fn track(first: &GrayImage, second: &GrayImage) -> Vec<([f32; 2], Option<FlowMatch>)> {
    let config = OrbConfig {
        fast_threshold_low: 7,
        ..OrbConfig::default()
    };
    let mut extractor = OrbExtractor::new(&config, Simd::detect());
    let (mut features, mut other) = <(Features, Features)>::default();
    extractor.extract(first, &mut features);
    extractor.extract(second, &mut other);
    let points: Vec<_> = features.keypoints.iter().map(|k| [k.x, k.y]).collect();
    let mut out = Vec::new();
    let (previous, current) = (extractor.previous_pyramid(), extractor.pyramid());
    let mut flow = Flow::new(FlowConfig::default(), Simd::detect());
    flow.track(previous, current, &points, None, &mut out);
    points.into_iter().zip(out).collect()
}

/// True position of a point in the second image, and its depth there, m; `None` without depth, or if depth is curved by
/// more than `bend` relative to itself.
fn predict(
    camera: &Camera,
    depth: &DepthImage,
    second_from_first: &Se3,
    [x, y]: [f32; 2],
    bend: f32,
) -> Option<(Vec2, f64)> {
    let (u, v) = (x.round() as usize, y.round() as usize);
    if !(8..632).contains(&u) || !(8..472).contains(&v) {
        return None;
    }
    // Inverse depth is linear over planes, so interpolation is exact, except at edges.
    let w = |x: usize, y: usize| 1.0 / depth.at(x, y);
    let (middle, [left, right]) = (w(u, v), [w(u - 8, v), w(u + 8, v)]);
    let (above, below) = (w(u, v - 8), w(u, v + 8));
    let bent = (left + right - 2.0 * middle).abs() + (above + below - 2.0 * middle).abs();
    // An infinite inverse depth, for missing depth, fails the comparison.
    let flat = bent < bend * middle;
    if !flat {
        return None;
    }
    let slope = [(right - left) / 16.0, (below - above) / 16.0];
    let w = middle + slope[0] * (x - u as f32) + slope[1] * (y - v as f32);
    let from = camera.undistort(Vec2::new(f64::from(x), f64::from(y)));
    let p = second_from_first.transform(&camera.backproject(from, 1.0 / f64::from(w)));
    let px = camera.project_distorted(&p);
    let inside = (8.0..631.0).contains(&px.x) && (8.0..471.0).contains(&px.y);
    inside.then_some((px, p.z))
}

/// Share found, median error, share of those found with an error above a pixel.
fn judge(errors: &[Option<f64>]) -> [f64; 3] {
    let mut found: Vec<_> = errors.iter().flatten().copied().collect();
    assert!(found.len() > 200, "{} points to judge", found.len());
    found.sort_by(f64::total_cmp);
    let wrong = found.iter().filter(|&&error| error > 1.0).count();
    let count = found.len() as f64;
    [
        count / errors.len() as f64,
        found[found.len() / 2],
        wrong as f64 / count,
    ]
}

fn error(found: Option<FlowMatch>, truth: Vec2) -> Option<f64> {
    let [x, y] = found?.position;
    Some((f64::from(x) - truth.x).hypot(f64::from(y) - truth.y))
}

#[test]
fn flow_agrees_with_simulated_depth_and_poses() {
    for scene in ["rpy", "halfsphere"] {
        let simulator = |noise: bool| {
            Simulator::new(&SimulatorConfig {
                scene: scene.to_owned(),
                noise,
                depth_delay: 0.0,
                ..SimulatorConfig::default()
            })
            .expect("a scene that exists")
        };
        let (noisy, ideal) = (simulator(true), simulator(false));
        let camera = *ideal.camera();
        let mut errors = Vec::new();
        for i in [20, 75] {
            let pose = |i: usize| ideal.world_from_camera(ideal.stamp(i));
            let second_from_first = pose(i + 1).inverse() * pose(i);
            let (depth, second_depth) = (ideal.depth(i), ideal.depth(i + 1));
            for (point, found) in track(&noisy.frame(i).gray, &noisy.frame(i + 1).gray) {
                let Some((truth, z)) = predict(&camera, &depth, &second_from_first, point, 0.02)
                else {
                    continue;
                };
                let seen = second_depth.at(truth.x.round() as usize, truth.y.round() as usize);
                // Skips occluded points.
                if (f64::from(seen) / z - 1.0).abs() < 0.02 {
                    errors.push(error(found, truth));
                }
            }
        }
        let [share, median, wrong] = judge(&errors);
        eprintln!(
            "{scene}: {:.1} % of {} found, median error {median:.3} px, {:.2} % over 1 px",
            100.0 * share,
            errors.len(),
            100.0 * wrong
        );
        assert!(share > 0.95 && median < 0.08 && wrong < 0.015);
    }
}

/// Stamped lines of a file of a TUM recording.
fn lines(file: PathBuf) -> Vec<(f64, Vec<String>)> {
    let text = std::fs::read_to_string(file).expect("a list");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let split = lines.map(|line| {
        let mut words = line.split_whitespace();
        let stamp = words.next().and_then(|word| word.parse().ok());
        (stamp.expect("a stamp"), words.map(str::to_owned).collect())
    });
    split.collect()
}

fn pose_at(truth: &[(f64, Vec<String>)], stamp: f64) -> Se3 {
    let pose = |i: usize| {
        let v: Vec<f64> = truth[i]
            .1
            .iter()
            .map(|word| word.parse().expect("a number"))
            .collect();
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(v[6], v[3], v[4], v[5]));
        Se3::new(rotation, Vec3::new(v[0], v[1], v[2]))
    };
    let after = truth
        .partition_point(|(t, _)| *t < stamp)
        .clamp(1, truth.len() - 1);
    let (a, b) = (truth[after - 1].0, truth[after].0);
    pose(after - 1).interpolate(&pose(after), (stamp - a) / (b - a))
}

/// Motion capture gives absolute positions to some pixels only, because of a clock offset of milliseconds, and relative
/// ones to about half a pixel.
#[test]
fn flow_agrees_with_motion_capture_on_real_frames() {
    let Some(folder) = stillpoint_testdata::recording("fr1_xyz") else {
        return;
    };
    let [colour, depth, truth] =
        ["rgb.txt", "depth.txt", "groundtruth.txt"].map(|name| lines(folder.join(name)));
    let mut camera = Camera::pinhole(640, 480, [517.306408, 516.469215, 318.64304, 255.313989]);
    camera.distortion = BrownConrady {
        k1: 0.262383,
        k2: -0.953104,
        p1: -0.005358,
        p2: 0.002628,
        k3: 1.163314,
    };
    let open = |name: &str| image::open(folder.join(name)).expect("a readable frame");
    let gray = |i: usize| {
        let data = open(&colour[i].1[0]).to_rgb8().into_raw();
        ColourImage::from_vec(640, 480, data)
            .expect("640x480")
            .to_gray()
    };
    let mut errors = Vec::new();
    for i in (5..colour.len() - 1).step_by(40) {
        let stamp = colour[i].0;
        let nearest = depth
            .iter()
            .min_by(|a, b| (a.0 - stamp).abs().total_cmp(&(b.0 - stamp).abs()));
        let raw = open(&nearest.expect("a depth image").1[0])
            .to_luma16()
            .into_raw();
        let metres = raw.iter().map(|&d| f32::from(d) / 5000.0).collect();
        let depth = DepthImage::from_vec(640, 480, metres).expect("640x480");
        let second_from_first = pose_at(&truth, colour[i + 1].0).inverse() * pose_at(&truth, stamp);
        let tracked = track(&gray(i), &gray(i + 1)).into_iter();
        let judged: Vec<_> = tracked
            .filter_map(|(point, found)| {
                let (truth, _) = predict(&camera, &depth, &second_from_first, point, 0.02)?;
                let found = found.map(|f| f.position.map(f64::from));
                Some(found.map(|[x, y]| [x - truth.x, y - truth.y]))
            })
            .collect();
        // Removes the common error, which is due to the stamps.
        let common = [0, 1].map(|axis| {
            let mut all: Vec<_> = judged.iter().flatten().map(|error| error[axis]).collect();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        });
        let rest = |error: &[f64; 2]| (error[0] - common[0]).hypot(error[1] - common[1]);
        errors.extend(judged.iter().map(|error| error.as_ref().map(rest)));
    }
    let [share, median, wrong] = judge(&errors);
    eprintln!(
        "fr1_xyz: {:.1} % of {} found, median error {median:.3} px, {:.2} % over 1 px",
        100.0 * share,
        errors.len(),
        100.0 * wrong
    );
    assert!(share > 0.9 && median < 0.7);
}

//! Benchmarks of RANSAC and its minimal solvers: `cargo bench -p stillpoint-estimation`.

use divan::{AllocProfiler, Bencher, black_box};
use stillpoint_estimation::{
    Intrinsics, Measurement, MotionOptions, MotionPair, MotionPrior, PixelPair, Purpose, Rng,
    TwoViewOptions, find_camera_motion, find_fundamental, find_homography, p3p, rng, seven_point,
    test_degeneracy,
};
use stillpoint_geometry::{Se3, Vec2, Vec3, Vec6};

#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

const CAMERA: Intrinsics = Intrinsics {
    fx: 520.0,
    fy: 520.0,
    cx: 320.0,
    cy: 240.0,
};
const SIGMA_PX: f64 = 0.4;

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

fn project(p: &Vec3) -> Vec2 {
    Vec2::new(
        CAMERA.fx * p.x / p.z + CAMERA.cx,
        CAMERA.fy * p.y / p.z + CAMERA.cy,
    )
}

fn motion() -> Se3 {
    Se3::exp(&Vec6::new(0.03, -0.01, 0.02, 0.01, -0.02, 0.005))
}

/// Points before the motion and their pixels after it; a share of them is off by up to 20 px.
fn scene(count: usize, outliers: f64) -> Vec<(Vec3, Vec2, Vec2)> {
    let random = &mut rng(5, 0, Purpose(1000));
    let wrong = (count as f64 * outliers) as usize;
    (0..count)
        .map(|i| {
            let z = 0.7 + 4.0 * random.unit();
            let px = Vec2::new(640.0 * random.unit(), 480.0 * random.unit());
            let p = Vec3::new(
                (px.x - CAMERA.cx) / CAMERA.fx,
                (px.y - CAMERA.cy) / CAMERA.fy,
                1.0,
            ) * z;
            let mut q = project(&motion().transform(&p));
            if i < wrong {
                q += Vec2::new(random.unit() - 0.5, random.unit() - 0.5) * 40.0;
            }
            let noise = Vec2::new(normal(random), normal(random)) * SIGMA_PX;
            (p, px, q + noise)
        })
        .collect()
}

fn pixel_pairs(count: usize, outliers: f64) -> Vec<PixelPair> {
    let pairs = scene(count, outliers).into_iter();
    pairs.map(|(_, p, q)| (p.into(), q.into())).collect()
}

fn motion_pairs(count: usize, outliers: f64, depth: bool) -> Vec<MotionPair> {
    let random = &mut rng(6, 0, Purpose(1000));
    scene(count, outliers)
        .into_iter()
        .map(|(point, _, pixel)| {
            let z = motion().transform(&point).z;
            let sigma = 0.003 * z * z;
            let depth = depth.then(|| (z + sigma * normal(random), sigma));
            MotionPair {
                point,
                measurement: Measurement::new(pixel, SIGMA_PX, depth),
                weight: 1.0,
            }
        })
        .collect()
}

#[divan::bench(args = [0.1, 0.3, 0.5])]
fn fundamental_600(bencher: Bencher, outliers: f64) {
    let pairs = pixel_pairs(600, outliers);
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        find_fundamental(
            black_box(&pairs),
            &TwoViewOptions::default(),
            rng(1, frame, Purpose::FUNDAMENTAL),
        )
    });
}

#[divan::bench(args = [0.1, 0.3, 0.5])]
fn homography_600(bencher: Bencher, outliers: f64) {
    let pairs = pixel_pairs(600, outliers);
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        find_homography(
            black_box(&pairs),
            &TwoViewOptions::for_homography(),
            rng(1, frame, Purpose::HOMOGRAPHY),
        )
    });
}

#[divan::bench]
fn degeneracy_600(bencher: Bencher) {
    let pairs = pixel_pairs(600, 0.3);
    let random = rng(1, 1, Purpose::FUNDAMENTAL);
    let f = find_fundamental(&pairs, &TwoViewOptions::default(), random.clone());
    let h = find_homography(&pairs, &TwoViewOptions::default(), random);
    let (f, h) = (f.map(|f| f.f_matrix), h.map(|h| h.h_matrix));
    bencher.bench_local(|| test_degeneracy(black_box(&pairs), f.as_ref(), h.as_ref(), 0.5));
}

#[divan::bench(args = [0.1, 0.3, 0.5])]
fn camera_motion_300(bencher: Bencher, outliers: f64) {
    bench_motion(bencher, &motion_pairs(300, outliers, true), true);
}

#[divan::bench(args = [0.1, 0.3, 0.5])]
fn camera_motion_300_without_depth(bencher: Bencher, outliers: f64) {
    bench_motion(bencher, &motion_pairs(300, outliers, false), false);
}

fn bench_motion(bencher: Bencher, pairs: &[MotionPair], with_prior: bool) {
    let prior = MotionPrior {
        b_from_a: Se3::exp(&Vec6::new(0.004, 0.0, 0.003, 0.002, 0.002, 0.0)) * motion(),
        sigma_m: 0.01,
        sigma_rad: 0.01,
    };
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        find_camera_motion(
            &CAMERA,
            black_box(pairs),
            with_prior.then_some(&prior),
            &MotionOptions::default(),
            rng(1, frame, Purpose::CAMERA_MOTION),
        )
    });
}

#[divan::bench]
fn minimal_p3p(bencher: Bencher) {
    let points = [0, 100, 200].map(|i| scene(300, 0.0)[i].0);
    let bearings = points.map(|p| motion().transform(&p));
    bencher.bench_local(|| p3p(black_box(points), black_box(bearings)));
}

#[divan::bench]
fn minimal_seven_point(bencher: Bencher) {
    let pairs = pixel_pairs(7, 0.0);
    let near_one = |p: [f64; 2]| [p[0] / 200.0 - 1.6, p[1] / 200.0 - 1.2];
    let sample = std::array::from_fn(|i| (near_one(pairs[i].0), near_one(pairs[i].1)));
    bencher.bench_local(|| seven_point(black_box(&sample)));
}

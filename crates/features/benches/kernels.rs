//! Benchmarks of each stage of the extraction, and of matching: `cargo bench -p stillpoint-features`.
//!
//! On a generated texture of 640x480, and on a real frame if there is one under `STILLPOINT_DATA` (else
//! `../shared/data`).

use std::path::PathBuf;

use divan::{AllocProfiler, Bencher, black_box};
use stillpoint_features::{
    Descriptor, FeatureGrid, Features, Flow, FlowConfig, OrbConfig, OrbExtractor, Searched, Window,
    best_two, kernels::Stages, match_brute_force,
};
use stillpoint_imaging::{ColourImage, GrayImage, Pyramid, Simd};

/// Counts allocations: a second image of the same size should make none.
#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

/// The vector instruction set of the target.
const VECTORS: Simd = if cfg!(target_arch = "aarch64") {
    Simd::Neon
} else {
    Simd::Avx2
};

const CASES: [(Source, Simd); 4] = [
    (Source::Texture, Simd::Scalar),
    (Source::Texture, VECTORS),
    (Source::Real, Simd::Scalar),
    (Source::Real, VECTORS),
];

#[derive(Clone, Copy, Debug)]
enum Source {
    Texture,
    Real,
}

/// Tilted squares of random grey with noise of +-3 grey levels.
fn texture() -> GrayImage {
    let mut image = GrayImage::new(640, 480);
    let mut state = 1_u32;
    for (i, pixel) in image.data_mut().iter_mut().enumerate() {
        let (x, y) = ((i % 640) as i32, (i / 640) as i32);
        let mut value = 128;
        for cell in [61, 23] {
            let (u, v) = ((4 * x - 3 * y) / (5 * cell), (3 * x + 4 * y) / (5 * cell));
            value +=
                (u.wrapping_mul(7919) ^ v.wrapping_mul(104_729)).wrapping_mul(31_337) / 64 % 50;
        }
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        value += (state >> 24) as i32 % 7 - 3;
        *pixel = value.clamp(0, 255) as u8;
    }
    image
}

// Benchmarks may read environment variables; the library may not.
#[allow(clippy::disallowed_methods)]
fn real_files() -> Option<Vec<PathBuf>> {
    let root = std::env::var_os("STILLPOINT_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let mut files: Vec<_> = std::fs::read_dir(root.join("fr1_xyz/rgb"))
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    files.sort();
    Some(files)
}

fn load(file: &PathBuf) -> Option<GrayImage> {
    let decoded = image::open(file).ok()?.to_rgb8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    Some(
        ColourImage::from_vec(width, height, decoded.into_raw())
            .ok()?
            .to_gray(),
    )
}

fn real() -> Option<GrayImage> {
    let files = real_files()?;
    load(files.get(files.len() / 2)?)
}

/// The image of a case; the texture if there is no real one.
fn picture(source: Source) -> GrayImage {
    match source {
        Source::Texture => texture(),
        Source::Real => real().unwrap_or_else(texture),
    }
}

#[divan::bench(args = CASES)]
fn whole_extraction(bencher: Bencher, (source, simd): (Source, Simd)) {
    let image = picture(source);
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), simd);
    let mut features = Features::default();
    bencher.bench_local(|| extractor.extract(black_box(&image), &mut features));
}

/// Changing real frames, as in use: repeating one image flatters the branch predictor.
#[divan::bench(args = [Simd::Scalar, VECTORS], sample_count = 150)]
fn whole_extraction_changing(bencher: Bencher, simd: Simd) {
    let files = real_files().unwrap_or_default();
    let mut frames: Vec<_> = files.iter().step_by(6).filter_map(load).collect();
    if frames.is_empty() {
        frames.push(texture());
    }
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), simd);
    let mut features = Features::default();
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % frames.len();
        extractor.extract(black_box(&frames[next]), &mut features);
    });
}

#[divan::bench(args = CASES)]
fn pyramid(bencher: Bencher, (source, simd): (Source, Simd)) {
    let image = picture(source);
    let mut pyramid = Pyramid::new(5, 1.45, simd);
    bencher.bench_local(|| pyramid.build(black_box(&image)));
}

#[divan::bench(args = CASES)]
fn blur(bencher: Bencher, (source, simd): (Source, Simd)) {
    let mut pyramid = Pyramid::new(5, 1.45, simd);
    pyramid.build(&picture(source));
    bencher.bench_local(|| pyramid.smooth_all());
}

/// One set of stages and the images of each level.
fn levels(source: Source, simd: Simd) -> (Pyramid, Vec<Stages>) {
    let mut pyramid = Pyramid::new(5, 1.45, simd);
    pyramid.build(&picture(source));
    pyramid.smooth_all();
    let mut stages = vec![Stages::new(simd); 5];
    let quotas = [537, 256, 122, 58, 27];
    for level in 0..5 {
        stages[level].fast(pyramid.level(level));
        stages[level].spread(pyramid.level(level), quotas[level]);
    }
    (pyramid, stages)
}

#[divan::bench(args = CASES)]
fn fast(bencher: Bencher, (source, simd): (Source, Simd)) {
    let (pyramid, mut stages) = levels(source, simd);
    bencher.bench_local(|| {
        let found = |level: usize, stages: &mut Stages| stages.fast(pyramid.level(level));
        stages
            .iter_mut()
            .enumerate()
            .map(|(level, stages)| found(level, stages))
            .sum::<usize>()
    });
}

#[divan::bench(args = CASES)]
fn spread(bencher: Bencher, (source, simd): (Source, Simd)) {
    let (pyramid, mut stages) = levels(source, simd);
    bencher.bench_local(|| {
        let quotas = [537, 256, 122, 58, 27];
        for level in 0..5 {
            black_box(stages[level].spread(pyramid.level(level), quotas[level]));
        }
    });
}

#[divan::bench(args = CASES)]
fn orientation(bencher: Bencher, (source, simd): (Source, Simd)) {
    let (pyramid, stages) = levels(source, simd);
    bencher.bench_local(|| {
        for (level, stages) in stages.iter().enumerate() {
            black_box(stages.orient(pyramid.level(level)));
        }
    });
}

#[divan::bench(args = CASES)]
fn descriptors(bencher: Bencher, (source, simd): (Source, Simd)) {
    let (pyramid, mut stages) = levels(source, simd);
    bencher.bench_local(|| {
        for (level, stages) in stages.iter_mut().enumerate() {
            black_box(stages.describe(pyramid.smooth(level)));
        }
    });
}

fn features() -> Features {
    let mut features = Features::default();
    OrbExtractor::new(&OrbConfig::default(), Simd::detect()).extract(&texture(), &mut features);
    features
}

/// A thousand against a thousand.
#[divan::bench]
fn hamming_batch(bencher: Bencher) {
    let features = features();
    let all = features.descriptors;
    bencher.bench_local(|| match_brute_force(black_box(&all), &all, 50, 0.9));
}

/// The same distances one call at a time.
#[divan::bench]
fn hamming_single(bencher: Bencher) {
    let all = features().descriptors;
    let sum = |a: &Descriptor| all.iter().map(|b| a.distance(b)).sum::<u32>();
    bencher.bench_local(|| black_box(&all).iter().map(sum).sum::<u32>());
}

/// A thousand searches in windows of 15 px radius.
#[divan::bench]
fn windows(bencher: Bencher) {
    let features = features();
    let positions: Vec<_> = features.keypoints.iter().map(|k| [k.x, k.y]).collect();
    let levels: Vec<_> = features.keypoints.iter().map(|k| k.level).collect();
    let mut grid = FeatureGrid::default();
    bencher.bench_local(|| {
        grid.rebuild(&positions, &levels, [0.0, 0.0, 640.0, 480.0]);
        let searched = Searched {
            grid: &grid,
            positions: &positions,
            descriptors: &features.descriptors,
        };
        let mut sum = 0;
        for (keypoint, descriptor) in features.keypoints.iter().zip(&features.descriptors) {
            let window = Window {
                x: keypoint.x,
                y: keypoint.y,
                radius: 15.0,
                min_level: keypoint.level.saturating_sub(1),
                max_level: keypoint.level + 1,
            };
            let best = best_two(&searched, &window, descriptor, |_| true);
            sum += best.map_or(0, |best| best.distance);
        }
        sum
    });
}

/// Initial information on the motion.
#[derive(Clone, Copy, Debug)]
enum Start {
    /// None: the search uses all levels.
    Point,
    /// Positions with errors of up to 1.5 px in x and y.
    Guess,
}

/// A thousand points from a real frame to the next, and back. Without real frames the texture is tracked to itself.
#[divan::bench(args = [
    (Start::Point, Simd::Scalar),
    (Start::Point, VECTORS),
    (Start::Guess, Simd::Scalar),
    (Start::Guess, VECTORS),
])]
fn flow(bencher: Bencher, (start, simd): (Start, Simd)) {
    let files = real_files().unwrap_or_default();
    let middle = files.len() / 2;
    let frame = |i: usize| files.get(i).and_then(load).unwrap_or_else(texture);
    let mut extractor = OrbExtractor::new(&OrbConfig::default(), simd);
    let (mut features, mut second) = <(Features, Features)>::default();
    extractor.extract(&frame(middle), &mut features);
    extractor.extract(&frame(middle + 1), &mut second);
    let (previous, current) = (extractor.previous_pyramid(), extractor.pyramid());
    let points: Vec<_> = features.keypoints.iter().map(|k| [k.x, k.y]).collect();
    let mut flow = Flow::new(FlowConfig::default(), simd);
    let mut out = Vec::new();
    flow.track(previous, current, &points, None, &mut out);
    let mut state = 1_u32;
    let mut error = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 * 1.5 - 1.5
    };
    let near = out.iter().zip(&points).map(|(found, point)| {
        let [x, y] = found.map_or(*point, |found| found.position);
        [x + error(), y + error()]
    });
    let guesses: Vec<_> = near.collect();
    let guesses = match start {
        Start::Point => None,
        Start::Guess => Some(&guesses[..]),
    };
    bencher.bench_local(|| {
        flow.track(previous, current, black_box(&points), guesses, &mut out);
        out.iter().flatten().count()
    });
}

//! Time and memory of pose graph optimisation and full bundle adjustment on large synthetic maps.
//!
//! Keyframes are 0.2 m apart, with 50 points for each. One run per process, to measure its peak memory. Times are CPU times.

use crate::Failure;
use crate::experiments::shared::process::{computed, memory_mb};
use std::process::ExitCode;
use stillpoint::estimation::{
    BundleObservation, BundleOptions, BundleProblem, EdgeKernel, Intrinsics, Measurement,
    PoseGraph, PoseGraphEdge, PoseGraphOptions, Purpose, Rng, adjust_bundle, optimise_pose_graph,
    rng,
};
use stillpoint::geometry::{Mat6, Se3, Vec2, Vec3, Vec6};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[arg(value_enum, default_value_t = Kind::Path)]
    kind: Kind,
    #[arg(default_value_t = 500, value_parser = clap::value_parser!(u32).range(2..))]
    keyframes: u32,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Bundle adjustment of one loop of growing length
    Path,
    /// Bundle adjustment of repeated laps of 40 m
    Laps,
    /// Pose graph
    Graph,
}

const CAMERA: Intrinsics = Intrinsics {
    fx: 520.0,
    fy: 520.0,
    cx: 320.0,
    cy: 240.0,
};
/// Approximate number of observations per keyframe.
const PER_KEYFRAME: f64 = 400.0;

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let keyframes = arguments.keyframes as usize;
    let path_m = 0.2 * keyframes as f64;
    match arguments.kind {
        Kind::Graph => graph(keyframes),
        Kind::Laps => bundle(keyframes, path_m.min(40.0)),
        Kind::Path => bundle(keyframes, path_m),
    }
    println!("memory at most: {:.0} MB", memory_mb("VmHWM"));
    Ok(ExitCode::SUCCESS)
}

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

/// The pose `world_from_camera` at a position (m) on a circle, looking ahead.
fn pose(place: f64, length: f64) -> Se3 {
    let angle = place / length * std::f64::consts::TAU;
    let radius = length / std::f64::consts::TAU;
    Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, -angle, 0.0))
        * Se3::new(Default::default(), Vec3::new(radius, 0.0, 0.0))
}

/// Points along a circle, observed by keyframes that circle it; poses have errors of centimetres.
fn world(keyframes: usize, length: f64) -> BundleProblem {
    let random = &mut rng(1, 0, Purpose(1000));
    let truth: Vec<Se3> = (0..keyframes)
        .map(|i| pose(0.2 * i as f64, length))
        .collect();
    // Keyframes sorted by position, to find those that may observe a point.
    let mut by_place: Vec<(f64, usize)> = (0..keyframes)
        .map(|i| ((0.2 * i as f64) % length, i))
        .collect();
    by_place.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = 50 * keyframes;
    let candidates = 3.5 / length * keyframes as f64;
    let share = PER_KEYFRAME / (0.4 * count as f64 * candidates / keyframes as f64);
    let (mut points, mut observations) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let place = length * random.unit();
        let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
        let local = Vec3::new(
            side * (0.3 + 1.5 * random.unit()),
            2.0 * random.unit() - 1.0,
            0.0,
        );
        let point = pose(place, length).transform(&local);
        let before = observations.len();
        let ahead = by_place.partition_point(|k| k.0 < place - 4.0);
        let wrapped = by_place.partition_point(|k| k.0 < place - 4.0 + length);
        let seen_from = by_place[ahead..]
            .iter()
            .take_while(|k| k.0 < place - 0.5)
            .chain(by_place[wrapped..].iter().take_while(|_| place < 4.0));
        for (_, keyframe) in seen_from {
            let p = truth[*keyframe].inverse().transform(&point);
            let pixel = Vec2::new(520.0 * p.x / p.z + 320.0, 520.0 * p.y / p.z + 240.0);
            let visible =
                p.z > 0.5 && (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y);
            if visible && random.unit() < share {
                let sigma = 0.003 * p.z * p.z;
                let pixel = pixel + Vec2::new(normal(random), normal(random));
                let depth = Some((p.z + sigma * normal(random), sigma));
                observations.push(BundleObservation {
                    pose: *keyframe as u32,
                    point: points.len() as u32,
                    measurement: Measurement::new(pixel, 1.0, depth),
                });
            }
        }
        if observations.len() < before + 2 {
            observations.truncate(before);
            continue;
        }
        points.push(point + Vec3::new(normal(random), normal(random), normal(random)) * 0.02);
    }
    let poses = truth.iter().enumerate().map(|(i, t)| {
        let s = i as f64 / keyframes as f64 * std::f64::consts::TAU;
        let slow = 0.03 * libm::sin(s);
        let shake = Vec6::from_fn(|k, _| normal(random) * if k < 3 { 0.005 } else { 0.002 });
        let wrong = Se3::exp(&(shake + Vec6::new(slow, 0.0, slow, 0.0, 0.1 * slow, 0.0)));
        if i + 1 == keyframes {
            t.inverse()
        } else {
            (*t * wrong).inverse()
        }
    });
    BundleProblem {
        camera: CAMERA,
        poses: poses.collect(),
        free_poses: keyframes - 1,
        points,
        observations,
    }
}

fn bundle(keyframes: usize, length: f64) {
    let mut problem = world(keyframes, length);
    let truth = |i: usize| pose(0.2 * i as f64, length).inverse();
    let error = |p: &BundleProblem| {
        let squared = p.poses.iter().enumerate().map(|(i, pose)| {
            (pose.inverse().translation - truth(i).inverse().translation).norm_squared()
        });
        1000.0 * (squared.sum::<f64>() / p.poses.len() as f64).sqrt()
    };
    let before = error(&problem);
    println!(
        "{keyframes} keyframes on {length:.0} m, {} points, {} observations",
        problem.points.len(),
        problem.observations.len()
    );
    let start = computed();
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    let seconds = computed() - start;
    println!(
        "bundle: {seconds:.2} s, {} iterations, {:?}, {:.2e} products, {} blocks, cost {:.0}, error {before:.1} -> {:.1} mm",
        report.iterations,
        report.stop,
        report.work as f64,
        report.blocks,
        report.final_cost,
        error(&problem),
    );
}

/// A chain with drift, four further edges per keyframe, and loops where a lap of 40 m meets the previous one.
fn graph(keyframes: usize) {
    let random = &mut rng(2, 0, Purpose(1000));
    let truth: Vec<Se3> = (0..keyframes).map(|i| pose(0.2 * i as f64, 40.0)).collect();
    let (sigma_m, sigma_rad) = (0.003, 0.001);
    let mut edges = Vec::new();
    let mut measure = |a: usize, b: usize, kernel: EdgeKernel, random: &mut Rng| {
        let noise = Vec6::from_fn(|k, _| normal(random) * if k < 3 { sigma_m } else { sigma_rad });
        let w = [sigma_m, sigma_m, sigma_m, sigma_rad, sigma_rad, sigma_rad].map(|s| 1.0 / (s * s));
        edges.push(PoseGraphEdge {
            a: a as u32,
            b: b as u32,
            a_from_b: Se3::exp(&noise) * truth[a].inverse() * truth[b],
            information: Mat6::from_diagonal(&Vec6::from(w)),
            kernel,
        });
    };
    for i in 1..keyframes {
        for back in [1, 2, 3, 5].into_iter().filter(|b| *b <= i) {
            measure(i - back, i, EdgeKernel::Huber, random);
        }
        if i >= 200 {
            measure(i - 200, i, EdgeKernel::Scaled, random);
        }
    }
    let mut nodes = vec![truth[0]];
    for i in 1..keyframes as u32 {
        // Every node has an edge from its predecessor.
        let step = edges.iter().find(|e| (e.a, e.b) == (i - 1, i));
        let step = step.map_or(Se3::identity(), |e| e.a_from_b);
        nodes.push(nodes[i as usize - 1] * step);
    }
    let mut fixed = vec![false; keyframes];
    fixed[0] = true;
    let mut graph = PoseGraph {
        nodes,
        fixed,
        edges,
    };
    let error = |g: &PoseGraph| {
        let distances = g.nodes.iter().zip(&truth);
        let largest = distances.map(|(a, b)| (a.translation - b.translation).norm());
        1000.0 * largest.fold(0.0, f64::max)
    };
    let before = error(&graph);
    let start = computed();
    let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
    let seconds = computed() - start;
    println!(
        "graph: {keyframes} poses, {} edges: {seconds:.3} s, {} iterations, {:?}, factor of {} blocks, worst pose {before:.0} -> {:.1} mm",
        graph.edges.len(),
        report.iterations,
        report.outcome,
        report.factor_blocks,
        error(&graph),
    );
}

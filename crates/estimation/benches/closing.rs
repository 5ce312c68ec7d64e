//! Benchmarks of loop closing and relocalisation: `cargo bench -p stillpoint-estimation --bench closing`. For whole
//! maps see the example `scale`.

use divan::{Bencher, black_box};
use stillpoint_estimation::{
    AbsolutePoseOptions, EdgeKernel, Intrinsics, Measurement, PoseGraph, PoseGraphEdge,
    PoseGraphOptions, PoseObservation, Purpose, RigidOptions, RigidPair, Rng, find_absolute_pose,
    find_rigid, optimise_pose_graph, rng,
};
use stillpoint_geometry::{Mat6, Se3, Vec2, Vec3, Vec6};

fn main() {
    divan::main();
}

const CAMERA: Intrinsics = Intrinsics {
    fx: 520.0,
    fy: 520.0,
    cx: 320.0,
    cy: 240.0,
};

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

fn anywhere(random: &mut Rng) -> Vec3 {
    let z = 0.8 + 3.0 * random.unit();
    Vec3::new(1.2 * random.unit() - 0.6, 0.9 * random.unit() - 0.45, 1.0) * z
}

fn see(p: &Vec3, random: &mut Rng) -> Measurement {
    let pixel = Vec2::new(520.0 * p.x / p.z + 320.0, 520.0 * p.y / p.z + 240.0);
    let noise = Vec2::new(normal(random), normal(random));
    let sigma = 0.003 * p.z * p.z;
    let z = p.z + sigma * normal(random);
    Measurement::new(pixel + noise, 1.0, Some((z, sigma)))
}

fn motion() -> Se3 {
    Se3::exp(&Vec6::new(0.2, -0.05, 0.1, 0.05, -0.2, 0.02))
}

/// 200 pairs, of which a share are outliers.
fn pairs(outliers: f64) -> Vec<RigidPair> {
    let random = &mut rng(5, 0, Purpose(1000));
    (0..200)
        .map(|i| {
            let point_a = anywhere(random);
            let point_b = if (i as f64) < 200.0 * outliers {
                anywhere(random)
            } else {
                motion().transform(&point_a)
            };
            RigidPair {
                point_a,
                point_b,
                measurement_a: see(&point_a, random),
                measurement_b: see(&point_b, random),
            }
        })
        .collect()
}

/// 1.0: two places that only look alike.
#[divan::bench(args = [0.2, 0.5, 0.8, 1.0])]
fn rigid_200(bencher: Bencher, outliers: f64) {
    let pairs = pairs(outliers);
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        let random = rng(1, frame, Purpose::RIGID);
        find_rigid(&CAMERA, black_box(&pairs), &RigidOptions::default(), random)
    });
}

#[divan::bench(args = [0.2, 0.5, 0.8, 1.0])]
fn absolute_pose_200(bencher: Bencher, outliers: f64) {
    let observations: Vec<PoseObservation> = pairs(outliers)
        .iter()
        .map(|p| PoseObservation {
            point: p.point_a,
            measurement: p.measurement_b,
        })
        .collect();
    let mut frame = 0;
    bencher.bench_local(|| {
        frame += 1;
        let random = rng(1, frame, Purpose(7));
        let options = AbsolutePoseOptions::default();
        find_absolute_pose(&CAMERA, black_box(&observations), &options, random)
    });
}

/// A path of 40 m with large drift, closed by three loops.
#[divan::bench(args = [200, 2000])]
fn pose_graph(bencher: Bencher, count: usize) {
    let random = &mut rng(6, 0, Purpose(1000));
    let step = Se3::exp(&Vec6::new(
        0.0,
        0.0,
        40.0 / count as f64,
        0.0,
        std::f64::consts::TAU / count as f64,
        0.0,
    ));
    let mut truth = vec![Se3::identity()];
    for i in 1..count {
        truth.push(truth[i - 1] * step);
    }
    let sigma = [0.005, 0.005, 0.005, 0.002, 0.002, 0.002];
    let information = Mat6::from_diagonal(&Vec6::from(sigma.map(|s| 1.0 / (s * s))));
    let mut edge = |a: usize, b: usize, kernel| PoseGraphEdge {
        a: a as u32,
        b: b as u32,
        a_from_b: Se3::exp(&Vec6::from_fn(|k, _| sigma[k] * normal(random)))
            * truth[a].inverse()
            * truth[b],
        information,
        kernel,
    };
    let mut edges: Vec<_> = (1..count)
        .map(|i| edge(i - 1, i, EdgeKernel::Huber))
        .collect();
    let mut nodes = vec![truth[0]];
    for (i, e) in edges.iter().enumerate() {
        nodes.push(nodes[i] * e.a_from_b);
    }
    edges.extend((0..3).map(|i| edge(i, count - 3 + i, EdgeKernel::Scaled)));
    let mut fixed = vec![false; count];
    fixed[0] = true;
    let graph = PoseGraph {
        nodes,
        fixed,
        edges,
    };
    bencher
        .with_inputs(|| graph.clone())
        .bench_local_values(|mut g| {
            let report = optimise_pose_graph(&mut g, &PoseGraphOptions::default());
            (g, report)
        });
}

//! Pose graphs on paths with known truth: drift, wrong loops, invalid input.

use proptest::prelude::*;
use stillpoint_estimation::{
    EdgeKernel, PoseGraph, PoseGraphEdge, PoseGraphOptions, PoseGraphOutcome, PoseGraphRefusal,
    Purpose, Rng, optimise_pose_graph, rng,
};
use stillpoint_geometry::{Mat6, Se3, Vec3, Vec6};

const SIGMA_M: f64 = 0.01;
const SIGMA_RAD: f64 = 0.005;

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

/// Poses along a closed path of 40 m, looking ahead.
fn circle(count: usize) -> Vec<Se3> {
    let radius = 40.0 / std::f64::consts::TAU;
    (0..count)
        .map(|i| {
            let angle = i as f64 / count as f64 * std::f64::consts::TAU;
            Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, -angle, 0.0))
                * Se3::new(Default::default(), Vec3::new(radius, 0.0, 0.0))
        })
        .collect()
}

fn information(share: f64) -> Mat6 {
    let (t, r) = (SIGMA_M * share, SIGMA_RAD * share);
    let w = [t, t, t, r, r, r].map(|s| 1.0 / (s * s));
    Mat6::from_diagonal(&Vec6::from(w))
}

/// The measured motion between two poses, with scaled noise.
fn measured(truth: &[Se3], (a, b): (usize, usize), share: f64, random: &mut Rng) -> PoseGraphEdge {
    let noise =
        Vec6::from_fn(|k, _| normal(random) * share * if k < 3 { SIGMA_M } else { SIGMA_RAD });
    PoseGraphEdge {
        a: a as u32,
        b: b as u32,
        a_from_b: Se3::exp(&noise) * truth[a].inverse() * truth[b],
        information: information(share),
        kernel: EdgeKernel::Huber,
    }
}

/// A chain of measured motions, with accumulated drift in the nodes.
fn chain(truth: &[Se3], share: f64, random: &mut Rng) -> PoseGraph {
    let edges: Vec<_> = (1..truth.len())
        .map(|i| measured(truth, (i - 1, i), share, random))
        .collect();
    let mut nodes = vec![truth[0]];
    for (i, e) in edges.iter().enumerate() {
        nodes.push(nodes[i] * e.a_from_b);
    }
    let mut fixed = vec![false; truth.len()];
    fixed[0] = true;
    PoseGraph {
        nodes,
        fixed,
        edges,
    }
}

fn close(graph: &mut PoseGraph, truth: &[Se3], ends: (usize, usize), random: &mut Rng) {
    let mut edge = measured(truth, ends, 1.0, random);
    edge.kernel = EdgeKernel::Scaled;
    graph.edges.push(edge);
}

fn false_loop(ends: (usize, usize), random: &mut Rng) -> PoseGraphEdge {
    PoseGraphEdge {
        a: ends.0 as u32,
        b: ends.1 as u32,
        a_from_b: Se3::exp(&Vec6::from_fn(|_, _| 0.2 * normal(random))),
        information: information(1.0),
        kernel: EdgeKernel::Scaled,
    }
}

/// The largest distance from the truth, m.
fn worst(graph: &PoseGraph, truth: &[Se3]) -> f64 {
    let distances = graph.nodes.iter().zip(truth);
    distances
        .map(|(a, b)| (a.translation - b.translation).norm())
        .fold(0.0, f64::max)
}

/// Error of the relative position of the path's ends, m.
fn gap(graph: &PoseGraph, truth: &[Se3]) -> f64 {
    let (n, last) = (&graph.nodes, truth.len() - 1);
    let e = n[0].inverse() * n[last] * (truth[0].inverse() * truth[last]).inverse();
    e.translation.norm()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// A 40 m loop with about a metre of drift is closed.
    #[test]
    fn correct_loop_removes_accumulated_drift(seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let truth = circle(200);
        let mut graph = chain(&truth, 3.0, random);
        let drift = gap(&graph, &truth);
        close(&mut graph, &truth, (0, 199), random);
        let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
        prop_assert_eq!(report.outcome, PoseGraphOutcome::Converged);
        prop_assert!(gap(&graph, &truth) < 0.05, "{drift} -> {}", gap(&graph, &truth));
        prop_assert!(report.final_cost <= report.initial_cost);
        prop_assert!(report.edges[199].weight > 0.99, "{:?}", report.edges[199]);
        prop_assert_eq!(graph.nodes[0], truth[0]);
    }

    /// False loops lose their weight; with full weight they ruin the map.
    #[test]
    fn false_loops_lose_their_weight(seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let truth = circle(200);
        let mut graph = chain(&truth, 0.5, random);
        for i in 0..5 {
            close(&mut graph, &truth, (i, 195 + i), random);
        }
        for ends in [(20, 120), (60, 170), (40, 90)] {
            graph.edges.push(false_loop(ends, random));
        }
        let mut believed = graph.clone();
        let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
        prop_assert_eq!(report.outcome, PoseGraphOutcome::Converged);
        prop_assert!(worst(&graph, &truth) < 0.6, "{}", worst(&graph, &truth));
        for fit in &report.edges[199..204] {
            prop_assert!(fit.weight > 0.5, "{fit:?}");
        }
        for fit in &report.edges[204..] {
            prop_assert!(fit.weight < 1e-3 && fit.chi2 > 1000.0, "{fit:?}");
        }
        for kernel in [EdgeKernel::Square, EdgeKernel::Huber] {
            for e in &mut believed.edges[199..] {
                e.kernel = kernel;
            }
            let mut control = believed.clone();
            let _ = optimise_pose_graph(&mut control, &PoseGraphOptions::default());
            prop_assert!(worst(&control, &truth) > 2.0 * worst(&graph, &truth));
        }
    }

    /// Without noise the truth is recovered from far away, for any graph and order.
    #[test]
    fn noise_free_graph_recovers_the_truth(seed in any::<u64>(), extra in 1usize..80) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let truth = circle(60);
        let mut graph = chain(&truth, 0.0, random);
        for e in &mut graph.edges {
            e.information = information(1.0);
        }
        for _ in 0..extra {
            let (a, b) = (random.below(60), random.below(60));
            if a != b {
                let mut edge = measured(&truth, (a, b), 0.0, random);
                edge.information = information(1.0);
                graph.edges.push(edge);
            }
        }
        for node in &mut graph.nodes[1..] {
            *node = Se3::exp(&Vec6::from_fn(|_, _| 0.15 * normal(random))) * *node;
        }
        let count = graph.edges.len();
        for i in 0..count {
            graph.edges.swap(i, i + random.below(count - i));
        }
        let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
        prop_assert_eq!(report.outcome, PoseGraphOutcome::Converged);
        prop_assert!(worst(&graph, &truth) < 1e-4, "{}", worst(&graph, &truth));
        prop_assert!(report.final_cost < 1e-3);
    }

    /// Transforming the world transforms the result.
    #[test]
    fn result_is_independent_of_the_world_frame(seed in any::<u64>(), twist in prop::array::uniform6(-3.0..3.0f64)) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let truth = circle(50);
        let mut here = chain(&truth, 1.0, random);
        close(&mut here, &truth, (0, 49), random);
        let mut there = here.clone();
        let moved = Se3::exp(&(Vec6::from(twist) * 0.5));
        for n in &mut there.nodes {
            *n = moved * *n;
        }
        let (a, b) = (
            optimise_pose_graph(&mut here, &PoseGraphOptions::default()),
            optimise_pose_graph(&mut there, &PoseGraphOptions::default()),
        );
        prop_assert!((a.final_cost - b.final_cost).abs() < 1e-5 * (1.0 + a.final_cost));
        for (a, b) in here.nodes.iter().zip(&there.nodes) {
            prop_assert!((moved * *a * b.inverse()).log().norm() < 1e-3);
        }
    }
}

/// Why gates are graduated: after a large drift the final gate rejects good loops.
#[test]
fn without_graduation_correct_loops_are_rejected() {
    let closed = |graduation: f64| {
        let closes = |seed: &u64| {
            let random = &mut rng(*seed, 0, Purpose(1000));
            let truth = circle(200);
            let mut graph = chain(&truth, 3.0, random);
            close(&mut graph, &truth, (0, 199), random);
            let options = PoseGraphOptions {
                graduation,
                ..PoseGraphOptions::default()
            };
            let _ = optimise_pose_graph(&mut graph, &options);
            gap(&graph, &truth) < 0.05
        };
        (0..10).filter(closes).count()
    };
    assert_eq!(closed(4.0), 10);
    assert!(closed(1.0) < 10);
}

/// 2000 poses in ten laps, with loops to the lap before.
#[test]
fn long_chain_converges() {
    let random = &mut rng(3, 0, Purpose(1000));
    let lap = circle(200);
    let truth: Vec<Se3> = (0..2000).map(|i| lap[i % 200]).collect();
    let mut graph = chain(&truth, 0.5, random);
    let before = worst(&graph, &truth);
    for i in (200..2000).step_by(20) {
        close(&mut graph, &truth, (i - 200, i), random);
    }
    let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
    assert_eq!(report.outcome, PoseGraphOutcome::Converged);
    let after = worst(&graph, &truth);
    assert!(after < 0.5 && after < 0.1 * before, "{before} -> {after}");
    assert!(report.edges.iter().all(|e| e.weight > 0.3));
    // The factor of a ring of laps is sparse: a dense one would have two million blocks.
    assert!(report.factor_blocks < 60_000, "{}", report.factor_blocks);
}

#[test]
fn same_graph_gives_identical_results() {
    let run = || {
        let random = &mut rng(3, 0, Purpose(1000));
        let truth = circle(100);
        let mut graph = chain(&truth, 1.0, random);
        close(&mut graph, &truth, (0, 99), random);
        let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
        format!("{:?} {report:?}", graph.nodes)
    };
    assert_eq!(run(), run());
}

/// Components without a fixed pose are held at their first one; a pose without edges stays.
#[test]
fn disconnected_graph_is_optimised_by_component() {
    let random = &mut rng(3, 0, Purpose(1000));
    let truth = circle(60);
    let mut graph = chain(&truth, 1.0, random);
    close(&mut graph, &truth, (0, 29), random);
    graph.edges.retain(|e| e.b != 30 && e.b != 59);
    let before = graph.nodes.clone();
    let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
    assert_eq!(report.outcome, PoseGraphOutcome::Converged);
    assert_eq!(report.held, [30, 59]);
    for i in [0, 30, 59] {
        assert_eq!(graph.nodes[i], before[i]);
    }
    assert!(graph.nodes.iter().all(Se3::is_finite));
    assert_ne!(graph.nodes[15], before[15]);
    assert!((graph.nodes[45].translation - before[45].translation).norm() < 1e-9);
}

#[test]
fn iteration_limits_are_respected() {
    let random = &mut rng(3, 0, Purpose(1000));
    let truth = circle(200);
    let mut graph = chain(&truth, 3.0, random);
    close(&mut graph, &truth, (0, 199), random);
    let start = graph.clone();
    let options = PoseGraphOptions {
        max_iterations: 2,
        ..PoseGraphOptions::default()
    };
    let report = optimise_pose_graph(&mut graph, &options);
    assert_eq!(
        (report.outcome, report.iterations),
        (PoseGraphOutcome::IterationLimit, 2)
    );
    let options = PoseGraphOptions {
        max_iterations: 0,
        ..options
    };
    let mut graph = start.clone();
    let report = optimise_pose_graph(&mut graph, &options);
    assert_eq!(report.outcome, PoseGraphOutcome::IterationLimit);
    assert!((graph.nodes[100].inverse() * start.nodes[100]).log().norm() < 1e-12);
}

#[test]
fn invalid_graphs_are_refused() {
    let random = &mut rng(3, 0, Purpose(1000));
    let truth = circle(20);
    let good = chain(&truth, 1.0, random);
    let check = |change: &dyn Fn(&mut PoseGraph), expected: PoseGraphRefusal| {
        let mut graph = good.clone();
        change(&mut graph);
        let before = format!("{graph:?}");
        let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
        assert_eq!(report.outcome, PoseGraphOutcome::Refused(expected));
        assert_eq!(format!("{graph:?}"), before);
    };
    use PoseGraphRefusal::{Edge, LengthsDiffer, Node};
    check(&|g| g.fixed.truncate(3), LengthsDiffer);
    check(&|g| g.nodes[4].translation.x = f64::NAN, Node(4));
    check(
        &|g| {
            g.nodes[4].rotation =
                stillpoint_geometry::nalgebra::UnitQuaternion::new_unchecked(Default::default())
        },
        Node(4),
    );
    check(
        &|g| g.edges[5].a_from_b.translation.y = f64::INFINITY,
        Edge(5),
    );
    check(&|g| g.edges[5].a_from_b.translation.y = 1e200, Edge(5));
    check(&|g| g.edges[5].information[(2, 2)] = f64::NAN, Edge(5));
    check(&|g| g.edges[5].information[(2, 2)] = -1.0, Edge(5));
    check(&|g| g.edges[5].information[(2, 3)] = 1e4, Edge(5));
    check(&|g| g.edges[5].a = 20, Edge(5));
    check(&|g| g.edges[5].a = g.edges[5].b, Edge(5));
}

#[test]
fn graphs_without_free_poses_are_accepted() {
    let random = &mut rng(3, 0, Purpose(1000));
    let mut graph = chain(&circle(10), 1.0, random);
    graph.fixed.fill(true);
    let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
    assert_eq!(report.outcome, PoseGraphOutcome::NothingFree);
    assert_eq!(report.edges.len(), 9);
    for nodes in [0, 1, 5] {
        let mut empty = PoseGraph {
            nodes: vec![Se3::identity(); nodes],
            fixed: vec![false; nodes],
            edges: Vec::new(),
        };
        let report = optimise_pose_graph(&mut empty, &PoseGraphOptions::default());
        assert_eq!(report.outcome, PoseGraphOutcome::NothingFree);
    }
    // An edge without information leaves its poses unchanged.
    let mut graph = chain(&circle(3), 1.0, random);
    for e in &mut graph.edges {
        e.information = Mat6::zeros();
    }
    let before = graph.nodes.clone();
    let report = optimise_pose_graph(&mut graph, &PoseGraphOptions::default());
    assert_eq!(report.outcome, PoseGraphOutcome::Converged);
    assert!((graph.nodes[2].inverse() * before[2]).log().norm() < 1e-9);
}

//! Pose graph optimisation: poses connected by relative motions, some of which may be wrong.

mod graduated;
mod system;

use stillpoint_geometry::{Mat6, Se3};

/// A measured motion between two poses.
#[derive(Clone, Copy, Debug)]
pub struct PoseGraphEdge {
    /// Index of the pose whose coordinates the motion maps to.
    pub a: u32,
    /// Index of the pose whose coordinates it maps from.
    pub b: u32,
    /// The measured motion.
    pub a_from_b: Se3,
    /// Its inverse covariance, for a left perturbation `[translation; rotation]` of `a_from_b` (1/m^2, 1/rad^2), as
    /// [`optimise_pose`](crate::optimise_pose) and [`find_rigid`](crate::find_rigid) return. Symmetric, positive
    /// semidefinite.
    pub information: Mat6,
    /// Robust kernel.
    pub kernel: EdgeKernel,
}

/// Cost of a squared Mahalanobis residual of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeKernel {
    /// Quadratic: the edge is right.
    Square,
    /// Grows linearly beyond the gate (Huber 1964): the edge may be poor, but is no mistake.
    Huber,
    /// Saturates at three gates, as dynamic covariance scaling does (Agarwal et al., "Robust map optimization using
    /// dynamic covariance scaling", ICRA 2013): the edge may be entirely wrong, and then has no influence. For loops.
    Scaled,
}

/// Poses and the motions between them.
#[derive(Clone, Debug)]
pub struct PoseGraph {
    /// Poses `world_from_camera`; changed in place.
    pub nodes: Vec<Se3>,
    /// Per pose: fixed.
    pub fixed: Vec<bool>,
    /// Measured motions.
    pub edges: Vec<PoseGraphEdge>,
}

/// Effort and kernel of pose graph optimisation.
#[derive(Clone, Copy, Debug)]
pub struct PoseGraphOptions {
    /// Maximum total number of iterations, each with at least one linear system.
    pub max_iterations: usize,
    /// Squared gate of the kernels. The default is the 95 % quantile of chi-square with 6 degrees of freedom.
    pub gate: f64,
    /// Factor between the gates of two stages, at least 1.25 (1 or less: no stages): the gate of edges with
    /// [`EdgeKernel::Scaled`] starts at their initial residual and shrinks by this factor from stage to stage down to
    /// `gate` (graduated non-convexity: Yang et al., RA-L 2020). Otherwise a good loop after a large drift would be
    /// rejected.
    pub graduation: f64,
    /// Stops when the cost falls by less than this share.
    pub min_relative_gain: f64,
}

/// 95 % quantile of chi-square with 6 degrees of freedom, a whole pose.
pub(crate) const CHI2_95_6: f64 = 12.591_587_243_743_977;

impl Default for PoseGraphOptions {
    fn default() -> Self {
        Self {
            max_iterations: 100,
            gate: CHI2_95_6,
            graduation: 4.0,
            min_relative_gain: 1e-6,
        }
    }
}

/// How pose graph optimisation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseGraphOutcome {
    /// No step gains more than the minimum gain.
    Converged,
    /// `max_iterations` were used up; the poses are no worse than before.
    IterationLimit,
    /// All poses are fixed or there are no edges.
    NothingFree,
    /// The input is invalid; nothing was changed.
    Refused(PoseGraphRefusal),
}

/// Why a pose graph was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseGraphRefusal {
    /// `nodes` and `fixed` differ in length.
    LengthsDiffer,
    /// A pose is not finite.
    Node(u32),
    /// An edge refers to a missing pose or twice to one pose, is not finite, has an information matrix that is not
    /// symmetric and positive semidefinite, or a residual that overflows.
    Edge(u32),
}

/// Fit of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFit {
    /// Squared Mahalanobis residual at the end.
    pub chi2: f64,
    /// Weight left by the kernel, 0 to 1; a loop with a weight near 0 contradicts the rest.
    pub weight: f64,
}

/// Result of pose graph optimisation; the poses are in the graph.
#[derive(Clone, Debug)]
pub struct PoseGraphReport {
    /// How it ended.
    pub outcome: PoseGraphOutcome,
    /// Linear systems built.
    pub iterations: usize,
    /// Robust cost before the first iteration.
    pub initial_cost: f64,
    /// Robust cost at the end.
    pub final_cost: f64,
    /// Per edge, in the order of the input; empty if refused.
    pub edges: Vec<EdgeFit>,
    /// Poses that were held although not fixed: the first one of each component without a fixed pose.
    pub held: Vec<u32>,
    /// 6x6 blocks of the Cholesky factor, 288 bytes each.
    pub factor_blocks: usize,
}

impl PoseGraphReport {
    fn without_work(outcome: PoseGraphOutcome) -> Self {
        Self {
            outcome,
            iterations: 0,
            initial_cost: 0.0,
            final_cost: 0.0,
            edges: Vec::new(),
            held: Vec::new(),
            factor_blocks: 0,
        }
    }
}

/// Minimises over the free poses `T` the sum of `rho(e^T Omega e)` with `e = log(T_a^-1 T_b z^-1)` for each measured
/// motion `z`, by Levenberg-Marquardt with exact Jacobians (Grisetti et al., "A tutorial on graph-based SLAM", 2010;
/// algorithm.md, equations L1 to L4) and a sparse Cholesky factorisation.
///
/// Components without a fixed pose are held at their first one, so a graph need not be connected.
#[must_use]
pub fn optimise_pose_graph(graph: &mut PoseGraph, options: &PoseGraphOptions) -> PoseGraphReport {
    if let Some(refusal) = refusal(graph) {
        return PoseGraphReport::without_work(PoseGraphOutcome::Refused(refusal));
    }
    let (held, still) = gauge(graph);
    graduated::minimise(graph, options, held, &still)
}

fn refusal(graph: &PoseGraph) -> Option<PoseGraphRefusal> {
    let count = graph.nodes.len();
    if graph.fixed.len() != count {
        return Some(PoseGraphRefusal::LengthsDiffer);
    }
    if let Some(bad) = graph.nodes.iter().position(|n| !is_pose(n)) {
        return Some(PoseGraphRefusal::Node(bad as u32));
    }
    let good = |e: &PoseGraphEdge| {
        let (a, b) = (e.a as usize, e.b as usize);
        a != b
            && a < count
            && b < count
            && is_pose(&e.a_from_b)
            && is_information(&e.information)
            && system::chi2(e, &graph.nodes[a], &graph.nodes[b]) < 1e100
    };
    let bad = graph.edges.iter().position(|e| !good(e));
    bad.map(|i| PoseGraphRefusal::Edge(i as u32))
}

/// Finite, with a unit quaternion.
fn is_pose(p: &Se3) -> bool {
    p.is_finite() && (p.rotation.coords.norm() - 1.0).abs() < 1e-3
}

fn is_information(m: &Mat6) -> bool {
    let trace = m.trace();
    if !m.iter().all(|v| v.is_finite()) || !trace.is_finite() || trace < 0.0 {
        return false;
    }
    if trace == 0.0 {
        return m.amax() == 0.0;
    }
    // A matrix that is positive semidefinite up to rounding becomes definite with a slightly larger diagonal.
    let lifted = m / trace + Mat6::identity() * 1e-9;
    (m - m.transpose()).amax() <= 1e-9 * trace && lifted.cholesky().is_some()
}

/// Additional poses to hold, and for each pose whether it is fixed or held.
fn gauge(graph: &PoseGraph) -> (Vec<u32>, Vec<bool>) {
    let mut root: Vec<u32> = (0..graph.nodes.len() as u32).collect();
    fn find(root: &mut [u32], mut v: u32) -> u32 {
        while root[v as usize] != v {
            root[v as usize] = root[root[v as usize] as usize];
            v = root[v as usize];
        }
        v
    }
    for e in &graph.edges {
        let (a, b) = (find(&mut root, e.a), find(&mut root, e.b));
        // The lower number becomes the root, so a component's root is its first pose.
        root[a.max(b) as usize] = a.min(b);
    }
    let mut anchored = vec![false; graph.nodes.len()];
    for (v, fixed) in graph.fixed.iter().enumerate() {
        if *fixed {
            anchored[find(&mut root, v as u32) as usize] = true;
        }
    }
    let (mut held, mut still) = (Vec::new(), graph.fixed.clone());
    for v in 0..root.len() {
        if root[v] == v as u32 && !anchored[v] {
            held.push(v as u32);
            still[v] = true;
        }
    }
    (held, still)
}

//! The reduced pose system of bundle adjustment, for any number of poses.

use crate::BundleProblem;
use crate::gradients;
use crate::schur::{System, across, subtract_product, times};
use crate::sparse::{Block, Pattern};
use stillpoint_geometry::{Mat3, Vec6};

/// Number of free poses up to which the reduced system is dense: in a local window, which is at most this large, nearly
/// all poses have points in common (decision 11).
pub(crate) const DENSE_POSES: usize = 100;

pub(crate) enum Method {
    /// Dense.
    Dense,
    /// Sparse Cholesky factorisation.
    Factor(Pattern),
    /// Conjugate gradients, where the factor would be nearly full.
    Iterate(Pattern),
}

/// Solver and its cost, which depend only on the active observations.
pub(crate) struct Plan {
    pub(crate) method: Method,
    /// Cost of one solution, in products of two 6x6 blocks.
    pub(crate) work: u64,
}

impl Plan {
    pub(crate) fn new(problem: &BundleProblem, active: &[bool]) -> Self {
        let free = problem.free_poses;
        let seen = Observers::new(problem, active);
        // A pair of observations of a point takes the product of a 6x3 and a 3x6 block, half of a product.
        let pairs: u64 = seen
            .poses
            .iter()
            .map(|p| (p.len() * (p.len() + 1) / 2) as u64)
            .sum();
        if free <= DENSE_POSES {
            let n = free as u64;
            return Self {
                method: Method::Dense,
                work: pairs / 2 + n * (n + 1) * (n + 2) / 6,
            };
        }
        let neighbours = seen.neighbours(free);
        let filled = Pattern::new(neighbours.clone());
        let plain = Pattern::without_fill(neighbours);
        // An iteration multiplies each block and its transpose with a vector, a third of a product.
        let iterations = gradients::MAX_ITERATIONS * plain.blocks() as u64 / 3;
        let (method, solution) = if filled.products() <= iterations {
            let products = filled.products();
            (Method::Factor(filled), products)
        } else {
            (Method::Iterate(plain), iterations)
        };
        Self {
            method,
            work: pairs / 2 + solution,
        }
    }

    pub(crate) fn blocks(&self, free: usize) -> usize {
        match &self.method {
            Method::Dense => free * (free + 1) / 2,
            Method::Factor(pattern) | Method::Iterate(pattern) => pattern.blocks(),
        }
    }
}

/// Per point: the free poses that actively observe it.
struct Observers {
    poses: Vec<Vec<u32>>,
}

impl Observers {
    fn new(problem: &BundleProblem, active: &[bool]) -> Self {
        let mut poses = vec![Vec::new(); problem.points.len()];
        for (o, _) in problem.observations.iter().zip(active).filter(|(_, a)| **a) {
            if (o.pose as usize) < problem.free_poses {
                poses[o.point as usize].push(o.pose);
            }
        }
        Self { poses }
    }

    /// The poses that share a point with each pose.
    fn neighbours(&self, free: usize) -> Vec<Vec<u32>> {
        let mut points = vec![Vec::new(); free];
        for (point, poses) in self.poses.iter().enumerate() {
            for pose in poses {
                points[*pose as usize].push(point as u32);
            }
        }
        let mut mark = vec![u32::MAX; free];
        let of = |(pose, points): (usize, &Vec<u32>)| {
            mark[pose] = pose as u32;
            let mut found = Vec::new();
            for point in points {
                for other in &self.poses[*point as usize] {
                    if mark[*other as usize] != pose as u32 {
                        mark[*other as usize] = pose as u32;
                        found.push(*other);
                    }
                }
            }
            found.sort_unstable();
            found
        };
        points.iter().enumerate().map(of).collect()
    }
}

/// Solves the damped reduced system by sparse factorisation; `None` if it is not positive definite.
pub(crate) fn solve_by_factor(
    system: &System,
    pattern: &Pattern,
    lambda: f64,
    inverses: &[Option<Mat3>],
) -> Option<Vec<Vec6>> {
    let (values, rhs) = reduce(system, pattern, lambda, inverses);
    finite(pattern.factor(values)?.solve(&rhs))
}

/// Solves the damped reduced system by conjugate gradients; `None` if it is not positive definite.
pub(crate) fn solve_by_gradients(
    system: &System,
    pattern: &Pattern,
    lambda: f64,
    inverses: &[Option<Mat3>],
) -> Option<Vec<Vec6>> {
    let (values, rhs) = reduce(system, pattern, lambda, inverses);
    finite(gradients::solve(pattern, &values, &rhs)?)
}

fn finite(x: Vec<Vec6>) -> Option<Vec<Vec6>> {
    let finite = |s: &Vec6| s.iter().all(|v| v.is_finite());
    x.iter().all(finite).then_some(x)
}

/// The blocks and the right hand side of the damped reduced system.
fn reduce(
    system: &System,
    pattern: &Pattern,
    lambda: f64,
    inverses: &[Option<Mat3>],
) -> (Vec<Block>, Vec<[f64; 6]>) {
    let crosses = ByPose::new(system, pattern.count());
    let mut values: Vec<Block> = vec![[[0.0; 6]; 6]; pattern.blocks()];
    let mut rhs = system.pose_b.clone();
    let mut slot = vec![0_u32; pattern.count()];
    // Column by column, to keep the working set small and avoid searching for blocks.
    for k in 0..pattern.count() {
        let (first, rows) = pattern.column(k);
        for (offset, row) in rows.iter().enumerate() {
            slot[*row as usize] = offset as u32;
        }
        let column = &mut values[first..first + rows.len()];
        let pose = pattern.order[k] as usize;
        column[0] = system.pose_h[pose];
        for (i, h) in system.pose_h[pose].iter().enumerate() {
            column[0][i][i] += lambda * h[i] + 1e-9;
        }
        for (cross, point) in crosses.of(pose) {
            let Some(inverse) = &inverses[*point as usize] else {
                continue;
            };
            let p = &system.points[*point as usize];
            let w = times(&system.cross[*cross as usize], inverse);
            for (r, row) in w.iter().enumerate() {
                rhs[pose][r] -= row[0] * p.b.x + row[1] * p.b.y + row[2] * p.b.z;
            }
            let w = across(&w);
            for c in p.cross.clone() {
                let row = pattern.position[system.pose_of[c] as usize] as usize;
                if row >= k {
                    subtract_product(&mut column[slot[row] as usize], &system.cross[c], &w);
                }
            }
        }
    }
    (values, rhs)
}

/// The cross blocks of each pose, with their points.
struct ByPose {
    start: Vec<usize>,
    entries: Vec<(u32, u32)>,
}

impl ByPose {
    fn new(system: &System, free: usize) -> Self {
        let mut start = vec![0; free + 1];
        for pose in &system.pose_of {
            start[*pose as usize + 1] += 1;
        }
        for k in 0..free {
            start[k + 1] += start[k];
        }
        let mut next = start.clone();
        let mut entries = vec![(0, 0); system.cross.len()];
        for (point, p) in system.points.iter().enumerate() {
            for c in p.cross.clone() {
                let place = &mut next[system.pose_of[c] as usize];
                entries[*place] = (c as u32, point as u32);
                *place += 1;
            }
        }
        Self { start, entries }
    }

    fn of(&self, pose: usize) -> &[(u32, u32)] {
        &self.entries[self.start[pose]..self.start[pose + 1]]
    }
}

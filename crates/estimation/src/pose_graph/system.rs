//! Residuals of edges, and the linear system of one iteration.

use super::{EdgeKernel, PoseGraphEdge};
use crate::sparse::{Block, Pattern};
use crate::twist::{left_jacobian_inverse, right_jacobian_inverse};
use stillpoint_geometry::{Mat6, Se3, Vec6, robust};

/// `e = log(T_a^-1 T_b z^-1)`: the left perturbation of the measured motion that makes it fit.
pub(super) fn residual(edge: &PoseGraphEdge, a: &Se3, b: &Se3) -> Vec6 {
    (a.inverse() * *b * edge.a_from_b.inverse()).log()
}

pub(super) fn chi2(edge: &PoseGraphEdge, a: &Se3, b: &Se3) -> f64 {
    let e = residual(edge, a, b);
    e.dot(&(edge.information * e)).max(0.0)
}

/// Derivatives of the residual by right perturbations of both poses, `T exp(d)`. With `E = exp(e)`, `e' = log(exp(-d_a)
/// E exp(Ad_z d_b))`.
pub(super) fn jacobians(edge: &PoseGraphEdge, e: &Vec6) -> (Mat6, Mat6) {
    (
        -left_jacobian_inverse(e),
        right_jacobian_inverse(e) * edge.a_from_b.adjoint(),
    )
}

/// Squared gates of the kernels.
#[derive(Clone, Copy)]
pub(super) struct Gates {
    pub(super) huber: f64,
    pub(super) scaled: f64,
}

impl Gates {
    pub(super) fn weight(&self, kernel: EdgeKernel, chi2: f64) -> f64 {
        match kernel {
            EdgeKernel::Square => 1.0,
            EdgeKernel::Huber => robust::huber_weight(chi2, self.huber),
            EdgeKernel::Scaled => {
                let s = (2.0 * self.scaled / (self.scaled + chi2)).min(1.0);
                s * s
            }
        }
    }

    /// Its derivative by `chi2` is the weight.
    pub(super) fn cost(&self, kernel: EdgeKernel, chi2: f64) -> f64 {
        match kernel {
            EdgeKernel::Square => chi2,
            EdgeKernel::Huber => robust::huber_cost(chi2, self.huber),
            EdgeKernel::Scaled if chi2 <= self.scaled => chi2,
            EdgeKernel::Scaled => self.scaled * (3.0 * chi2 - self.scaled) / (chi2 + self.scaled),
        }
    }
}

/// Block indices of an edge in the system.
struct EdgeSlots {
    a: Option<usize>,
    b: Option<usize>,
    /// Index of the block (a, b), and whether (b, a) is stored.
    across: Option<(usize, bool)>,
}

/// The unknown poses, and the sparsity pattern of their system.
pub(super) struct Structure {
    pub(super) free: Vec<u32>,
    pub(super) pattern: Pattern,
    places: Vec<EdgeSlots>,
    diagonal: Vec<usize>,
}

impl Structure {
    pub(super) fn new(still: &[bool], edges: &[PoseGraphEdge]) -> Self {
        let free: Vec<u32> = (0..still.len() as u32)
            .filter(|v| !still[*v as usize])
            .collect();
        let mut unknown = vec![None; still.len()];
        for (i, v) in free.iter().enumerate() {
            unknown[*v as usize] = Some(i);
        }
        let mut neighbours = vec![Vec::new(); free.len()];
        let of = |e: &PoseGraphEdge| (unknown[e.a as usize], unknown[e.b as usize]);
        for (a, b) in edges.iter().map(of) {
            if let (Some(a), Some(b)) = (a, b) {
                neighbours[a].push(b as u32);
                neighbours[b].push(a as u32);
            }
        }
        for n in &mut neighbours {
            n.sort_unstable();
            n.dedup();
        }
        let pattern = Pattern::new(neighbours);
        let place = |(a, b): (Option<usize>, Option<usize>)| EdgeSlots {
            a,
            b,
            across: match (a, b) {
                (Some(a), Some(b)) => pattern.find(a as u32, b as u32),
                _ => None,
            },
        };
        Self {
            places: edges.iter().map(of).map(place).collect(),
            diagonal: (0..free.len() as u32)
                .filter_map(|v| pattern.find(v, v).map(|f| f.0))
                .collect(),
            free,
            pattern,
        }
    }
}

/// Normal equations at one linearisation point.
pub(super) struct System<'a> {
    structure: &'a Structure,
    values: Vec<Block>,
    b: Vec<[f64; 6]>,
}

impl<'a> System<'a> {
    pub(super) fn build(
        structure: &'a Structure,
        nodes: &[Se3],
        edges: &[PoseGraphEdge],
        gates: Gates,
    ) -> Self {
        let mut system = Self {
            structure,
            values: vec![[[0.0; 6]; 6]; structure.pattern.blocks()],
            b: vec![[0.0; 6]; structure.free.len()],
        };
        for (edge, place) in edges.iter().zip(&structure.places) {
            let e = residual(edge, &nodes[edge.a as usize], &nodes[edge.b as usize]);
            let chi2 = e.dot(&(edge.information * e)).max(0.0);
            let omega = edge.information * gates.weight(edge.kernel, chi2);
            let (ja, jb) = jacobians(edge, &e);
            let (wa, wb) = (ja.tr_mul(&omega), jb.tr_mul(&omega));
            for (at, w, j) in [(place.a, &wa, &ja), (place.b, &wb, &jb)] {
                if let Some(at) = at {
                    add(&mut system.values[structure.diagonal[at]], &(w * j));
                    for (target, v) in system.b[at].iter_mut().zip((w * e).iter()) {
                        *target -= v;
                    }
                }
            }
            if let Some((at, swapped)) = place.across {
                let block = wa * jb;
                let block = if swapped { block.transpose() } else { block };
                add(&mut system.values[at], &block);
            }
        }
        system
    }

    /// The damped step of each unknown; `None` if the system is not positive definite.
    pub(super) fn solve(&self, lambda: f64) -> Option<Vec<Vec6>> {
        let mut values = self.values.clone();
        for &at in &self.structure.diagonal {
            for (i, row) in values[at].iter_mut().enumerate() {
                row[i] += lambda * row[i] + 1e-9;
            }
        }
        let step = self.structure.pattern.factor(values)?.solve(&self.b);
        let finite = |s: &Vec6| s.iter().all(|v| v.is_finite());
        step.iter().all(finite).then_some(step)
    }
}

fn add(target: &mut Block, m: &Mat6) {
    for (r, row) in target.iter_mut().enumerate() {
        for (c, v) in row.iter_mut().enumerate() {
            *v += m[(r, c)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn twist(size: f64) -> impl Strategy<Value = Vec6> {
        prop::array::uniform6(-size..size).prop_map(Vec6::from)
    }

    proptest! {
        /// Compared with central differences, for residuals up to a third of a turn.
        #[test]
        fn edge_jacobians_match_numerical_derivatives(a in twist(2.0), z in twist(1.5), e in twist(1.1)) {
            let a = Se3::exp(&a);
            let edge = PoseGraphEdge {
                a: 0,
                b: 1,
                a_from_b: Se3::exp(&z),
                information: Mat6::identity(),
                kernel: EdgeKernel::Square,
            };
            let b = a * Se3::exp(&e) * edge.a_from_b;
            prop_assert!((residual(&edge, &a, &b) - e).amax() < 1e-9);
            let (ja, jb) = jacobians(&edge, &e);
            let h = 1e-5;
            for k in 0..6 {
                let mut d = Vec6::zeros();
                d[k] = h;
                let (ahead, behind) = (Se3::exp(&d), Se3::exp(&-d));
                let da = (residual(&edge, &(a * ahead), &b) - residual(&edge, &(a * behind), &b)) / (2.0 * h);
                let db = (residual(&edge, &a, &(b * ahead)) - residual(&edge, &a, &(b * behind))) / (2.0 * h);
                prop_assert!((da - ja.column(k)).amax() < 1e-7, "{}", da - ja.column(k));
                prop_assert!((db - jb.column(k)).amax() < 1e-7, "{}", db - jb.column(k));
            }
        }

        /// The weight is the slope of the cost, and the cost of a loop is bounded.
        #[test]
        fn kernel_weights_are_cost_derivatives(chi2 in 0.0..200.0f64, gate in 1.0..40.0f64) {
            let gates = Gates { huber: gate, scaled: gate };
            for kernel in [EdgeKernel::Square, EdgeKernel::Huber, EdgeKernel::Scaled] {
                prop_assume!((chi2 - gate).abs() > 1e-3);
                let slope = (gates.cost(kernel, chi2 + 1e-5) - gates.cost(kernel, chi2 - 1e-5)) / 2e-5;
                prop_assert!((slope - gates.weight(kernel, chi2)).abs() < 1e-6);
            }
            prop_assert!(gates.cost(EdgeKernel::Scaled, 1e6 * chi2) < 3.0 * gate);
        }
    }
}

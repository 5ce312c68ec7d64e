//! Levenberg-Marquardt with graduated gates for loops.

use super::system::{Gates, Structure, System, chi2};
use super::{EdgeFit, EdgeKernel, PoseGraph, PoseGraphOptions, PoseGraphOutcome, PoseGraphReport};
use stillpoint_geometry::Se3;

/// Relative gain below which a stage before the last one ends, a share of the cost, since the next stage moves
/// everything again. Chosen: a thousand times that of the last stage (1e-6).
const STAGE_GAIN: f64 = 1e-3;

/// Maximum number of dampings per linear system. Chosen: eight lead from the least, 1e-9, by tens from 1e-4 on, to 100,
/// where a step hardly moves anything.
const TRIALS: usize = 8;

pub(super) fn minimise(
    graph: &mut PoseGraph,
    options: &PoseGraphOptions,
    held: Vec<u32>,
    still: &[bool],
) -> PoseGraphReport {
    let structure = Structure::new(still, &graph.edges);
    let gate = options.gate.max(1e-9);
    let last = Gates {
        huber: gate,
        scaled: gate,
    };
    let initial_cost = cost(graph, &graph.nodes, last);
    let free = !structure.free.is_empty() && !graph.edges.is_empty();
    let mut run = Run {
        structure: &structure,
        left: options.max_iterations,
        done: 0,
    };
    let mut outcome = PoseGraphOutcome::NothingFree;
    if free {
        for scaled in stages(graph, gate, options.graduation) {
            let gain = if scaled > gate {
                STAGE_GAIN.max(options.min_relative_gain)
            } else {
                options.min_relative_gain
            };
            outcome = run.stage(graph, Gates { scaled, ..last }, gain);
        }
    }
    for v in &structure.free {
        let node = &mut graph.nodes[*v as usize];
        *node = node.normalized();
    }
    let fit = |e: &super::PoseGraphEdge| {
        let chi2 = chi2(e, &graph.nodes[e.a as usize], &graph.nodes[e.b as usize]);
        EdgeFit {
            chi2,
            weight: last.weight(e.kernel, chi2),
        }
    };
    PoseGraphReport {
        outcome,
        iterations: run.done,
        initial_cost,
        final_cost: cost(graph, &graph.nodes, last),
        edges: graph.edges.iter().map(fit).collect(),
        held,
        factor_blocks: structure.pattern.blocks(),
    }
}

/// The gates of loops, from the largest residual down to the final gate.
fn stages(graph: &PoseGraph, gate: f64, factor: f64) -> Vec<f64> {
    let loops = graph
        .edges
        .iter()
        .filter(|e| e.kernel == EdgeKernel::Scaled);
    let mut scaled = loops
        .map(|e| chi2(e, &graph.nodes[e.a as usize], &graph.nodes[e.b as usize]))
        .fold(gate, f64::max);
    let mut stages = Vec::new();
    while scaled > gate && factor > 1.0 {
        stages.push(scaled);
        // Factors near one would give endless stages.
        scaled /= factor.max(1.25);
    }
    stages.push(gate);
    stages
}

fn cost(graph: &PoseGraph, nodes: &[Se3], gates: Gates) -> f64 {
    let mut sum = 0.0;
    for e in &graph.edges {
        let chi2 = chi2(e, &nodes[e.a as usize], &nodes[e.b as usize]);
        sum += gates.cost(e.kernel, chi2);
    }
    sum
}

struct Run<'a> {
    structure: &'a Structure,
    left: usize,
    done: usize,
}

impl Run<'_> {
    fn stage(&mut self, graph: &mut PoseGraph, gates: Gates, min_gain: f64) -> PoseGraphOutcome {
        let mut lambda = 1e-6;
        let mut before = cost(graph, &graph.nodes, gates);
        while self.left > 0 {
            self.left -= 1;
            self.done += 1;
            let system = System::build(self.structure, &graph.nodes, &graph.edges, gates);
            let mut gain = 0.0;
            for _ in 0..TRIALS {
                if let Some(step) = system.solve(lambda) {
                    let nodes = self.moved(&graph.nodes, &step);
                    let after = cost(graph, &nodes, gates);
                    if after <= before {
                        graph.nodes = nodes;
                        lambda = f64::max(lambda * 0.1, 1e-9);
                        gain = before - after;
                        before = after;
                        break;
                    }
                }
                lambda = f64::max(lambda * 10.0, 1e-4);
            }
            if gain <= min_gain * before {
                return PoseGraphOutcome::Converged;
            }
        }
        PoseGraphOutcome::IterationLimit
    }

    fn moved(&self, nodes: &[Se3], step: &[stillpoint_geometry::Vec6]) -> Vec<Se3> {
        let mut nodes = nodes.to_vec();
        for (v, s) in self.structure.free.iter().zip(step) {
            let node = &mut nodes[*v as usize];
            *node = *node * Se3::exp(s);
        }
        nodes
    }
}

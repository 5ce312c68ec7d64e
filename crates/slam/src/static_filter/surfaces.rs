//! Log odds of moving per cell: evidence from objects, free space and the past, spread over depth-connected regions.

use super::cells::Cells;
use super::history::History;
use super::rigid::Votes;
use super::segments::{LIMIT, Links, Slots};
use super::semantic::Mover;
use super::visibility::{self, Earlier};
use crate::pace::worth;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, workers};
use stillpoint_map::MapView;

/// Ages of the frames to compare with, s: from a few frames, for fast objects, to seconds, for slow ones, each about
/// twice the one before. With 0.4 s alone fr1_xyz_walkers has 4.8 times the error (decision 54).
const AGES: [f64; 5] = [0.2, 0.4, 0.8, 1.6, 3.0];
/// Share of a surface's log odds kept from one frame of 30 Hz to the next: 1/e is left after 0.2 s, the youngest of
/// `AGES`. Without memory errors are 0.81 to 1.14 times as large (decision 54).
const KEEP: f32 = 0.85;

/// Share of moving features at which flow is no evidence; the log odds are [`LIMIT`] times what exceeds it. Chosen
/// above the quarter of features that votes wrongly in single frames (decision 23). Without this evidence
/// fr1_xyz_walkers has 1.26 times the error (decision 54).
const NEUTRAL: f32 = 0.35;
/// Number of votes, after spreading, with half the weight of many. Chosen: one vote counts by two thirds.
const HALF_VOTES: f32 = 0.5;

/// Log odds above which a surface moves: 2.7 to one. Chosen above 0, since most surfaces are static.
pub(super) const MOVES: f32 = 1.0;
/// Log odds from which a surface is certain to move or, negated, certain not to: 20 to one, the usual 5 %, chosen.
/// While the camera's motion is unknown, everything that seems to move is as certain not to: without that,
/// tartanair_office has 11 times the error (decision 54).
const SURE: f32 = 3.0;
/// Duration for which an object that stopped is suspected, s. Chosen: twice the oldest of `AGES`, so that all of them
/// have seen it static for as long again.
const MEMORY: f64 = 6.0;
/// Log odds of an object that has just stopped. Chosen: they fade, and exceed `MOVES` by themselves for 2 s. Without
/// them `crowd_halfsphere` has 5.6 times the error, fr1_rpy_walkers 0.8 times (decision 54).
const SUSPECT: f32 = 1.5;

/// Duration for which a cell keeps its depth after measurements cease, s: black, shiny or distant surfaces have
/// intermittent holes. Measured: 0.1 to 0.6 s differ by less than starts do (decision 4).
const HELD: f64 = 0.4;

/// Log odds of "moving" per cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Surfaces {
    /// Depth of each cell's surface, m: measured, else held from shortly before; 0 if unknown.
    pub(super) depth: Vec<f32>,
    /// Time of the measurement, s.
    measured_at: Vec<f64>,
    /// The result, after spreading.
    pub(super) odds: Vec<f32>,
    /// Likewise without objects, kept from frame to frame: a box on a static surface leaves no trace.
    pub(super) motion: Vec<f32>,
    /// From free space and flow of this frame alone: negative where the surface was seen to be static.
    pub(super) evidence: Vec<f32>,
    /// Moving region of each cell; 0 if static.
    pub(super) regions: Vec<u16>,
    /// Time at which each cell's surface was last seen to move, s; cleared once it is found to be static.
    pub(super) moved_at: Vec<Option<f64>>,
}

pub(super) struct Now<'a> {
    pub(super) stamp: f64,
    pub(super) grid: &'a CoarseDepth,
    pub(super) world_from_depth: Se3,
    pub(super) view: &'a MapView,
    pub(super) history: &'a History,
}

#[derive(Default)]
pub(super) struct Memory {
    links: Links,
    past: Vec<f32>,
    fresh: Vec<f32>,
    strongest: Vec<f32>,
    open: Vec<usize>,
    slots: [Slots; 2],
    flow: FlowMemory,
}

/// Per cell: moving votes and all votes, and both after spreading.
#[derive(Default)]
struct FlowMemory {
    votes: [Vec<f32>; 2],
    near: [Vec<f32>; 2],
}

impl Surfaces {
    pub(super) fn new(cells: &Cells) -> Self {
        Self {
            depth: vec![0.0; cells.count()],
            measured_at: vec![0.0; cells.count()],
            odds: vec![0.0; cells.count()],
            motion: vec![0.0; cells.count()],
            evidence: vec![0.0; cells.count()],
            regions: vec![0; cells.count()],
            moved_at: vec![None; cells.count()],
        }
    }

    /// Surfaces for tracking backwards from `stamp`: those that moved recently count as moving.
    pub(super) fn mirrored(&self, stamp: f64) -> Self {
        let moves = |at: &Option<f64>| at.filter(|at| stamp - at <= MEMORY).map(|_| stamp);
        Self {
            moved_at: self.moved_at.iter().map(moves).collect(),
            ..self.clone()
        }
    }

    /// Writes the surfaces of the next frame to `next`, from these, the objects and the flow votes.
    pub(super) fn next(
        &self,
        cells: &Cells,
        now: &Now<'_>,
        movers: &[Mover],
        flow: &Votes,
        (next, memory): (&mut Self, &mut Memory),
    ) {
        let Self {
            depth,
            measured_at,
            odds,
            motion,
            evidence,
            regions,
            moved_at,
        } = next;
        let Memory {
            links, past, fresh, ..
        } = memory;
        workers::both(
            || {
                self.hold(cells, now, depth, measured_at);
                links.rebuild(cells, depth);
                self.propagate(cells, now, depth, (past, moved_at));
            },
            || weigh_free_space(cells, now, evidence),
        );
        // A person who has just stopped counts as moving for a while, against all measurements.
        for (past, at) in past.iter_mut().zip(&*moved_at) {
            *past += at.map_or(0.0, |at| suspicion(now.stamp - at));
        }
        weigh_flow(
            flow,
            evidence,
            past,
            (links, &mut memory.flow, &mut memory.slots),
        );
        let own = past;
        for (own, evidence) in own.iter_mut().zip(&*evidence) {
            *own += evidence;
        }
        // Spread before objects are added: detections are not remembered, or they would confirm themselves from frame
        // to frame. `fresh` is this frame's evidence alone.
        let [a, b] = &mut memory.slots;
        workers::both(
            || links.spread(own, a, motion),
            || links.spread(evidence, b, fresh),
        );
        remember_motion(now.stamp, fresh, motion, moved_at);
        add_movers(now.grid, depth, movers, (own, &mut memory.strongest));
        links.spread(own, a, odds);
        // Only measured cells: behind a moving object the background may have appeared, which a hole does not show.
        let is_part = |i: usize| odds[i] > MOVES && now.grid.data()[i] > 0.0;
        links.regions(cells, is_part, &mut memory.open, regions);
    }

    /// Depth of the cells and their measurement times; holes in the depth image keep the reprojected depth of shortly
    /// before.
    fn hold(&self, cells: &Cells, now: &Now<'_>, depth: &mut Vec<f32>, measured_at: &mut Vec<f64>) {
        let measured = now.grid.data();
        depth.clear();
        depth.extend_from_slice(measured);
        measured_at.clear();
        measured_at.resize(cells.count(), now.stamp);
        let Some(last) = now.history.last().filter(|s| s.stamp < now.stamp) else {
            return;
        };
        let pose = now.world_from_depth.inverse() * last.world_from_depth(now.view);
        let motion = visibility::CellMotion::new(&pose);
        motion.for_each(cells, cells.all(), (0, &self.depth), |cell, place, z| {
            let at = self.measured_at[cell];
            // The nearest surface occludes others.
            let is_seen = depth[place] == 0.0 || (measured[place] == 0.0 && z < depth[place]);
            if is_seen && now.stamp - at <= HELD {
                depth[place] = z;
                measured_at[place] = at;
            }
        });
    }

    /// Propagates the log odds and the last motion times of the last frame to this frame's cells.
    fn propagate(
        &self,
        cells: &Cells,
        now: &Now<'_>,
        depth: &[f32],
        (past, moved_at): (&mut Vec<f32>, &mut Vec<Option<f64>>),
    ) {
        past.clear();
        past.resize(cells.count(), 0.0);
        moved_at.clear();
        moved_at.resize(cells.count(), None);
        let Some(last) = now.history.last() else {
            return;
        };
        let pose = last.world_from_depth(now.view).inverse() * now.world_from_depth;
        let motion = visibility::CellMotion::new(&pose);
        let before = &self.depth;
        let keep = libm::powf(KEEP, worth(Some(now.stamp - last.stamp)));
        motion.for_each(cells, cells.all(), (0, depth), |cell, place, z| {
            // The reprojected cell lies between cells, and a moving surface has moved since: every neighbour at about
            // this depth may be the same surface.
            let (mut sum, mut count, mut moved) = (0.0, 0.0, None);
            cells.for_each_around(place, |near| {
                let is_it = (before[near] > 0.0) & ((before[near] - z).abs() < 0.05 + 0.01 * z);
                sum += if is_it { self.motion[near] } else { 0.0 };
                count += if is_it { 1.0 } else { 0.0 };
                if is_it & self.moved_at[near].is_some() {
                    moved = later(moved, self.moved_at[near]);
                }
            });
            // A newly visible surface starts at zero.
            if count > 0.0 {
                moved_at[cell] = moved;
                // Decay, so that new evidence can overturn old.
                past[cell] = keep * sum / count;
            }
        });
    }
}

/// Free-space evidence of earlier frames, in log odds of "moving" per cell.
fn weigh_free_space(cells: &Cells, now: &Now<'_>, evidence: &mut Vec<f32>) {
    evidence.clear();
    evidence.resize(cells.count(), 0.0);
    workers::in_rows(evidence, 1, |first, evidence| {
        for s in now.history.at_ages(now.stamp, &AGES) {
            let earlier = Earlier {
                grid: &s.grid,
                moving: &s.moving,
                around: &s.around,
                // Both poses in the current view of the map, so that corrections in between cancel.
                earlier_from_now: s.world_from_depth(now.view).inverse() * now.world_from_depth,
                age: now.stamp - s.stamp,
            };
            visibility::add_evidence(cells, now.grid, &earlier, (first, evidence));
        }
    });
}

/// Adds flow evidence. A smooth surface sliding along itself looks static in depth: if the flow shows motion, agreement
/// of depths is discounted, in this frame (`evidence`) and in the past (`past`).
fn weigh_flow(
    flow: &Votes,
    evidence: &mut [f32],
    past: &mut [f32],
    (links, memory, slots): (&Links, &mut FlowMemory, &mut [Slots; 2]),
) {
    let (votes, certainty) = (&flow.votes, flow.certainty);
    if votes.is_empty() {
        return;
    }
    let [moving, all] = &mut memory.votes;
    for votes in [&mut *moving, &mut *all] {
        votes.clear();
        votes.resize(evidence.len(), 0.0);
    }
    for v in votes {
        moving[v.cell] += f32::from(u8::from(v.moving));
        all[v.cell] += 1.0;
    }
    // Few cells of a surface have corners, which vote for all of it. Both counts are spread alike, so that their ratio
    // remains a share.
    let ([near_moving, near_all], [a, b]) = (&mut memory.near, slots);
    workers::both(
        || links.spread(moving, a, near_moving),
        || links.spread(all, b, near_all),
    );
    let so_far = evidence.iter_mut().zip(past);
    for ((e, past), (m, n)) in so_far.zip(near_moving.iter().zip(&*near_all)) {
        if *n <= 0.0 {
            continue;
        }
        let (share, trust) = (m / n, certainty * n / (n + HALF_VOTES));
        // Only evidence for static is discounted: free space is proof of motion regardless of flow.
        if *e < 0.0 {
            *e *= 1.0 - trust * share;
        }
        // The past is discounted only if flow itself is evidence of motion.
        if *past < 0.0 {
            *past *= 1.0 - trust * ((share - NEUTRAL) / (1.0 - NEUTRAL)).max(0.0);
        }
        *e += LIMIT * trust * (share - NEUTRAL) - SURE * (1.0 - certainty) * share;
    }
}

/// Updates the last motion times: set for surfaces certain to move, cleared for those certain not to, or static for
/// long. `fresh` is this frame's evidence, spread.
fn remember_motion(stamp: f64, fresh: &[f32], motion: &mut [f32], moved_at: &mut [Option<f64>]) {
    for ((at, motion), fresh) in moved_at.iter_mut().zip(motion).zip(fresh) {
        // Requires evidence of this frame: propagated odds alone would renew themselves forever.
        if *motion > SURE && *fresh > 0.0 {
            *at = Some(stamp);
        } else if *motion < -SURE {
            *at = None;
        } else if at.is_some_and(|at| stamp - at > MEMORY) {
            // A surface static for this long is reset; otherwise its past odds would keep it moving.
            *at = None;
            *motion = 0.0;
        }
    }
}

/// Log odds of "moving" for a surface that stopped `since` seconds ago: a person who pauses moves on without warning.
fn suspicion(since: f64) -> f32 {
    SUSPECT * (1.0 - since / MEMORY).max(0.0) as f32
}

fn later(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.max(b)),
        (a, b) => a.or(b),
    }
}

/// Adds to each cell the log odds of the strongest object that holds it.
fn add_movers(
    grid: &CoarseDepth,
    depth: &[f32],
    movers: &[Mover],
    (own, strongest): (&mut [f32], &mut Vec<f32>),
) {
    // The maximum, not the sum: two boxes of one person are not independent.
    strongest.clear();
    strongest.resize(own.len(), 0.0);
    for m in movers.iter().filter(|m| m.strength > 0.0) {
        for (i, [u, v]) in m.cells(grid) {
            let z = depth[i];
            // A cell without depth is connected to no other, so it would keep the odds.
            if z > 0.0 {
                strongest[i] = strongest[i].max(m.odds(u, v, z));
            }
        }
    }
    for (own, odds) in own.iter_mut().zip(&*strongest) {
        *own += odds;
    }
}

#[cfg(test)]
mod tests;

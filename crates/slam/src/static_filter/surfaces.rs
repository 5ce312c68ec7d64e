//! How likely each cell's surface is to move: evidence of objects, of free space and of the past, spread over
//! depth-connected regions.

use super::cells::Cells;
use super::history::History;
use super::rigid::Vote;
use super::segments::Links;
use super::semantic::Mover;
use super::visibility::{self, Earlier};
use stillpoint_geometry::Se3;
use stillpoint_imaging::CoarseDepth;
use stillpoint_map::MapView;

/// Ages of the frames that a frame is compared with, s: from a few frames, for fast things, to seconds, for slow ones.
const AGES: [f64; 5] = [0.2, 0.4, 0.8, 1.6, 3.0];
/// Share of a surface's log odds that it keeps from frame to frame.
const KEEP: f32 = 0.85;

/// Log odds of a surface whose features all move, by flow; at `NEUTRAL` of them it is even.
const FLOW: f32 = 8.0;
const NEUTRAL: f32 = 0.35;
/// Votes, after spreading, that are worth half of what many are.
const HALF_VOTES: f32 = 0.5;

/// Log odds above which a surface moves.
pub(super) const MOVES: f32 = 1.0;
/// Log odds from which a surface is sure to move, or with a minus sign, not to.
const SURE: f32 = 3.0;
/// How long a thing that moved and stopped is suspected, s.
const MEMORY: f64 = 6.0;
/// Log odds of a thing that has just stopped.
const SUSPECT: f32 = 1.5;

/// Log odds of "moving" per cell.
#[derive(Clone)]
pub(super) struct Surfaces {
    /// After spreading: the answer.
    pub(super) odds: Vec<f32>,
    /// The same without objects: what is remembered from frame to frame. A box on a surface that stands still leaves no
    /// trace when it goes.
    pub(super) motion: Vec<f32>,
    /// Of free space and flow alone, this frame: negative where the surface was seen to stand still.
    pub(super) evidence: Vec<f32>,
    /// Number of the moving region that each cell belongs to; 0 for what stands still.
    pub(super) regions: Vec<u16>,
    /// When each cell's surface was last seen to move, s; forgotten when it turns out to have been there before.
    pub(super) moved_at: Vec<Option<f64>>,
}

/// The frame whose surfaces are judged.
pub(super) struct Now<'a> {
    pub(super) stamp: f64,
    pub(super) grid: &'a CoarseDepth,
    pub(super) world_from_depth: Se3,
    pub(super) view: &'a MapView,
}

impl Surfaces {
    pub(super) fn new(cells: &Cells) -> Self {
        Self {
            odds: vec![0.0; cells.count()],
            motion: vec![0.0; cells.count()],
            evidence: vec![0.0; cells.count()],
            regions: vec![0; cells.count()],
            moved_at: vec![None; cells.count()],
        }
    }

    /// Judges the surfaces of a frame, given those of the frame before, the objects and what the flow of its features says.
    pub(super) fn update(
        &mut self,
        cells: &Cells,
        history: &History,
        now: &Now<'_>,
        movers: &[Mover],
        votes: &[Vote],
    ) {
        let links = Links::new(cells, now.grid.data());
        let mut own = self.carry(cells, history, now);
        for (o, t) in own.iter_mut().zip(&self.moved_at) {
            *o += t.map_or(0.0, |t| suspicion(now.stamp - t));
        }
        self.weigh_free_space(cells, history, now);
        self.weigh_flow(cells, &links, votes, &mut own);
        for (o, e) in own.iter_mut().zip(&self.evidence) {
            *o += e;
        }
        links.spread(&own, &mut self.motion);
        let mut fresh = Vec::with_capacity(own.len());
        links.spread(&self.evidence, &mut fresh);
        add_movers(now.grid, movers, &mut own);
        links.spread(&own, &mut self.odds);
        let odds = &self.odds;
        self.regions = links.regions(cells, |i| odds[i] > MOVES);
        let remembered = self.moved_at.iter_mut().zip(&mut self.motion);
        for ((t, motion), fresh) in remembered.zip(&fresh) {
            if *motion > SURE && *fresh > 0.0 {
                *t = Some(now.stamp);
            } else if *motion < -SURE {
                *t = None;
            } else if t.is_some_and(|t| now.stamp - t > MEMORY) {
                // What has stood for so long begins anew; else it would be taken to move for having been.
                *t = None;
                *motion = 0.0;
            }
        }
    }

    /// Adds what the flow says. A smooth surface that slides along itself looks unmoved to the depth camera: where the flow
    /// says that it moves, agreement of depths counts for nothing, now and in the past (`own`).
    fn weigh_flow(&mut self, cells: &Cells, links: &Links, votes: &[Vote], own: &mut [f32]) {
        if votes.is_empty() {
            return;
        }
        // Per cell: votes for moving, and all votes.
        let (mut moving, mut all) = (vec![0.0; cells.count()], vec![0.0; cells.count()]);
        for v in votes {
            moving[v.cell] += f32::from(u8::from(v.moving));
            all[v.cell] += 1.0;
        }
        let (mut near_moving, mut near_all) = (Vec::new(), Vec::new());
        links.spread(&moving, &mut near_moving);
        links.spread(&all, &mut near_all);
        let so_far = self.evidence.iter_mut().zip(own);
        for ((e, past), (m, n)) in so_far.zip(near_moving.iter().zip(&near_all)) {
            if *n <= 0.0 {
                continue;
            }
            let (share, trust) = (m / n, n / (n + HALF_VOTES));
            if *e < 0.0 {
                *e *= 1.0 - trust * share;
            }
            if *past < 0.0 {
                *past *= 1.0 - trust * ((share - NEUTRAL) / (1.0 - NEUTRAL)).max(0.0);
            }
            *e += FLOW * trust * (share - NEUTRAL);
        }
    }

    fn weigh_free_space(&mut self, cells: &Cells, history: &History, now: &Now<'_>) {
        self.evidence.fill(0.0);
        for s in history.at_ages(now.stamp, &AGES) {
            let earlier = Earlier {
                grid: &s.grid,
                moving: &s.moving,
                earlier_from_now: s.world_from_depth(now.view).inverse() * now.world_from_depth,
                age: now.stamp - s.stamp,
            };
            visibility::add_evidence(cells, now.grid, &earlier, &mut self.evidence);
        }
    }

    /// The log odds of the last frame, carried to this one's cells along the surfaces they belong to.
    fn carry(&mut self, cells: &Cells, history: &History, now: &Now<'_>) -> Vec<f32> {
        let mut own = vec![0.0; cells.count()];
        let moved_before = std::mem::replace(&mut self.moved_at, vec![None; cells.count()]);
        let Some(last) = history.last() else {
            return own;
        };
        let pose = last.world_from_depth(now.view).inverse() * now.world_from_depth;
        let motion = visibility::Motion::new(&pose);
        let before = last.grid.data();
        motion.for_each(cells, now.grid.data(), |cell, place, z| {
            let Some(place) = cells.at_place(place, z) else {
                return;
            };
            let (mut sum, mut count, mut moved) = (0.0, 0.0, None);
            cells.for_each_around(place, |near| {
                if before[near] > 0.0 && (before[near] - z).abs() < 0.05 + 0.01 * z {
                    sum += self.motion[near];
                    count += 1.0;
                    moved = later(moved, moved_before[near]);
                }
            });
            if count > 0.0 {
                self.moved_at[cell] = moved;
                own[cell] = KEEP * sum / count;
            }
        });
        own
    }
}

/// Log odds of "moving" of what moved `since` seconds ago and has stood still since: somebody who stops for a moment goes
/// on without warning.
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
fn add_movers(grid: &CoarseDepth, movers: &[Mover], own: &mut [f32]) {
    let mut strongest = vec![0.0_f32; own.len()];
    for m in movers.iter().filter(|m| m.strength > 0.0) {
        for (i, [u, v]) in m.cells(grid) {
            let z = grid.data()[i];
            if z > 0.0 {
                strongest[i] = strongest[i].max(m.odds(u, v, z));
            }
        }
    }
    for (own, odds) in own.iter_mut().zip(&strongest) {
        *own += odds;
    }
}

#[cfg(test)]
mod tests;

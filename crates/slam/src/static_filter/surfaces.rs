//! How likely each cell's surface is to move: evidence of objects, of free space and of the past, spread over
//! depth-connected regions.

use super::cells::Cells;
use super::history::History;
use super::rigid::Votes;
use super::segments::{Links, Slots};
use super::semantic::Mover;
use super::visibility::{self, Earlier};
use crate::pace::worth;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, workers};
use stillpoint_map::MapView;

/// Ages of the frames that a frame is compared with, s: from a few frames, for fast things, to seconds, for slow ones, each about twice the one
/// before. With 0.4 s alone fr1_xyz_walkers has 4.8 times the error (decision 54).
const AGES: [f64; 5] = [0.2, 0.4, 0.8, 1.6, 3.0];
/// Cells that are compared together with earlier frames, at least, a number. Chosen: 640x480 px have 4800 cells, which makes four parts at most.
const CELLS_TOGETHER: usize = 1000;
/// Share of a surface's log odds that it keeps from one frame of 30 Hz to the next: 1/e is left after 0.2 s, the youngest of `AGES`. Without memory
/// errors are 0.81 to 1.14 times as large (decision 54).
const KEEP: f32 = 0.85;

/// Log odds by flow, times the share of features that move less `NEUTRAL`, at which a surface is even: 5.2 where all move. Chosen: the bound of the
/// odds (`LIMIT`). Without flow as evidence fr1_xyz_walkers has 1.26 times the error (decision 54).
const FLOW: f32 = 8.0;
/// Share of moving features at which flow says nothing. Chosen above the quarter of features that votes wrongly in single frames (decision 23).
const NEUTRAL: f32 = 0.35;
/// Log odds that speak for standing still where all features seem to move in a frame whose own motion is not known. Chosen: those from which a
/// surface is sure not to move (`SURE`). Without it tartanair_office has 11 times the error (decision 54).
const DOUBT: f32 = 3.0;
/// Votes, after spreading, that are worth half of what many are. Chosen: one vote counts by two thirds.
const HALF_VOTES: f32 = 0.5;

/// Log odds above which a surface moves: 2.7 to one. Chosen above 0, since most surfaces stand still.
pub(super) const MOVES: f32 = 1.0;
/// Log odds from which a surface is sure to move, or with a minus sign, not to: 20 to one, the usual 5 %, chosen.
const SURE: f32 = 3.0;
/// How long a thing that moved and stopped is suspected, s. Chosen: twice the oldest of `AGES`, so that all of them have seen it stand for as long
/// again.
const MEMORY: f64 = 6.0;
/// Log odds of a thing that has just stopped. Chosen: they fade, and exceed `MOVES` by themselves for 2 s. Without them `crowd_halfsphere` has 5.6
/// times the error, fr1_rpy_walkers 0.8 times (decision 54).
const SUSPECT: f32 = 1.5;

/// How long the surface in a cell is believed in whose depth is not measured any more, s: what is black, shines or is far has holes that come and go.
/// Measured: 0.1 to 0.6 s differ by less than starts do (decision 4).
const HELD: f64 = 0.4;

/// Log odds of "moving" per cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Surfaces {
    /// The depth of each cell's surface, m: as measured, else as it was shortly before; 0 where neither is known.
    pub(super) depth: Vec<f32>,
    /// When it was measured, s.
    measured_at: Vec<f64>,
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
    pub(super) history: &'a History,
}

/// Memory that judging surfaces takes, used again from frame to frame.
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

/// Of the flow: per cell votes for moving and all votes, and both spread.
#[derive(Default)]
struct FlowMemory {
    votes: [Vec<f32>; 2],
    near: [Vec<f32>; 2],
}

impl Surfaces {
    /// Surfaces of which nothing is known.
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

    /// The surfaces as one sees them who looks back from `stamp`: what moved before that is going to.
    pub(super) fn mirrored(&self, stamp: f64) -> Self {
        let moves = |at: &Option<f64>| at.filter(|at| stamp - at <= MEMORY).map(|_| stamp);
        Self {
            moved_at: self.moved_at.iter().map(moves).collect(),
            ..self.clone()
        }
    }

    /// Makes `next` the surfaces of the next frame, given these of the frame before, the objects and what the flow of its features says.
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
        // Who has just stopped counts as moving for a while, though everything measured says that he stands still.
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
        // Spread before the objects are added: what a box lends is not remembered, or it would confirm itself from frame to frame.
        // This frame's evidence alone: whether a thing moves now, not whether it did.
        let [a, b] = &mut memory.slots;
        workers::both(
            || links.spread(own, a, motion),
            || links.spread(evidence, b, fresh),
        );
        remember_motion(now.stamp, fresh, motion, moved_at);
        add_movers(now.grid, depth, movers, (own, &mut memory.strongest));
        links.spread(own, a, odds);
        // Of what is measured now: where a mover was, the room may have come out since, and in a hole nothing says so.
        let is_part = |i: usize| odds[i] > MOVES && now.grid.data()[i] > 0.0;
        links.regions(cells, is_part, &mut memory.open, regions);
    }

    /// The depths of the cells, and when they were measured: in a hole of the depth image is what was there shortly before, as it is seen from here.
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
            // What is nearer hides the rest.
            let is_seen = depth[place] == 0.0 || (measured[place] == 0.0 && z < depth[place]);
            if is_seen && now.stamp - at <= HELD {
                depth[place] = z;
                measured_at[place] = at;
            }
        });
    }

    /// The log odds of the last frame, propagated to this one's cells along the surfaces they belong to, and when each was last seen to
    /// move.
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
            // The camera's motion puts the cell between cells of the last frame, and what moves went its own way since: every
            // neighbour at about this depth may be where the surface was.
            let (mut sum, mut count, mut moved) = (0.0, 0.0, None);
            cells.for_each_around(place, |near| {
                let is_it = (before[near] > 0.0) & ((before[near] - z).abs() < 0.05 + 0.01 * z);
                sum += if is_it { self.motion[near] } else { 0.0 };
                count += if is_it { 1.0 } else { 0.0 };
                if is_it & self.moved_at[near].is_some() {
                    moved = later(moved, self.moved_at[near]);
                }
            });
            // A surface that was not seen before begins with nothing.
            if count > 0.0 {
                moved_at[cell] = moved;
                // Not all of it is kept: old evidence is to be overturned by new.
                past[cell] = keep * sum / count;
            }
        });
    }
}

/// What earlier frames say of the places where the surfaces are now, in log odds of "moving" per cell.
fn weigh_free_space(cells: &Cells, now: &Now<'_>, evidence: &mut Vec<f32>) {
    evidence.clear();
    evidence.resize(cells.count(), 0.0);
    workers::in_rows(evidence, 1, CELLS_TOGETHER, |first, evidence| {
        for s in now.history.at_ages(now.stamp, &AGES) {
            let earlier = Earlier {
                grid: &s.grid,
                moving: &s.moving,
                around: &s.around,
                // Both poses in the present view of the map: a correction in between moved them together.
                earlier_from_now: s.world_from_depth(now.view).inverse() * now.world_from_depth,
                age: now.stamp - s.stamp,
            };
            visibility::add_evidence(cells, now.grid, &earlier, (first, evidence));
        }
    });
}

/// Adds what the flow says. A smooth surface that slides along itself looks unmoved to the depth camera: where the flow
/// says that it moves, agreement of depths counts for nothing, now (`evidence`) and in the past (`past`).
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
    // A surface has corners in few of its cells, and they speak for all of it. Both counts are spread alike, so that their ratio
    // stays a share.
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
        // Only what speaks for standing still is taken back: depths that were seen through are proof whatever the flow says.
        if *e < 0.0 {
            *e *= 1.0 - trust * share;
        }
        // The past weighs more: it is taken back only where the flow itself speaks for moving.
        if *past < 0.0 {
            *past *= 1.0 - trust * ((share - NEUTRAL) / (1.0 - NEUTRAL)).max(0.0);
        }
        *e += FLOW * trust * (share - NEUTRAL) - DOUBT * (1.0 - certainty) * share;
    }
}

/// Notes which surfaces are sure to move now, and forgets it of those that are sure not to, or have stood for long. `fresh` is this
/// frame's evidence, spread.
fn remember_motion(stamp: f64, fresh: &[f32], motion: &mut [f32], moved_at: &mut [Option<f64>]) {
    for ((at, motion), fresh) in moved_at.iter_mut().zip(motion).zip(fresh) {
        // By this frame's own evidence, too: what is only propagated would renew its own memory forever.
        if *motion > SURE && *fresh > 0.0 {
            *at = Some(stamp);
        } else if *motion < -SURE {
            *at = None;
        } else if at.is_some_and(|at| stamp - at > MEMORY) {
            // What has stood for so long starts over; else it would be taken to move for having been.
            *at = None;
            *motion = 0.0;
        }
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
fn add_movers(
    grid: &CoarseDepth,
    depth: &[f32],
    movers: &[Mover],
    (own, strongest): (&mut [f32], &mut Vec<f32>),
) {
    // Not their sum: two boxes of one person are no two opinions.
    strongest.clear();
    strongest.resize(own.len(), 0.0);
    for m in movers.iter().filter(|m| m.strength > 0.0) {
        for (i, [u, v]) in m.cells(grid) {
            let z = depth[i];
            // A hole in the depth image belongs to nobody: its cell is joined to no other and would stay as it is.
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

//! How likely each cell's surface is to move: evidence of objects, of free space and of the past, spread over
//! depth-connected regions.

use super::cells::Cells;
use super::history::History;
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

/// Log odds of "moving" per cell.
pub(super) struct Surfaces {
    /// After spreading: the answer.
    pub(super) odds: Vec<f32>,
    /// Of free space alone, this frame: negative where the surface was seen to stand still.
    pub(super) evidence: Vec<f32>,
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
            evidence: vec![0.0; cells.count()],
        }
    }

    /// Judges the surfaces of a frame, given those of the frame before.
    pub(super) fn update(
        &mut self,
        cells: &Cells,
        history: &History,
        now: &Now<'_>,
        movers: &[Mover],
    ) {
        let mut own = self.carry(cells, history, now);
        self.weigh_free_space(cells, history, now);
        for (o, e) in own.iter_mut().zip(&self.evidence) {
            *o += e;
        }
        add_movers(now.grid, movers, &mut own);
        Links::new(cells, now.grid.data()).spread(cells, &own, &mut self.odds);
    }

    fn weigh_free_space(&mut self, cells: &Cells, history: &History, now: &Now<'_>) {
        self.evidence.fill(0.0);
        for s in history.at_ages(now.stamp, &AGES) {
            let earlier = Earlier {
                grid: &s.grid,
                earlier_from_now: s.world_from_depth(now.view).inverse() * now.world_from_depth,
                age: now.stamp - s.stamp,
            };
            visibility::add_evidence(cells, now.grid, &earlier, &mut self.evidence);
        }
    }

    /// The log odds of the last frame, carried to this one's cells along the surfaces they belong to.
    fn carry(&self, cells: &Cells, history: &History, now: &Now<'_>) -> Vec<f32> {
        let mut own = vec![0.0; cells.count()];
        let Some(last) = history.last() else {
            return own;
        };
        let pose = last.world_from_depth(now.view).inverse() * now.world_from_depth;
        let motion = visibility::Motion::new(&pose);
        let before = last.grid.data();
        for (cell, &z) in now.grid.data().iter().enumerate() {
            if z <= 0.0 {
                continue;
            }
            let p = motion.apply(cells.rays()[cell], z);
            let Some(place) = cells.project(p) else {
                continue;
            };
            let (mut sum, mut count) = (0.0, 0.0);
            for near in cells.around(place, 1) {
                if before[near] > 0.0 && (before[near] - p[2]).abs() < 0.05 + 0.01 * p[2] {
                    sum += self.odds[near];
                    count += 1.0;
                }
            }
            if count > 0.0 {
                own[cell] = KEEP * sum / count;
            }
        }
        own
    }
}

/// Adds to each cell the log odds of the strongest object that holds it.
fn add_movers(grid: &CoarseDepth, movers: &[Mover], own: &mut [f32]) {
    for (i, (own, &z)) in own.iter_mut().zip(grid.data()).enumerate() {
        let [u, v] = grid.centre(i % grid.width(), i / grid.width());
        if z > 0.0 {
            *own += movers.iter().map(|m| m.odds(u, v, z)).fold(0.0, f32::max);
        }
    }
}

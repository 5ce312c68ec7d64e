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
        let pairs: Vec<[f32; 2]> = own
            .iter()
            .zip(&self.evidence)
            .map(|(o, e)| [*o, *e])
            .collect();
        let spread = links.spread_pairs(cells, &pairs);
        self.motion.clear();
        self.motion.extend(spread.iter().map(|s| s[0]));
        add_movers(now.grid, movers, &mut own);
        links.spread(cells, &own, &mut self.odds);
        let odds = &self.odds;
        self.regions = links.regions(cells, |i| odds[i] > MOVES);
        let remembered = self.moved_at.iter_mut().zip(&mut self.motion);
        for ((t, motion), [odds, fresh]) in remembered.zip(&spread) {
            if *odds > SURE && *fresh > 0.0 {
                *t = Some(now.stamp);
            } else if *odds < -SURE {
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
        let mut counts = vec![[0.0; 2]; cells.count()];
        for v in votes {
            counts[v.cell][0] += f32::from(u8::from(v.moving));
            counts[v.cell][1] += 1.0;
        }
        let near = links.spread_pairs(cells, &counts);
        let so_far = self.evidence.iter_mut().zip(own);
        for ((e, past), [m, n]) in so_far.zip(&near) {
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
        for (cell, &z) in now.grid.data().iter().enumerate() {
            if z <= 0.0 {
                continue;
            }
            let p = motion.apply(cells.rays()[cell], z);
            let Some(place) = cells.project(p) else {
                continue;
            };
            let (mut sum, mut count, mut moved) = (0.0, 0.0, None);
            for near in cells.around(place, 1) {
                if before[near] > 0.0 && (before[near] - p[2]).abs() < 0.05 + 0.01 * p[2] {
                    sum += self.motion[near];
                    count += 1.0;
                    moved = later(moved, moved_before[near]);
                }
            }
            if count > 0.0 {
                self.moved_at[cell] = moved;
                own[cell] = KEEP * sum / count;
            }
        }
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
        for i in m.cells(grid) {
            let [u, v] = grid.centre(i % grid.width(), i / grid.width());
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
mod tests {
    use super::super::history::Place;
    use super::*;
    use std::sync::Arc;
    use stillpoint_detection::{BoundingBox, ObjectId};
    use stillpoint_geometry::Camera;
    use stillpoint_imaging::{DepthImage, FrameId};
    use stillpoint_map::KeyframeId;

    /// A camera that stands still before a wall at 3 m, with a person of 8 x 20 cells at 1.5 m in front of it.
    struct World {
        cells: Cells,
        history: History,
        surfaces: Surfaces,
        frame: u32,
    }

    fn person(cell: usize, column: usize) -> bool {
        (column..column + 8).contains(&(cell % 40)) && (5..25).contains(&(cell / 40))
    }

    impl World {
        fn new() -> Self {
            let cells = Cells::new(&Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5]));
            Self {
                surfaces: Surfaces::new(&cells),
                cells,
                history: History::default(),
                frame: 0,
            }
        }

        /// The next frame at 30 Hz, with the person's left edge in a column of cells.
        fn step(&mut self, column: Option<usize>, movers: &[Mover], votes: &[Vote]) {
            let depth = |i: usize| {
                let cell = i / 320 / 8 * 40 + i % 320 / 8;
                let there = column.is_some_and(|c| person(cell, c));
                if there { 1.5 } else { 3.0 }
            };
            let image = DepthImage::from_vec(320, 240, (0..320 * 240).map(depth).collect());
            let grid = Arc::new(super::super::cells::coarse(&image.unwrap()));
            let stamp = f64::from(self.frame) / 30.0;
            let now = Now {
                stamp,
                grid: &grid,
                world_from_depth: Se3::identity(),
                view: &MapView::default(),
            };
            self.surfaces
                .update(&self.cells, &self.history, &now, movers, votes);
            let moving = self.surfaces.motion.iter().map(|o| *o > MOVES).collect();
            let place = Place {
                reference: KeyframeId(0),
                reference_from_camera: Se3::identity(),
                world_from_camera: Se3::identity(),
                camera_from_depth: Se3::identity(),
            };
            let frame = FrameId(self.frame);
            self.history
                .push(frame, stamp, Arc::clone(&grid), moving, &place);
            self.frame += 1;
        }

        /// Share of the cells that move, of the person and of the wall.
        fn moving(&self, column: usize) -> (f64, f64) {
            let share = |of_person: bool| {
                let cells: Vec<usize> = (0..self.cells.count())
                    .filter(|c| person(*c, column) == of_person)
                    .collect();
                let moving = cells.iter().filter(|c| self.surfaces.odds[**c] > MOVES);
                moving.count() as f64 / cells.len() as f64
            };
            (share(true), share(false))
        }
    }

    fn mover(strength: f32) -> Mover {
        Mover {
            id: ObjectId(0),
            bounds: BoundingBox {
                x0: 95.5,
                y0: 39.5,
                x1: 159.5,
                y1: 199.5,
            },
            range: Some([1.2, 1.8]),
            weight: 5.0,
            strength,
        }
    }

    #[test]
    fn who_walks_in_moves_and_the_wall_does_not() {
        let mut world = World::new();
        for _ in 0..30 {
            world.step(None, &[], &[]);
        }
        assert!(world.moving(12).1.abs() < f64::EPSILON);
        for i in 0..10 {
            world.step(Some(8 + i / 2), &[], &[]);
        }
        let (person, wall) = world.moving(12);
        assert!(person > 0.95, "{person}");
        assert!(wall < 0.01, "{wall}");
        // The very first frame knows nothing, and says so.
        let mut blank = World::new();
        blank.step(Some(12), &[], &[]);
        assert_eq!(blank.moving(12), (0.0, 0.0));
    }

    #[test]
    fn who_stops_is_suspected_for_seconds() {
        let mut world = World::new();
        for i in 0..40 {
            world.step((i >= 30).then(|| 2 + (i - 30) % 10), &[], &[]);
        }
        for i in 0..60 {
            world.step(Some(12), &[], &[]);
            let (person, wall) = world.moving(12);
            assert!(person > 0.95 && wall < 0.05, "frame {i}: {person} {wall}");
        }
        // But not for ever: the free space that he took and the memory both run out.
        for _ in 0..300 {
            world.step(Some(12), &[], &[]);
        }
        assert_eq!(world.moving(12), (0.0, 0.0));
        // Control: who has stood there from the start is not.
        let mut world = World::new();
        for _ in 0..100 {
            world.step(Some(12), &[], &[]);
        }
        assert_eq!(world.moving(12), (0.0, 0.0));
    }

    #[test]
    fn objects_count_for_now_and_leave_no_trace() {
        let mut world = World::new();
        for _ in 0..60 {
            world.step(Some(12), &[], &[]);
        }
        // What has stood still for two seconds is not moved by a box.
        assert!(world.moving(12).0.abs() < f64::EPSILON);
        let motion = world.surfaces.motion.clone();
        world.step(Some(12), &[mover(2.5)], &[]);
        assert!(world.moving(12).0 < 0.05);
        world.step(Some(12), &[], &[]);
        for (a, b) in motion.iter().zip(&world.surfaces.motion) {
            assert!((a - b).abs() < 0.5);
        }
        // Of a new scene nothing is known: the box decides, for the person in it alone.
        let mut world = World::new();
        world.step(Some(12), &[mover(2.5)], &[]);
        let (person, wall) = world.moving(12);
        assert!(person > 0.9 && wall.abs() < f64::EPSILON, "{person} {wall}");
        assert!(world.surfaces.motion.iter().all(|m| m.abs() < f32::EPSILON));
        // Two boxes are no more than the stronger of them.
        let odds = world.surfaces.odds.clone();
        let mut twice = World::new();
        twice.step(Some(12), &[mover(2.5), mover(1.0)], &[]);
        assert_eq!(twice.surfaces.odds, odds);
    }

    #[test]
    fn flow_overrules_depths_that_agree() {
        // A smooth body that slides along itself: its depths are those of before.
        let sliding: Vec<Vote> = (0..1200)
            .filter(|c| c % 3 == 0)
            .map(|cell| Vote {
                cell,
                moving: person(cell, 12),
            })
            .collect();
        let (mut world, mut control) = (World::new(), World::new());
        for _ in 0..30 {
            world.step(Some(12), &[], &sliding);
            control.step(Some(12), &[], &[]);
        }
        let (person, wall) = world.moving(12);
        assert!(
            person > 0.95 && wall.abs() < f64::EPSILON,
            "{person} {wall}"
        );
        assert_eq!(control.moving(12), (0.0, 0.0));
    }

    #[test]
    fn who_goes_on_after_standing_for_long_moves_at_once() {
        let mut world = World::new();
        for _ in 0..150 {
            world.step(Some(12), &[], &[]);
        }
        assert!(world.surfaces.odds[15 * 40 + 16] < 0.0);
        // He turns on the spot: depths stay as they are, and only flow tells.
        let votes: Vec<Vote> = (0..world.cells.count())
            .map(|cell| Vote {
                cell,
                moving: person(cell, 12),
            })
            .collect();
        for _ in 0..5 {
            world.step(Some(12), &[], &votes);
        }
        let (person, wall) = world.moving(12);
        assert!(person > 0.9 && wall < 0.01, "{person} {wall}");
    }

    #[test]
    fn a_few_wrong_votes_do_not_move_a_wall() {
        let votes: Vec<Vote> = (0..1200)
            .filter(|c| c % 3 == 0)
            .map(|cell| Vote {
                cell,
                moving: cell % 15 == 0,
            })
            .collect();
        let mut world = World::new();
        for _ in 0..10 {
            world.step(None, &[], &votes);
        }
        assert!(world.moving(12).1.abs() < f64::EPSILON);
    }
}

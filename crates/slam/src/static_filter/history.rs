//! Earlier frames: their coarse depth and poses.

use super::cells::CELL_PX;
use super::surroundings::Surroundings;
use crate::anchored_pose::AnchoredPose;
use crate::recycle::{self, refill};
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, DepthImage, FrameId};
use stillpoint_map::MapView;

/// Duration of kept frames, s: the oldest of `AGES` (3 s) and the youngest (0.2 s) beyond it, as frames do not come at
/// just these times.
const SPAN: f64 = 3.2;

#[derive(Default)]
pub(super) struct Snapshot {
    pub(super) frame: FrameId,
    pub(super) stamp: f64,
    pub(super) grid: Arc<CoarseDepth>,
    /// Per cell, whether it was found to move.
    pub(super) moving: Vec<bool>,
    pub(super) around: Surroundings,
    place: CapturePose,
}

impl Snapshot {
    /// Camera pose at the colour stamp, in a view of the map.
    pub(super) fn world_from_camera(&self, view: &MapView) -> Se3 {
        self.place.anchored.best_world_from_camera(view)
    }

    /// Camera pose at the exposure of the depth image, in a view of the map.
    pub(super) fn world_from_depth(&self, view: &MapView) -> Se3 {
        self.world_from_camera(view) * self.place.camera_from_depth
    }
}

/// Poses at which a frame was captured.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CapturePose {
    /// Camera pose at the colour stamp, which follows corrections of the map.
    pub(crate) anchored: AnchoredPose,
    /// Camera motion between the exposures of the depth and the colour image.
    pub(crate) camera_from_depth: Se3,
}

/// Dropped frames, whose memory is reused.
#[derive(Default)]
pub(super) struct Spent {
    snapshots: Vec<Arc<Snapshot>>,
    grids: Vec<Arc<CoarseDepth>>,
}

impl Spent {
    pub(super) fn coarse(&mut self, depth: &DepthImage) -> Arc<CoarseDepth> {
        refill(self.grids.pop(), |grid| grid.rebuild(depth, CELL_PX))
    }

    fn take(&mut self, snapshot: Arc<Snapshot>) {
        if self.snapshots.len() < recycle::MOST {
            self.snapshots.push(snapshot);
        }
    }

    fn take_grid(&mut self, grid: Arc<CoarseDepth>) {
        if self.grids.len() < recycle::MOST {
            self.grids.push(grid);
        }
    }
}

/// The frames of the last seconds, oldest first. Cloning costs a pointer per frame.
#[derive(Clone, Default)]
pub(super) struct History {
    frames: VecDeque<Arc<Snapshot>>,
    /// The newest dropped frame.
    forgotten: Option<FrameId>,
}

impl History {
    pub(super) fn push(
        &mut self,
        frame: FrameId,
        stamp: f64,
        grid: Arc<CoarseDepth>,
        (moving, place): (impl Iterator<Item = bool>, &CapturePose),
        spent: &mut Spent,
    ) {
        // After the clock is set back, ages are meaningless.
        let jumped = self.last().is_some_and(|s| s.stamp >= stamp);
        let kept = |s: &Snapshot| !jumped && stamp - s.stamp <= SPAN;
        while let Some(old) = self.frames.pop_front_if(|s| !kept(s)) {
            self.forgotten = Some(old.frame);
            spent.take(old);
        }
        self.frames
            .push_back(refill(spent.snapshots.pop(), |s: &mut Snapshot| {
                (s.frame, s.stamp, s.place) = (frame, stamp, *place);
                s.moving.clear();
                s.moving.extend(moving);
                s.around.rebuild(grid.width(), grid.data(), &s.moving);
                spent.take_grid(std::mem::replace(&mut s.grid, grid));
            }));
    }

    pub(super) fn clear(&mut self) {
        self.frames.clear();
    }

    pub(super) fn become_like(&mut self, other: &Self) {
        self.frames.clone_from(&other.frames);
        self.forgotten = other.forgotten;
    }

    /// A history of the last frame only, relabelled as taken at `stamp` from `anchored`.
    pub(super) fn only_last(&self, frame: FrameId, stamp: f64, anchored: AnchoredPose) -> Self {
        let as_of = |s: &Snapshot| {
            Arc::new(Snapshot {
                frame,
                stamp,
                grid: Arc::clone(&s.grid),
                moving: s.moving.clone(),
                around: s.around.clone(),
                place: CapturePose {
                    anchored,
                    ..s.place
                },
            })
        };
        Self {
            frames: self.last().map(as_of).into_iter().collect(),
            forgotten: None,
        }
    }

    pub(super) fn last(&self) -> Option<&Snapshot> {
        self.frames.back().map(Arc::as_ref)
    }

    /// Whether a frame is older than all kept ones.
    pub(super) fn forgot(&self, frame: FrameId) -> bool {
        self.forgotten.is_some_and(|last| frame <= last)
    }

    pub(super) fn get(&self, frame: FrameId) -> Option<&Snapshot> {
        let i = self.frames.binary_search_by_key(&frame, |s| s.frame).ok()?;
        self.frames.get(i).map(Arc::as_ref)
    }

    /// The newest frames that are at least as old as each age (s, ascending) before `stamp`, without repetition.
    pub(super) fn at_ages<'a>(
        &'a self,
        stamp: f64,
        ages: &'a [f64],
    ) -> impl Iterator<Item = &'a Snapshot> {
        let mut last = None;
        ages.iter().filter_map(move |age| {
            let old_enough = |s: &Arc<Snapshot>| s.stamp <= stamp - age;
            let index = self.frames.partition_point(old_enough).checked_sub(1)?;
            (last.replace(index) != Some(index)).then(|| &*self.frames[index])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Vec3;
    use stillpoint_geometry::nalgebra::UnitQuaternion;
    use stillpoint_map::{KeyframeId, Map};

    fn shift(x: f64) -> Se3 {
        Se3::new(UnitQuaternion::identity(), Vec3::new(x, 0.0, 0.0))
    }

    fn push(history: &mut History, frame: u32, stamp: f64) {
        let place = CapturePose {
            anchored: AnchoredPose {
                keyframe: None,
                reference: KeyframeId(0),
                reference_from_camera: shift(0.1),
                online_world_from_camera: shift(0.5),
            },
            camera_from_depth: shift(0.01),
        };
        let grid = Arc::new(CoarseDepth::default());
        let nothing = std::iter::empty();
        history.push(
            FrameId(frame),
            stamp,
            grid,
            (nothing, &place),
            &mut Spent::default(),
        );
    }

    /// Frames at 30 Hz from 0 s on.
    fn filled(frames: u32) -> History {
        let mut history = History::default();
        for i in 0..frames {
            push(&mut history, i, f64::from(i) / 30.0);
        }
        history
    }

    fn stamps(history: &History, now: f64, ages: &[f64]) -> Vec<f64> {
        let found = history.at_ages(now, ages);
        found.map(|s| s.stamp).collect()
    }

    #[test]
    fn frames_are_the_newest_of_at_least_the_given_age() {
        let history = filled(90);
        let now = 3.0;
        let ages = [0.2, 0.4, 0.8, 1.6, 2.9];
        let found = stamps(&history, now, &ages);
        assert_eq!(found.len(), ages.len());
        for (stamp, age) in found.iter().zip(ages) {
            assert!(*stamp <= now - age && now - age - stamp < 1.0 / 30.0 + 1e-9);
        }
        // No frame is old enough, or one frame matches several ages.
        assert!(stamps(&history, now, &[3.1]).is_empty());
        assert_eq!(stamps(&history, now, &[2.99, 2.995]), [0.0]);
        assert!(stamps(&History::default(), now, &ages).is_empty());
    }

    #[test]
    fn frames_older_than_the_span_are_dropped() {
        let mut history = filled(300);
        let oldest = history.frames.front().unwrap().stamp;
        let newest = history.last().unwrap().stamp;
        assert!(newest - oldest <= SPAN && newest - oldest > SPAN - 0.05);
        let oldest = history.frames.front().unwrap().frame.0;
        assert!(history.forgot(FrameId(0)) && history.forgot(FrameId(oldest - 1)));
        assert!(!history.forgot(FrameId(oldest)) && !history.forgot(FrameId(999)));
        // After a long gap no other frame is left.
        push(&mut history, 300, newest + 10.0);
        assert_eq!(history.frames.len(), 1);
    }

    #[test]
    fn clock_jump_back_clears_the_history() {
        let mut history = filled(30);
        push(&mut history, 30, 0.5);
        assert_eq!(history.frames.len(), 1);
        assert_eq!(history.last().unwrap().frame, FrameId(30));
        assert!(history.forgot(FrameId(29)) && !history.forgot(FrameId(30)));
        // A repeated stamp resets as well: an age of zero would compare a frame with itself.
        push(&mut history, 31, 0.5);
        assert_eq!(history.frames.len(), 1);
        push(&mut history, 32, 0.6);
        assert_eq!(history.frames.len(), 2);
    }

    #[test]
    fn frames_are_found_by_their_number() {
        let mut history = History::default();
        // Not every frame was tracked.
        for i in [3, 4, 8, 9, 20] {
            push(&mut history, i, f64::from(i) / 30.0);
        }
        for i in 0..25 {
            let found = history.get(FrameId(i)).map(|s| s.frame);
            let known = [3, 4, 8, 9, 20].contains(&i);
            assert_eq!(found, known.then_some(FrameId(i)));
        }
    }

    #[test]
    fn poses_follow_their_keyframe_through_corrections() {
        let history = filled(1);
        let snapshot = history.last().unwrap();
        let mut map = Map::new(5, 1.45);
        let x = |pose: Se3| pose.translation.x;
        // No view has the keyframe yet.
        assert!((x(snapshot.world_from_camera(map.view())) - 0.5).abs() < 1e-12);
        let data = crate::synthetic::blank_keyframe(0.0);
        map.insert_keyframe(KeyframeId(0), Arc::new(data), shift(1.0), None);
        assert!((x(snapshot.world_from_camera(map.view())) - 1.1).abs() < 1e-12);
        map.set_pose(KeyframeId(0), shift(2.0));
        assert!((x(snapshot.world_from_camera(map.view())) - 2.1).abs() < 1e-12);
        assert!((x(snapshot.world_from_depth(map.view())) - 2.11).abs() < 1e-12);
    }
}

//! The way back over the first frames, and what follows from it.

use super::beginning::{Beginning, Kept};
use crate::anchored_pose::AnchoredPose;
use crate::mapping::{Mapper, MapperSetup};
use crate::messages::MapperMsg;
use crate::report::Outcome;
use crate::shutter::TYPICAL_DEPTH;
use crate::tracking::{Tracker, TurningPoint};
use crate::trajectory::TrajectoryEntry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::Map;

/// The way there and the way back agree on a pose if they differ by no more than this, m: each drifts by as much within a second and a half. Chosen:
/// beginnings that are right differ by 7 mm at most (decision 25).
const AGREE_M: f64 = 0.03;
/// The way there and the way back agree on a pose if they differ by no more than this angle, rad: 1.5 degrees, chosen as what moves things at 1.2 m
/// by [`AGREE_M`].
const AGREE_RAD: f64 = 0.026;
/// The way back is rejected if its jerks exceed those of the way there times this factor. When the pose begins or ceases to follow a person who
/// walks, its velocity changes at once; that of a carried camera does not. The way back knows the camera's momentum, which removes a quarter of its
/// jerks; the way there does not know the momentum yet. Measured: 0.30 to 0.87 of ways that are taken and 1.4 and 1.5 of ways that rode
/// (decision 45).
const MAX_JERKS: f64 = 1.0;
/// The way back is believed where it poses at least this share of the frames that it speaks about: chosen, as one that loses more than a tenth of
/// them is thin where the ways differ.
const MIN_POSED: f64 = 0.9;

/// A tracker on its way back, with a map of its own.
pub(super) struct WayBack {
    tracker: Tracker,
    mapper: Mapper,
    point: TurningPoint,
    /// Frames that are still to come, oldest first.
    frames: Vec<RgbdFrame>,
    detections: BTreeMap<FrameId, Detections>,
    /// The frames that were tracked again, with their stamps, s.
    stamps: BTreeMap<FrameId, f64>,
    /// Whether another map was begun on the way: then the way is lost.
    astray: bool,
}

/// Where frames are seen from the turning point.
type Way = BTreeMap<FrameId, Seen>;

/// Where one of them is.
struct Seen {
    point_from_camera: Se3,
    online_world_from_camera: Se3,
    inliers: u32,
    carried: bool,
}

impl WayBack {
    /// Begins the way back in a copy of the tracker's map without its beginning. None when there is no way.
    pub(super) fn begin(
        beginning: Beginning,
        tracker: &Tracker,
        setup: &MapperSetup,
    ) -> Option<Self> {
        let view = tracker.view();
        let Kept {
            frames,
            detections,
            point,
            image,
        } = beginning.into_kept()?;
        let keyframe = point.keyframe;
        let submap = view.submap_of(keyframe)?;
        // What was joined to another map meanwhile was recognised by the frames that are in question.
        if point.submap != Some(submap) || view.keyframe(keyframe).is_none() {
            return None;
        }
        let mut map = Map::from_view(&view, setup.levels, setup.scale_factor);
        map.revoke(|k| k.submap == submap && k.id < keyframe, keyframe);
        let mut mapper = Mapper::new(setup.clone()).with_map(map);
        let mirrored = tracker.mirrored(&point, &image, mapper.publish());
        Some(Self {
            tracker: mirrored?,
            mapper,
            point,
            frames,
            detections,
            stamps: BTreeMap::new(),
            astray: false,
        })
    }

    /// Whether all frames were tracked again.
    pub(super) fn is_over(&self) -> bool {
        self.frames.is_empty() || self.astray
    }

    /// Tracks the newest frame that is left.
    pub(super) fn step(&mut self) {
        let Some(mut frame) = self.frames.pop().filter(|_| !self.astray) else {
            return;
        };
        let _span = tracing::info_span!("retrace").entered();
        let original = frame.id;
        self.stamps.insert(original, frame.stamp);
        frame.id = self.mirrored_id(original);
        frame.stamp = self.mirrored_stamp(frame.stamp);
        frame.depth_stamp = self.mirrored_stamp(frame.depth_stamp);
        if let Some(seen) = self.detections.remove(&original) {
            let seen = Detections {
                frame: frame.id,
                stamp: frame.stamp,
                ..seen
            };
            self.tracker.receive_detections(seen, frame.id);
        }
        let tracked = self.tracker.track(&Arc::new(frame));
        self.astray = tracked.report.outcome == Outcome::Initialised;
        if let Some(keyframe) = tracked.keyframe.filter(|_| !self.astray) {
            let out = self.mapper.step(MapperMsg::Keyframe(Box::new(keyframe)));
            self.tracker.receive(out.view);
        }
    }

    /// Compares both ways. If they disagree, the way back replaces the poses of the tracker's trajectory, and the returned message tells the mapper what to
    /// revoke.
    pub(super) fn settle(&self, tracker: &mut Tracker) -> Option<MapperMsg> {
        let view = tracker.view();
        // A turning point that went to another map meanwhile tells nothing.
        if self.astray || self.point.submap != view.submap_of(self.point.keyframe) {
            return None;
        }
        let back = self.retraced()?;
        let first = *self.stamps.keys().next()?;
        let there = self.way_there(tracker, first)?;
        let differs = |id: &FrameId| {
            let (a, b) = (there.get(id)?, back.get(id)?);
            Some(differ(&a.point_from_camera, &b.point_from_camera))
        };
        // From the newest frame on which they do not agree back to the first.
        let last = *back.keys().rev().find(|id| differs(id) == Some(true))?;
        let posed = there.range(..=last).filter(|(id, _)| back.contains_key(id));
        let enough = posed.count() as f64 >= MIN_POSED * there.range(..=last).count() as f64;
        if !enough || self.jerks(&back) > MAX_JERKS * self.jerks(&there) {
            return None;
        }
        let world_from_point = view.world_from_keyframe(self.point.keyframe)?;
        let online = |id: &FrameId| there.get(id).map(|seen| seen.online_world_from_camera);
        let entry = |(id, point_from_camera, seen): (FrameId, Se3, &Seen)| {
            Some(TrajectoryEntry {
                frame: id,
                stamp: *self.stamps.get(&id)?,
                pose: AnchoredPose {
                    keyframe: None,
                    reference: self.point.keyframe,
                    reference_from_camera: point_from_camera,
                    online_world_from_camera: online(&id)
                        .unwrap_or(world_from_point * point_from_camera),
                },
                inliers: seen.inliers,
                carried: seen.carried,
            })
        };
        let entries = joined(&there, &back, last).into_iter().filter_map(entry);
        tracker.repose(first, last, entries.collect());
        Some(MapperMsg::Revoke {
            first: tracker.keyframe_id(first),
            last: tracker.keyframe_id(last),
        })
    }

    /// Where the frames from `first` on were, as the tracker says.
    fn way_there(&self, tracker: &Tracker, first: FrameId) -> Option<Way> {
        let view = tracker.view();
        let point_from_world = view.world_from_keyframe(self.point.keyframe)?.inverse();
        let entries = tracker.trajectory().entries().iter();
        let asked = entries.filter(|e| e.frame >= first && e.frame < self.point.frame);
        let seen = asked.map(|e| {
            let seen = Seen {
                point_from_camera: point_from_world * e.pose.best_world_from_camera(&view),
                online_world_from_camera: e.pose.online_world_from_camera,
                inliers: e.inliers,
                carried: e.carried,
            };
            (e.frame, seen)
        });
        Some(seen.collect())
    }

    /// By how much the camera's velocity changes from frame to frame on a way over these frames, m per frame.
    fn jerks(&self, way: &Way) -> f64 {
        let stamped = way
            .iter()
            .filter_map(|(id, seen)| Some((*self.stamps.get(id)?, seen.point_from_camera)));
        let stamped: Vec<(f64, Se3)> = stamped.collect();
        let velocity = |w: &[(f64, Se3)]| {
            let seconds = w[1].0 - w[0].0;
            let twist = (w[0].1.inverse() * w[1].1).log() / seconds;
            (twist, seconds)
        };
        let velocities: Vec<(Vec6, f64)> = stamped.windows(2).map(velocity).collect();
        let jerk = |w: &[(Vec6, f64)]| {
            let change = (w[1].0 - w[0].0) * (0.5 * (w[0].1 + w[1].1));
            let (shift, turn) = (change.fixed_rows::<3>(0), change.fixed_rows::<3>(3));
            libm::hypot(shift.norm(), TYPICAL_DEPTH * turn.norm())
        };
        let count = velocities.len().saturating_sub(1).max(1);
        velocities.windows(2).map(jerk).sum::<f64>() / count as f64
    }

    /// Where the frames that were tracked again are, by the map of the way back.
    fn retraced(&self) -> Option<Way> {
        let view = self.tracker.view();
        let point_from_world = view.world_from_keyframe(self.point.keyframe)?.inverse();
        let poses = self.tracker.trajectory().resolve(&view);
        let seen = poses.map(|(entry, pose)| {
            let seen = Seen {
                point_from_camera: point_from_world * pose,
                online_world_from_camera: entry.pose.online_world_from_camera,
                inliers: entry.inliers,
                carried: entry.carried,
            };
            (self.mirrored_id(entry.frame), seen)
        });
        Some(seen.collect())
    }

    /// The id of a frame on the way back, and of a frame of the way back. The turning point has 0, and those before it count on.
    fn mirrored_id(&self, frame: FrameId) -> FrameId {
        FrameId(self.point.frame.0.saturating_sub(frame.0))
    }

    /// A stamp on the way back, s: the turning point keeps its own.
    fn mirrored_stamp(&self, stamp: f64) -> f64 {
        2.0 * self.point.stamp - stamp
    }
}

/// Poses by the way back of all frames up to `last` that either way has, oldest first. A frame without a pose on the way back gets its motion to the next
/// frame that both ways have from the way there.
fn joined<'a>(there: &'a Way, back: &'a Way, last: FrameId) -> Vec<(FrameId, Se3, &'a Seen)> {
    let posed = there.range(..=last).chain(back.range(..=last));
    let frames: BTreeSet<FrameId> = posed.map(|(id, _)| *id).collect();
    let mut next = None;
    let mut poses: Vec<(FrameId, Se3, &Seen)> = Vec::with_capacity(frames.len());
    for id in frames.into_iter().rev() {
        let pose = match (there.get(&id), back.get(&id)) {
            (before, Some(seen)) => {
                next = before
                    .map(|b| (b.point_from_camera, seen.point_from_camera))
                    .or(next);
                Some((seen.point_from_camera, seen))
            }
            (Some(seen), None) => {
                next.map(|(there, back)| (back * there.inverse() * seen.point_from_camera, seen))
            }
            (None, None) => None,
        };
        poses.extend(pose.map(|(pose, seen)| (id, pose, seen)));
    }
    poses.reverse();
    poses
}

/// Whether two poses differ by more than both ways err by.
fn differ(a: &Se3, b: &Se3) -> bool {
    let d = a.inverse() * *b;
    d.translation.norm() > AGREE_M || d.rotation.angle() > AGREE_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Vec3;

    fn way(places: &[(u32, f64)]) -> Way {
        let seen = |(id, x): &(u32, f64)| {
            let seen = Seen {
                point_from_camera: Se3 {
                    translation: Vec3::new(*x, 0.0, 0.0),
                    ..Se3::identity()
                },
                online_world_from_camera: Se3::identity(),
                inliers: 100,
                carried: false,
            };
            (FrameId(*id), seen)
        };
        places.iter().map(seen).collect()
    }

    #[test]
    fn frames_that_only_one_way_has_keep_a_pose() {
        let there = way(&[(0, 5.0), (1, 4.0), (2, 2.5), (4, 1.0), (5, 0.5)]);
        // The way there is off by a metre up to frame 4; frame 2 is lost on the way back, and frame 3 on the way there.
        let back = way(&[(0, 4.2), (1, 3.0), (3, 0.6), (4, 0.0), (5, 0.5)]);
        let found = joined(&there, &back, FrameId(4));
        let found: Vec<(u32, f64)> = found
            .iter()
            .map(|(id, p, _)| (id.0, p.translation.x))
            .collect();
        assert_eq!(found, [(0, 4.2), (1, 3.0), (2, 1.5), (3, 0.6), (4, 0.0)]);
    }
}

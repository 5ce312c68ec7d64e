//! Backward tracking of the first frames, and the comparison with forward tracking.

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

/// Maximum position difference at which forward and backward poses agree, m: each drifts by as much within a second and
/// a half. Chosen: correct beginnings differ by 7 mm at most (decision 25).
const AGREE_M: f64 = 0.03;
/// Maximum rotation difference at which they agree, rad: 1.5 degrees, chosen as displacing points at 1.2 m by
/// [`AGREE_M`].
const AGREE_RAD: f64 = 0.026;
/// The backward poses are rejected if their jerk exceeds that of the forward poses times this factor. When a pose
/// begins or ceases to follow a walking person, its velocity jumps; that of a carried camera does not. Backward
/// tracking has a motion model, which removes a quarter of its jerk; forward tracking has none yet. Measured: 0.30 to
/// 0.87 of accepted trajectories and 1.4 and 1.5 of those that followed a person (decision 45).
const MAX_JERKS: f64 = 1.0;
/// Minimum share of the differing frames with a backward pose: chosen, as a trajectory that loses more than a tenth of
/// them is poorly supported.
const MIN_POSED: f64 = 0.9;

/// A tracker running backwards, with its own map.
pub(super) struct WayBack {
    tracker: Tracker,
    mapper: Mapper,
    point: TurningPoint,
    /// Remaining frames, oldest first.
    frames: Vec<RgbdFrame>,
    detections: BTreeMap<FrameId, Detections>,
    /// Stamps of the frames tracked again, s.
    stamps: BTreeMap<FrameId, f64>,
    /// Whether another map was started on the way, which invalidates the result.
    astray: bool,
}

/// Poses of frames relative to the turning point.
type Way = BTreeMap<FrameId, Seen>;

struct Seen {
    point_from_camera: Se3,
    online_world_from_camera: Se3,
    inliers: u32,
    carried: bool,
}

impl WayBack {
    /// Starts backward tracking in a copy of the tracker's map without its first keyframes. `None` if that is
    /// impossible.
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
        // If the submap was joined to another meanwhile, the first frames were used for that.
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

    /// Whether all frames were tracked again, or the attempt failed.
    pub(super) fn is_over(&self) -> bool {
        self.frames.is_empty() || self.astray
    }

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

    /// Compares both trajectories. If they disagree, replaces the poses in the tracker's trajectory and returns the
    /// message that revokes the keyframes.
    pub(super) fn settle(&self, tracker: &mut Tracker) -> Option<MapperMsg> {
        let view = tracker.view();
        // The turning point moved to another submap meanwhile.
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
        // The newest frame on which they disagree; all older ones are replaced.
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

    /// Forward poses of the frames from `first` on.
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

    /// Mean velocity change of the camera between frames, m per frame; rotations count at the typical depth.
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

    /// Id of a frame in reverse order; its own inverse. The turning point has 0.
    fn mirrored_id(&self, frame: FrameId) -> FrameId {
        FrameId(self.point.frame.0.saturating_sub(frame.0))
    }

    /// Stamp in reverse order, s, mirrored at the turning point.
    fn mirrored_stamp(&self, stamp: f64) -> f64 {
        2.0 * self.point.stamp - stamp
    }
}

/// Backward poses of all frames up to `last` that have a pose in either trajectory, oldest first. A frame without a
/// backward pose takes its motion relative to the next common frame from the forward poses.
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

/// Whether two poses differ by more than the tolerance.
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
    fn frames_tracked_in_one_direction_keep_a_pose() {
        let there = way(&[(0, 5.0), (1, 4.0), (2, 2.5), (4, 1.0), (5, 0.5)]);
        // The forward poses are off by a metre up to frame 4; frame 2 has no backward pose, and frame 3 no forward
        // pose.
        let back = way(&[(0, 4.2), (1, 3.0), (3, 0.6), (4, 0.0), (5, 0.5)]);
        let found = joined(&there, &back, FrameId(4));
        let found: Vec<(u32, f64)> = found
            .iter()
            .map(|(id, p, _)| (id.0, p.translation.x))
            .collect();
        assert_eq!(found, [(0, 4.2), (1, 3.0), (2, 1.5), (3, 0.6), (4, 0.0)]);
    }
}

//! The trajectory: what each frame's pose was when it was tracked, and what it is after all corrections.

use crate::anchored_pose::AnchoredPose;
use crate::fingerprint::Fingerprint;
use crate::smoothing::smooth;
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};

/// One frame of the trajectory. Its pose is relative to a keyframe, whose own pose may still improve. It is rewritten only when the first
/// frames of a map are tracked again ([`Retracer`](crate::Retracer)).
#[derive(Clone, Copy, Debug)]
pub struct TrajectoryEntry {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Its pose, by keyframes.
    pub pose: AnchoredPose,
    /// Landmark matches that agreed with the pose.
    pub inliers: u32,
    /// Whether its direction was carried by the gyroscope, and its place by little or nothing ([`Outcome::Carried`](crate::Outcome::Carried)).
    pub carried: bool,
}

/// All frames in which a pose was measured, in order.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    entries: Vec<TrajectoryEntry>,
    revision: u64,
}

/// Frames that were tracked later.
impl Extend<TrajectoryEntry> for Trajectory {
    fn extend<I: IntoIterator<Item = TrajectoryEntry>>(&mut self, entries: I) {
        self.entries.extend(entries);
    }
}

impl Trajectory {
    /// Appends an entry.
    pub(crate) fn push(&mut self, entry: TrajectoryEntry) {
        self.entries.push(entry);
    }

    /// Replaces the entries from one frame to another by `new`, which are in order.
    pub(crate) fn replace(&mut self, first: FrameId, last: FrameId, new: Vec<TrajectoryEntry>) {
        let from = self.entries.partition_point(|e| e.frame < first);
        let to = self.entries.partition_point(|e| e.frame <= last);
        self.entries.splice(from..to.max(from), new);
        self.revision += 1;
    }

    /// Forgets all entries but the newest.
    pub(crate) fn keep_newest(&mut self, most: usize) {
        let old = self.entries.len().saturating_sub(most);
        if old > 0 {
            self.entries.drain(..old);
            self.revision += 1;
        }
    }

    /// How often entries that were there were replaced or forgotten.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The entries, in the order of frames.
    #[must_use]
    pub fn entries(&self) -> &[TrajectoryEntry] {
        &self.entries
    }

    /// The final pose of every entry: that of the keyframe that the frame became, else through its reference keyframe in `view`. A
    /// culled keyframe resolves through its tombstone; an entry none of whose keyframes is in `view` yet keeps its online pose.
    ///
    /// What the map has learnt of a keyframe since it was measured (refinement, loops) holds for the frames that led to it as well:
    /// it is spread over them, linearly in time, where they were measured from the same keyframe, as far as it is more than what the
    /// keyframe itself may have been off by chance.
    pub fn resolve<'a>(
        &'a self,
        view: &'a MapView,
    ) -> impl Iterator<Item = (TrajectoryEntry, Se3)> + 'a {
        let nodes: Vec<Node> = self.entries.iter().filter_map(Node::of(view)).collect();
        let mut next = 0;
        self.entries.iter().map(move |entry| {
            let pose = entry.pose.best_world_from_camera(view);
            next += usize::from(nodes.get(next).is_some_and(|n| n.frame < entry.frame));
            let before = next.checked_sub(1).map(|k| &nodes[k]);
            let learnt = nodes
                .get(next)
                .and_then(|after| after.spread_to(entry, before));
            (*entry, learnt.map_or(pose, |l| l.apply(&pose)))
        })
    }

    /// The final poses, each of which is what the camera most probably did by those of [`Trajectory::resolve`] before and after it: these err by themselves, and
    /// no hand and no robot moves a camera as they jitter. Frames in a row of one submap count, without a gap of a quarter of a second; poses that were carried
    /// stay. Takes time in proportion to the entries: a tenth of a second for 10 minutes at 30 Hz.
    #[must_use]
    pub fn smoothed(&self, view: &MapView) -> Vec<(TrajectoryEntry, Se3)> {
        let mut all: Vec<(TrajectoryEntry, Se3)> = self.resolve(view).collect();
        let submap = |e: &TrajectoryEntry| view.submap_of(e.pose.reference);
        let follows = |a: &TrajectoryEntry, b: &TrajectoryEntry| {
            let gap = b.stamp - a.stamp;
            let in_row = (SHORTEST_GAP..LONGEST_GAP).contains(&gap) && submap(a) == submap(b);
            in_row && !a.carried && !b.carried
        };
        for run in all.chunk_by_mut(|a, b| follows(&a.0, &b.0)) {
            let stamps: Vec<f64> = run.iter().map(|(e, _)| e.stamp).collect();
            let mut poses: Vec<Se3> = run.iter().map(|(_, p)| *p).collect();
            smooth(&stamps, &mut poses);
            for ((_, pose), smoothed) in run.iter_mut().zip(poses) {
                *pose = smoothed;
            }
        }
        all
    }

    /// A number that depends on every bit of every entry and of its final pose: two runs with the same one are the same, bit
    /// for bit.
    #[must_use]
    pub fn digest(&self, view: &MapView) -> u64 {
        let mut f = Fingerprint::default();
        for (entry, pose) in self.resolve(view) {
            f.number(u64::from(entry.frame.0));
            f.number(entry.stamp.to_bits());
            f.number(u64::from(entry.pose.reference.0));
            f.number(u64::from(entry.inliers));
            if entry.carried {
                f.number(1);
            }
            for pose in [
                &entry.pose.reference_from_camera,
                &entry.pose.online_world_from_camera,
                &pose,
            ] {
                f.pose(pose);
            }
        }
        f.value()
    }
}

/// A frame that became a keyframe which the map holds.
struct Node {
    frame: FrameId,
    stamp: f64,
    keyframe: KeyframeId,
    /// The keyframe that its pose was measured from.
    reference: KeyframeId,
    /// What the map has learnt of it since.
    learnt: Learnt,
}

/// What measuring a keyframe again may change by chance, rad: a third of a pixel of a usual camera, or 1.4 mm at
/// [`TYPICAL_DEPTH`]. That is the keyframe's own error and tells nothing of the frames before it.
const NOISE: f64 = 0.0007;

/// The depth at which a motion is compared with a turn, m: that of things in a room.
const TYPICAL_DEPTH: f64 = 2.0;

/// Frames that are farther apart say nothing of each other's jitter, s ...
const LONGEST_GAP: f64 = 0.25;
/// ... and stamps that are nearer are no times of two frames.
const SHORTEST_GAP: f64 = 1e-4;

/// How a pose differs from the one that was measured.
#[derive(Clone, Copy, Default)]
struct Learnt {
    /// Rotation vector in the world's axes, rad.
    rotation: Vec3,
    /// m.
    translation: Vec3,
}

impl Node {
    fn of(view: &MapView) -> impl Fn(&TrajectoryEntry) -> Option<Self> + use<'_> {
        |entry| {
            let keyframe = entry.pose.keyframe?;
            let own = view.world_from_keyframe(keyframe)?;
            let reference = entry.pose.reference;
            let measured = view.world_from_keyframe(reference)? * entry.pose.reference_from_camera;
            let learnt = Learnt {
                rotation: so3::log(&(own.rotation * measured.rotation.inverse())),
                translation: own.translation - measured.translation,
            };
            Some(Self {
                frame: entry.frame,
                stamp: entry.stamp,
                keyframe,
                reference,
                learnt,
            })
        }
    }

    /// What a frame before this one learns from it, if it was measured from the same keyframe: its share by time since the
    /// keyframe before.
    fn spread_to(&self, entry: &TrajectoryEntry, before: Option<&Self>) -> Option<Learnt> {
        let reference = entry.pose.reference;
        let before = before.filter(|_| reference == self.reference && entry.frame < self.frame)?;
        // A keyframe is where it is: who was measured from it has nothing to learn there.
        let known = before.reference == reference && before.keyframe != reference;
        let from = if known {
            before.learnt
        } else {
            Learnt::default()
        };
        let share = (entry.stamp - before.stamp) / (self.stamp - before.stamp);
        // How much of the change is more than chance (a Wiener filter's gain).
        let change = from.difference(&self.learnt);
        let trust = change * change / (change * change + NOISE * NOISE);
        Some(from.towards(&self.learnt, share.clamp(0.0, 1.0) * trust))
    }
}

impl Learnt {
    fn towards(&self, to: &Self, share: f64) -> Self {
        Self {
            rotation: self.rotation.lerp(&to.rotation, share),
            translation: self.translation.lerp(&to.translation, share),
        }
    }

    /// How far the view of a thing at [`TYPICAL_DEPTH`] is apart by both, rad.
    fn difference(&self, other: &Self) -> f64 {
        let turned = (self.rotation - other.rotation).norm();
        let moved = (self.translation - other.translation).norm();
        libm::hypot(moved / TYPICAL_DEPTH, turned)
    }

    fn apply(&self, pose: &Se3) -> Se3 {
        Se3 {
            rotation: so3::exp(&self.rotation) * pose.rotation,
            translation: pose.translation + self.translation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchored_pose::AnchoredPose;
    use std::sync::Arc;
    use stillpoint_features::FeatureGrid;
    use stillpoint_geometry::Camera;
    use stillpoint_map::{KeyframeData, Map};

    fn at(x: f64, turned: f64) -> Se3 {
        Se3 {
            rotation: so3::exp(&Vec3::new(0.0, turned, 0.0)),
            translation: Vec3::new(x, 0.0, 0.0),
        }
    }

    fn add(map: &mut Map, id: u32, parent: Option<u32>, pose: Se3) {
        let data = KeyframeData {
            stamp: f64::from(id),
            camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
            keypoints: Vec::new(),
            positions: Vec::new(),
            sigma_px: Vec::new(),
            depths: Vec::new(),
            depth_sigmas: Vec::new(),
            descriptors: Arc::default(),
            mappable: Vec::new(),
            grid: FeatureGrid::build(&[], &[], [0.0, 0.0, 640.0, 480.0]),
        };
        let parent = parent.map(KeyframeId);
        assert!(map.insert_keyframe(KeyframeId(id), Arc::new(data), pose, parent));
    }

    /// A frame at `id` seconds, measured at `x` from a keyframe.
    fn entry(id: u32, is_keyframe: bool, reference: u32, x: f64) -> TrajectoryEntry {
        TrajectoryEntry {
            carried: false,
            frame: FrameId(id),
            stamp: f64::from(id),
            pose: AnchoredPose {
                keyframe: is_keyframe.then_some(KeyframeId(id)),
                reference: KeyframeId(reference),
                reference_from_camera: at(x, 0.0),
                online_world_from_camera: at(x, 0.0),
            },
            inliers: 100,
        }
    }

    fn resolved(entries: &[TrajectoryEntry], map: &Map) -> Vec<[f64; 2]> {
        let mut trajectory = Trajectory::default();
        trajectory.extend(entries.iter().copied());
        let poses = trajectory.resolve(map.view());
        let found = poses.map(|(_, p)| [p.translation.x, so3::log(&p.rotation).y]);
        found.collect()
    }

    #[track_caller]
    fn check(found: &[[f64; 2]], expected: &[[f64; 2]]) {
        let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        let same = found.len() == expected.len();
        assert!(
            same && found.iter().zip(expected).all(|p| off(p) < 1e-4),
            "{found:?} where {expected:?} was expected"
        );
    }

    #[test]
    fn what_is_learnt_of_a_keyframe_is_spread_over_the_frames_before_it() {
        let mut map = Map::new(8, 1.2);
        add(&mut map, 0, None, at(0.0, 0.0));
        // Measured at 0.4, refined to 0.44 and turned by 0.2.
        add(&mut map, 4, Some(0), at(0.44, 0.2));
        let frames = [
            entry(0, true, 0, 0.0),
            entry(1, false, 0, 0.1),
            entry(2, false, 0, 0.2),
            entry(3, false, 0, 0.3),
            entry(4, true, 0, 0.4),
            entry(5, false, 0, 0.5),
        ];
        let spread = [
            [0.0, 0.0],
            [0.11, 0.05],
            [0.22, 0.1],
            [0.33, 0.15],
            [0.44, 0.2],
        ];
        // Nothing is known of what comes after the last keyframe.
        check(
            &resolved(&frames, &map),
            &[&spread[..], &[[0.5, 0.0]]].concat(),
        );
    }

    #[test]
    fn what_may_be_a_keyframes_own_error_is_not_spread() {
        let frames = [
            entry(0, true, 0, 0.0),
            entry(1, false, 0, 0.1),
            entry(2, true, 0, 0.2),
        ];
        // As much as chance: half of it. Far less: nothing. Far more: all. The frame in the middle has half of that.
        for (off, spread) in [(0.0014, 0.5), (0.0001, 0.005), (0.05, 0.9992)] {
            let mut map = Map::new(8, 1.2);
            add(&mut map, 0, None, at(0.0, 0.0));
            add(&mut map, 2, Some(0), at(0.2 + off, 0.0));
            let found = resolved(&frames, &map)[1][0] - 0.1;
            assert!(
                (found / (0.5 * off) - spread).abs() < 0.001,
                "{off}: {found}"
            );
        }
    }

    #[test]
    fn frames_measured_from_another_keyframe_stay() {
        let mut map = Map::new(8, 1.2);
        add(&mut map, 0, None, at(0.0, 0.0));
        add(&mut map, 2, Some(0), at(0.26, 0.0));
        add(&mut map, 4, Some(2), at(0.5, 0.0));
        let frames = [
            entry(0, true, 0, 0.0),
            entry(1, false, 0, 0.1),
            entry(2, true, 0, 0.2),
            // Measured from the first keyframe, while the next one was measured from the second.
            entry(3, false, 0, 0.3),
            entry(4, true, 2, 0.2),
        ];
        let expected = [[0.0, 0.0], [0.13, 0.0], [0.26, 0.0], [0.3, 0.0], [0.5, 0.0]];
        check(&resolved(&frames, &map), &expected);
        // Were both measured from the first, what is known of it at either end counts: 0.06 and 0.1.
        let frames = [
            entry(0, true, 0, 0.0),
            entry(2, true, 0, 0.2),
            entry(3, false, 0, 0.3),
            entry(4, true, 0, 0.4),
        ];
        let expected = [[0.0, 0.0], [0.26, 0.0], [0.38, 0.0], [0.5, 0.0]];
        check(&resolved(&frames, &map), &expected);
    }
}

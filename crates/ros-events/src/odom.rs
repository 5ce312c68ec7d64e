//! The `odom` frame, which never jumps, and its pose in the map (REP-105).
//!
//! Answers: the camera's pose in `odom`, and the transform from that to the map. While the map is not corrected, both frames move together.
//! A correction (a loop, the beginning revoked, a submap joined) changes the transform by the shift of the newest keyframe; after a loss,
//! and at the beginning of a submap, `odom` continues from its last pose.

use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_map::{MapView, SubmapId};
use stillpoint_slam::{Event, FrameReport, Outcome};

/// A frame with a pose, in all frames of reference. All axes are those of cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// The submap whose frame of reference is the world here.
    pub submap: SubmapId,
    /// Pose of `odom` in the world.
    pub world_from_odom: Se3,
    /// Pose of the camera in `odom`.
    pub odom_from_camera: Se3,
    /// Pose of the camera in the world, as reported.
    pub world_from_camera: Se3,
    /// Velocity of the camera `[translation; rotation]` in its own axes since the previous frame, m/s and rad/s; `None` at the first frame
    /// and after a loss.
    pub velocity: Option<Vec6>,
    /// Time since the previous frame with a pose, s.
    pub since: Option<f64>,
}

/// Tracks `odom` through a run. It must receive every event.
#[derive(Clone, Debug)]
pub struct Odom {
    odom_from_world: Se3,
    last: Option<Last>,
    /// Whether the last frame had no pose.
    lost: bool,
    view: Option<Arc<MapView>>,
    /// Corrections that the tracker has not yet applied.
    pending: VecDeque<Correction>,
}

#[derive(Clone, Debug)]
struct Last {
    stamp: f64,
    submap: SubmapId,
    odom_from_camera: Se3,
    velocity: Option<Vec6>,
}

/// Shift of the camera by a correction.
#[derive(Clone, Debug)]
struct Correction {
    /// First version of the map with the correction.
    version: u64,
    /// New world from old world, and its submap; `None` if no keyframe determines it.
    shift: Option<(Se3, SubmapId)>,
}

impl Default for Odom {
    fn default() -> Self {
        Self {
            odom_from_world: Se3::identity(),
            last: None,
            lost: false,
            view: None,
            pending: VecDeque::new(),
        }
    }
}

impl Odom {
    /// Another map replaces the current one: the camera will be localised in it, and `odom` continues from its last pose.
    pub fn begin_other_map(&mut self) {
        self.lost = true;
        self.view = None;
        self.pending.clear();
        // No submap of the other map has this number.
        if let Some(last) = &mut self.last {
            last.submap = SubmapId(u32::MAX);
        }
    }

    /// Takes an event; returns the location if it is a frame with a pose.
    pub fn take(&mut self, event: &Event) -> Option<Located> {
        if let Event::Corrected { view, .. } | Event::Revoked { view, .. } = event {
            let shift = self.shift_to(view);
            self.pending.push_back(Correction {
                version: view.version(),
                shift,
            });
        }
        if let Some(view) = event.view() {
            self.view = Some(Arc::clone(view));
        }
        self.locate(&event.as_frame()?.report)
    }

    /// Shift, by a new version of the map, of the newest keyframe that both versions have.
    fn shift_to(&self, view: &MapView) -> Option<(Se3, SubmapId)> {
        let before = self.view.as_ref()?;
        let here = self.last.as_ref()?.submap;
        let mut candidates: Vec<_> = before.keyframes().filter(|k| k.submap == here).collect();
        candidates.sort_by_key(|k| std::cmp::Reverse(k.id));
        let (was, now) = candidates
            .into_iter()
            .find_map(|k| Some((k, view.keyframe(k.id)?)))?;
        let shift = now.world_from_camera * was.world_from_camera.inverse();
        Some((shift, now.submap))
    }

    fn locate(&mut self, report: &FrameReport) -> Option<Located> {
        let (Some(pose), Some(submap)) = (report.world_from_camera, report.submap) else {
            self.lost = true;
            return None;
        };
        let mut torn = matches!(
            report.outcome,
            Outcome::Initialised | Outcome::Relocalised { .. }
        );
        let mut here = self.last.as_ref().map_or(submap, |last| last.submap);
        while let Some(next) = self.pending.front()
            && next.version <= report.map_version
        {
            if let Some((shift, submap)) = &next.shift {
                self.odom_from_world = self.odom_from_world * shift.inverse();
                here = *submap;
            } else {
                torn = true;
            }
            self.pending.pop_front();
        }
        torn |= here != submap;
        let since = self.last.as_ref().map(|last| report.stamp - last.stamp);
        if let (true, Some(last)) = (torn, &self.last) {
            self.odom_from_world = last.expected(report.stamp, self.lost) * pose.inverse();
        }
        self.odom_from_world.rotation.renormalize();
        let odom_from_camera = self.odom_from_world * pose;
        let velocity = self
            .last
            .as_ref()
            .filter(|last| !self.lost && report.stamp > last.stamp)
            .map(|last| {
                (last.odom_from_camera.inverse() * odom_from_camera).log()
                    / (report.stamp - last.stamp)
            });
        self.lost = false;
        self.last = Some(Last {
            stamp: report.stamp,
            submap,
            odom_from_camera,
            velocity,
        });
        Some(Located {
            submap,
            world_from_odom: self.odom_from_world.inverse(),
            odom_from_camera,
            world_from_camera: pose,
            velocity,
            since,
        })
    }
}

impl Last {
    /// Predicted pose at a later time: at constant velocity, or after a loss unchanged.
    fn expected(&self, stamp: f64, lost: bool) -> Se3 {
        match self.velocity {
            Some(velocity) if !lost => {
                self.odom_from_camera * Se3::exp(&(velocity * (stamp - self.stamp)))
            }
            _ => self.odom_from_camera,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_features::FeatureGrid;
    use stillpoint_geometry::{Camera, Vec3, so3};
    use stillpoint_imaging::FrameId;
    use stillpoint_map::{KeyframeData, KeyframeId, Map};
    use stillpoint_slam::{CorrectionReport, FrameCounts, MapShift, Segments};

    fn at(x: f64, turned: f64) -> Se3 {
        Se3::new(
            so3::exp(&Vec3::new(0.0, turned, 0.0)),
            Vec3::new(x, 0.0, 0.0),
        )
    }

    fn map(poses: &[Se3]) -> Map {
        let data = Arc::new(KeyframeData {
            stamp: 0.0,
            camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
            keypoints: Vec::new(),
            positions: Vec::new(),
            sigma_px: Vec::new(),
            depths: Vec::new(),
            depth_sigmas: Vec::new(),
            descriptors: Arc::default(),
            mappable: Vec::new(),
            grid: FeatureGrid::build(&[], &[], [0.0, 0.0, 640.0, 480.0]),
        });
        let mut map = Map::new(8, 1.2);
        for (i, pose) in poses.iter().enumerate() {
            let parent = (i > 0).then_some(KeyframeId(0));
            map.insert_keyframe(KeyframeId(i as u32), Arc::clone(&data), *pose, parent);
        }
        map
    }

    fn frame(number: u32, pose: Option<Se3>, version: u64) -> FrameReport {
        FrameReport {
            inertial: None,
            odometry: None,
            frame: FrameId(number),
            stamp: f64::from(number) / 10.0,
            outcome: Outcome::Tracked,
            world_from_camera: pose,
            undecided: None,
            verdicts: [].into(),
            segments: Segments::default(),
            objects: [].into(),
            counts: FrameCounts::default(),
            still: None,
            is_keyframe: false,
            submap: pose.map(|_| SubmapId(0)),
            map_version: version,
        }
    }

    fn corrected(view: Arc<MapView>) -> Event {
        Event::Corrected {
            report: CorrectionReport {
                map_version: view.version(),
                base_version: 0,
                keyframes: 0,
                composed: 0,
                propagated: 0,
                merged: 0,
                moved: MapShift::default(),
            },
            view,
        }
    }

    #[track_caller]
    fn check(found: &Se3, expected: &Se3) {
        let off = (found.inverse() * *expected).log().norm();
        assert!(off < 1e-9, "{found:?} where {expected:?} was expected");
    }

    /// In any case the two transforms give the pose.
    #[track_caller]
    fn locate(odom: &mut Odom, report: &FrameReport) -> Located {
        let located = odom.locate(report).unwrap();
        let found = located.world_from_odom * located.odom_from_camera;
        check(&found, &report.world_from_camera.unwrap());
        located
    }

    #[test]
    fn odom_equals_the_map_without_corrections() {
        let mut odom = Odom::default();
        for i in 0..4 {
            let pose = at(0.1 * f64::from(i), 0.02 * f64::from(i));
            let located = locate(&mut odom, &frame(i, Some(pose), 1));
            check(&located.odom_from_camera, &pose);
            assert_eq!(located.velocity.is_some(), i > 0);
            if let Some(velocity) = located.velocity {
                assert!((velocity.norm() - 1.02).abs() < 0.01, "{velocity}");
            }
        }
    }

    #[test]
    fn correction_moves_the_map_and_not_odom() {
        let mut odom = Odom::default();
        let mut map = map(&[at(0.0, 0.0), at(0.3, 0.1)]);
        odom.view = Some(map.publish());
        locate(&mut odom, &frame(0, Some(at(0.3, 0.1)), 1));
        locate(&mut odom, &frame(1, Some(at(0.4, 0.1)), 1));
        let shift = at(0.5, -0.2);
        map.set_pose(KeyframeId(1), shift * at(0.3, 0.1));
        let view = map.publish();
        let version = view.version();
        assert!(odom.take(&corrected(view)).is_none());
        // Tracking has not applied it yet.
        let before = locate(&mut odom, &frame(2, Some(at(0.5, 0.1)), version - 1));
        check(&before.world_from_odom, &Se3::identity());
        let after = locate(&mut odom, &frame(3, Some(shift * at(0.6, 0.1)), version));
        check(&after.odom_from_camera, &at(0.6, 0.1));
        check(&after.world_from_odom, &shift);
        // The velocity does not include it.
        assert!((after.velocity.unwrap() - before.velocity.unwrap()).norm() < 1e-9);
    }

    #[test]
    fn odom_continues_without_remaining_keyframes() {
        let mut odom = Odom {
            view: Some(map(&[at(0.0, 0.0)]).publish()),
            ..Odom::default()
        };
        locate(&mut odom, &frame(0, Some(at(0.0, 0.0)), 0));
        locate(&mut odom, &frame(1, Some(at(0.1, 0.0)), 0));
        let mut other = map(&[at(5.0, 1.0), at(6.0, 1.0)]);
        assert!(other.cull_keyframe(KeyframeId(1)));
        let mut empty = Map::new(8, 1.2);
        odom.take(&corrected(empty.publish()));
        let after = locate(&mut odom, &frame(2, Some(at(3.0, 0.4)), u64::MAX));
        check(&after.odom_from_camera, &at(0.2, 0.0));
    }

    #[test]
    fn odom_continues_after_a_loss_or_submap_change() {
        let mut odom = Odom::default();
        locate(&mut odom, &frame(0, Some(at(0.0, 0.0)), 1));
        locate(&mut odom, &frame(1, Some(at(0.1, 0.0)), 1));
        assert_eq!(odom.locate(&frame(2, None, 1)), None);
        let mut found = frame(3, Some(at(0.9, 0.3)), 1);
        found.outcome = Outcome::Relocalised {
            since: FrameId(2),
            with: KeyframeId(0),
        };
        let located = locate(&mut odom, &found);
        check(&located.odom_from_camera, &at(0.1, 0.0));
        assert_eq!(located.velocity, None);
        let mut begun = frame(4, Some(Se3::identity()), 1);
        begun.submap = Some(SubmapId(4));
        let located = locate(&mut odom, &begun);
        assert_eq!(located.submap, SubmapId(4));
        check(&located.odom_from_camera, &at(0.1, 0.0));
    }
}

//! Covariances of a whole trajectory, computed with the final map.

use super::MapCovariance;
use crate::trajectory::TrajectoryEntry;
use std::collections::BTreeMap;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_imaging::FrameId;
use stillpoint_map::MapView;

/// Covariance of a pose of a trajectory, `[translation; rotation]` in the axes of its camera: m^2, m rad, rad^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCovariance {
    /// In the map around it.
    pub in_map: Mat6,
    /// Relative to the origin of the map or submap.
    pub from_origin: Mat6,
}

/// Records the local covariance of each frame; about 0.1 kB per frame.
#[derive(Clone, Debug, Default)]
pub struct CovarianceLog(BTreeMap<FrameId, [f32; 21]>);

impl CovarianceLog {
    /// Records a frame whose pose was measured.
    pub fn note(&mut self, frame: FrameId, in_map: &Mat6) {
        let mut triangle = [0.0; 21];
        for (to, (r, c)) in triangle.iter_mut().zip(places()) {
            *to = in_map[(r, c)] as f32;
        }
        self.0.insert(frame, triangle);
    }

    /// Covariances of the poses of one map, or `None` if no frame was recorded. A frame that was not recorded, such as
    /// the first, takes the covariance of the next recorded frame, else of the last one.
    #[must_use]
    pub fn of(
        &self,
        poses: &[(TrajectoryEntry, Se3)],
        view: &MapView,
    ) -> Option<Vec<PoseCovariance>> {
        let keyframes = poses.iter().filter_map(|(entry, _)| {
            let triangle = self.0.get(&entry.frame)?;
            Some((entry.pose.keyframe?, whole(triangle)))
        });
        let map = MapCovariance::of(keyframes.collect(), view);
        let covariance = |(entry, pose): &(TrajectoryEntry, Se3)| {
            let (mut before, mut after) =
                (self.0.range(..entry.frame), self.0.range(entry.frame..));
            let in_map = whole(after.next().or_else(|| before.next_back())?.1);
            let reference = entry
                .pose
                .keyframe
                .filter(|id| view.resolve_keyframe(*id).is_some());
            let reference = reference.unwrap_or(entry.pose.reference);
            Some(PoseCovariance {
                in_map,
                from_origin: in_map + map.at(view, reference, pose),
            })
        };
        poses.iter().map(covariance).collect()
    }
}

fn places() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|r| (0..=r).map(move |c| (r, c)))
}

fn whole(triangle: &[f32; 21]) -> Mat6 {
    let mut matrix = Mat6::zeros();
    for (value, (r, c)) in triangle.iter().zip(places()) {
        matrix[(r, c)] = f64::from(*value);
        matrix[(c, r)] = f64::from(*value);
    }
    matrix
}

//! The frames of a running system, with poses that follow the map.

use super::ledger::Ledger;
use crate::report::{Column, FrameColumns};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_map::{KeyframeId, MapView, SubmapId};
use stillpoint_slam::{AnchoredPose, FrameReport, FrameState, Health};

/// Maximum number of shown frames: ten minutes at 30 Hz. In longer runs every second one is dropped, repeatedly.
const MOST_FRAMES: usize = 18_000;
/// Number of remembered map versions, as tracking may use an older one than the newest.
const VERSIONS: usize = 8;
/// Pose changes below this are not sent, m and rad: less than a pixel of the image.
const STILL: f64 = 1e-3;

#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    seconds: f32,
    state: FrameState,
    inliers: u16,
    moving: f32,
    sigma_mm: f32,
    quality: f32,
    time_ms: f32,
    anchored: Option<Anchored>,
    /// The pose as sent: in the shown submap.
    pose: Option<Se3>,
}

#[derive(Clone, Copy, Debug)]
struct Anchored {
    pose: AnchoredPose,
    /// The submap when it was measured.
    submap: SubmapId,
}

/// Summary of a map version, for anchoring frames that used it. It is small, whereas a whole old map would keep all data changed since.
#[derive(Clone, Copy, Debug)]
struct Version {
    number: u64,
    newest: Option<Newest>,
}

/// The newest keyframe of a version, at its pose then.
#[derive(Clone, Copy, Debug)]
struct Newest {
    keyframe: KeyframeId,
    submap: Option<SubmapId>,
    world_from_keyframe: Option<Se3>,
}

impl Version {
    fn of(view: &MapView, newest: Option<KeyframeId>) -> Self {
        Self {
            number: view.version(),
            newest: newest.map(|keyframe| Newest {
                keyframe,
                submap: view.submap_of(keyframe),
                world_from_keyframe: view.world_from_keyframe(keyframe),
            }),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Frames {
    rows: Ledger<Row>,
    first_stamp: Option<f64>,
    /// One frame in `2^halved` is shown.
    halved: u32,
    most: usize,
    count: usize,
    posed: usize,
    versions: VecDeque<Version>,
    view: Option<Arc<MapView>>,
    /// Number of keyframe ids before the run.
    first_id: u32,
    submap: Option<SubmapId>,
}

impl Default for Frames {
    fn default() -> Self {
        Self {
            rows: Ledger::default(),
            first_stamp: None,
            halved: 0,
            most: MOST_FRAMES,
            count: 0,
            posed: 0,
            versions: VecDeque::new(),
            view: None,
            first_id: 0,
            submap: None,
        }
    }
}

impl Frames {
    #[cfg(test)]
    pub(super) fn set_most(&mut self, most: usize) {
        self.most = most;
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    pub(super) fn posed(&self) -> usize {
        self.posed
    }

    pub(super) fn submap(&self) -> Option<SubmapId> {
        self.submap
    }

    pub(super) fn begin(&mut self, view: Arc<MapView>) {
        self.first_id = view.keyframe_bound() as u32;
        self.versions.push_back(Version::of(&view, None));
        self.view = Some(view);
    }

    /// Sets a new map version; `newest` is its new keyframe.
    pub(super) fn set_view(&mut self, view: &Arc<MapView>, newest: Option<KeyframeId>) {
        let before = || Some(self.versions.back()?.newest?.keyframe);
        let version = Version::of(view, newest.or_else(before));
        self.versions.push_back(version);
        self.view = Some(Arc::clone(view));
        if self.versions.len() > VERSIONS {
            self.versions.pop_front();
        }
    }

    /// Adds a frame with its processing time.
    pub(super) fn take(
        &mut self,
        version: u64,
        report: &FrameReport,
        health: &Health,
        time_ms: Option<f64>,
    ) {
        let first = *self.first_stamp.get_or_insert(report.stamp);
        let turn = self.count.is_multiple_of(1 << self.halved);
        let anchored = self.anchor(report);
        self.count += 1;
        self.posed += usize::from(anchored.is_some());
        if let Some(a) = &anchored {
            self.submap = self.submap_now(a).or(self.submap);
        }
        if !turn {
            return;
        }
        let row = Row {
            seconds: (report.stamp - first) as f32,
            state: report.state(),
            inliers: u16::try_from(report.counts.inliers).unwrap_or(u16::MAX),
            moving: report.counts.moving_share() as f32,
            sigma_mm: health.sigma_m().map_or(f32::NAN, |m| (1e3 * m) as f32),
            quality: health.quality.value() as f32,
            time_ms: time_ms.map_or(f32::NAN, |ms| ms as f32),
            pose: anchored.and_then(|a| self.resolve(&a)),
            anchored,
        };
        self.rows.set(version, report.frame.0, row);
        if self.rows.len() > self.most {
            self.halved += 1;
            let mut number = 0_usize;
            self.rows.retain(version, |_, _| {
                number += 1;
                !number.is_multiple_of(2)
            });
        }
    }

    /// Anchors a pose to the newest keyframe of the map that tracking used.
    fn anchor(&self, report: &FrameReport) -> Option<Anchored> {
        let online_world_from_camera = report.world_from_camera?;
        let submap = report.submap?;
        let all = &self.versions;
        let used = |version: &&Version| version.number <= report.map_version;
        let used = all.iter().rev().find(used).or(all.front());
        let reference = used.and_then(|version| {
            let newest = version.newest.filter(|n| n.submap == Some(submap))?;
            Some((newest.keyframe, newest.world_from_keyframe?))
        });
        let own = KeyframeId(report.frame.0.saturating_add(self.first_id));
        // Without a keyframe the pose stays as measured.
        let (reference, world_from_reference) = reference.unwrap_or((own, Se3::identity()));
        Some(Anchored {
            pose: AnchoredPose {
                keyframe: report.is_keyframe.then_some(own),
                reference,
                reference_from_camera: world_from_reference.inverse() * online_world_from_camera,
                online_world_from_camera,
            },
            submap,
        })
    }

    fn submap_now(&self, anchored: &Anchored) -> Option<SubmapId> {
        let view = self.view.as_ref();
        let joined = view.and_then(|v| v.submap_of(anchored.pose.reference));
        joined.or(Some(anchored.submap))
    }

    /// The current pose, if it is in the shown submap.
    fn resolve(&self, anchored: &Anchored) -> Option<Se3> {
        if self.submap_now(anchored) != self.submap {
            return None;
        }
        let pose = &anchored.pose;
        Some(
            self.view
                .as_ref()
                .map_or(pose.online_world_from_camera, |view| {
                    pose.best_world_from_camera(view)
                }),
        )
    }

    /// Updates all poses to the newest map version.
    pub(super) fn follow(&mut self, version: u64) {
        let mut rows = std::mem::take(&mut self.rows);
        rows.revise(version, |_, row| {
            let Some(anchored) = &row.anchored else {
                return false;
            };
            let pose = self.resolve(anchored);
            let moved = match (&row.pose, &pose) {
                (Some(a), Some(b)) => apart(a, b),
                (None, None) => false,
                _ => true,
            };
            if moved {
                row.pose = pose;
            }
            moved
        });
        self.rows = rows;
    }

    pub(super) fn since(&self, version: u64) -> FrameUpdate {
        let changes = self.rows.since(version);
        let mut columns = FrameColumns {
            first_stamp: self.first_stamp.unwrap_or(0.0),
            ..FrameColumns::default()
        };
        for (id, row) in changes.set {
            columns.add(id, row);
        }
        FrameUpdate {
            whole: changes.whole,
            removed: Column(changes.removed),
            columns,
        }
    }
}

fn apart(a: &Se3, b: &Se3) -> bool {
    let turned = (a.rotation.coords - b.rotation.coords).norm();
    (a.translation - b.translation).norm() > STILL || turned > STILL / 2.0
}

/// New frames, and frames with changed poses.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameUpdate {
    /// Whether previously sent frames must be discarded.
    pub whole: bool,
    /// Frames that are no longer shown.
    pub removed: Column<u32>,
    /// The columns available during a run: latency as [`FrameColumns::time_ms`], and the current pose.
    #[serde(flatten)]
    pub columns: FrameColumns,
}

impl FrameColumns {
    fn add(&mut self, id: u32, row: &Row) {
        self.id.0.push(id);
        self.seconds.0.push(row.seconds);
        self.state.0.push(row.state as u8);
        self.inliers.0.push(row.inliers);
        self.moving.0.push(row.moving);
        self.sigma_mm.0.push(row.sigma_mm);
        self.quality.0.push(row.quality);
        self.time_ms.0.push(row.time_ms);
        self.pose.extend(crate::report::numbers(row.pose.as_ref()));
    }
}

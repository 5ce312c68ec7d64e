//! The local map: landmarks expected in the frame.

use super::Tracker;
use super::ego_motion::EgoMotion;
use super::sight::{DepthSight, Sight};
use super::statistics::Sightings;
use crate::association::{Expected, Matches, in_bounds, is_in_range, level_at, match_expected};
use crate::landmark_set::LandmarkSet;
use crate::report::FrameCounts;
use crate::static_filter::Preset;
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_geometry::{Camera, Mat3, Se3, Vec3};
use stillpoint_imaging::{RgbdFrame, workers};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView, ScaleRange, SubmapId};

/// Maximum number of keyframes in the local map: enough for every view of a desk, few enough to project per frame. It
/// is half of the 80 in the code of ORB-SLAM2 (Mur-Artal, Tardos 2017).
const MAX_KEYFRAMES: usize = 40;
/// Factor on the radius (2.5 or 4 px) of the search for local landmarks. The pose before the filter is less accurate
/// than in a static scene. The code of ORB-SLAM2 (Mur-Artal, Tardos 2017), which has both radii, multiplies them by 1
/// for stereo cameras and by 3 for RGB-D.
pub(super) const LOCAL_RADIUS: f32 = 2.0;
/// Maximum distance of keyframes around a pose, m (decision 18).
const AROUND_M: f64 = 1.5;
/// Minimum cosine between a landmark's mean viewing direction and the current one; beyond 60 degrees it looks
/// different. The limit is that of ORB-SLAM2 (Mur-Artal, Tardos 2017), as are the range of distances and the expected
/// level.
const MIN_VIEW_COSINE: f64 = 0.5;

/// A landmark with the data needed for projection.
struct Entry {
    id: LandmarkId,
    position: Vec3,
    direction: Vec3,
    range: ScaleRange,
    descriptor: Descriptor,
}

/// Landmarks of the reference keyframe and its neighbours, cached until these or the view change.
#[derive(Default)]
pub(super) struct LocalMap {
    version: u64,
    keyframes: Vec<KeyframeId>,
    entries: Vec<Entry>,
    /// Scratch set: matched landmarks, or those already in `entries`.
    marked: LandmarkSet,
    memory: Memory,
}

#[derive(Default)]
struct Memory {
    candidates: Vec<KeyframeId>,
    shared: Vec<(u32, KeyframeId)>,
    keyframes: Vec<KeyframeId>,
    visible: Vec<Option<Visible>>,
    missed: Vec<(LandmarkId, Vec3)>,
    sights: Vec<Sight>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct SearchArea<'a> {
    /// Bounds of undistorted pixels, `[min_x, min_y, max_x, max_y]`.
    pub(super) bounds: [f32; 4],
    /// Pixels of the image per pixel of each level.
    pub(super) level_scales: &'a [f32],
    /// Factor on the radius of the windows.
    pub(super) radius_px: f32,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LocalSearch {
    /// Landmarks in the field of view.
    pub(super) visible: u32,
}

impl Tracker {
    /// Matches unmatched features to the local map. Returns the new reference keyframe, all matches, and the landmark
    /// observations.
    pub(super) fn match_map(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        reference: KeyframeId,
        motion: &EgoMotion,
        mut matches: Matches,
        counts: &mut FrameCounts,
    ) -> (KeyframeId, Matches, Sightings) {
        let _span = tracing::info_span!("match").entered();
        let reference = self.map.local.update(&self.map.view, reference, &matches);
        let area = SearchArea {
            bounds: self.front_end.observer.bounds(),
            level_scales: self.front_end.observer.level_scales(),
            radius_px: LOCAL_RADIUS,
        };
        let sight = DepthSight {
            camera: &data.camera,
            image: &frame.depth,
            noise: self.setup.sensor.noise(),
        };
        let use_sight = self.setup.filter.filter.preset != Preset::Off;
        let look = |p: &Vec3| if use_sight { sight.of(p) } else { Sight::Open };
        let pose = &motion.camera_from_world;
        let mut sightings = Sightings::new(&mut self.memory.sightings);
        let search = self
            .map
            .local
            .search(data, pose, &area, &mut matches, look, |id, sight| {
                sightings.expected(id, sight);
            });
        counts.local_visible = search.visible;
        counts.map_matches = matches.count as u32;
        (reference, matches, sightings)
    }
}

impl LocalMap {
    /// Selects the local keyframes from the landmarks in `matches` and gathers their landmarks. Returns the new
    /// reference keyframe, which shares most of them.
    pub(super) fn update(
        &mut self,
        view: &Arc<MapView>,
        reference: KeyframeId,
        matches: &Matches,
    ) -> KeyframeId {
        let Memory {
            candidates,
            shared,
            keyframes,
            ..
        } = &mut self.memory;
        candidates.clear();
        candidates.push(reference);
        if let Some(k) = view.keyframe(reference) {
            candidates.extend(k.covisible.iter().map(|c| c.0));
        }
        self.marked.clear();
        for target in matches.targets.iter().flatten() {
            let Some((id, l)) = target
                .landmark
                .and_then(|id| Some((id, view.landmark(id)?)))
            else {
                continue;
            };
            self.marked.insert(id);
            candidates.push(l.anchor);
        }
        candidates.sort_unstable();
        candidates.dedup();
        shared.clear();
        shared.extend(candidates.iter().filter_map(|id| {
            let k = view.keyframe(*id)?;
            let n = k.matches.iter().flatten();
            let n = n.filter(|l| self.marked.contains(**l)).count();
            Some((n as u32, *id))
        }));
        shared.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(b.1.cmp(&a.1)));
        let best = shared.first().map_or(reference, |s| s.1);
        keyframes.clear();
        let sharing = shared.iter().filter(|s| s.0 > 0);
        keyframes.extend(sharing.take(MAX_KEYFRAMES).map(|s| s.1));
        for i in 0..keyframes.len().min(10) {
            let neighbours = view.keyframe(keyframes[i]).map(|k| &k.covisible[..]);
            for (id, _) in neighbours.unwrap_or_default().iter().take(5) {
                if keyframes.len() < MAX_KEYFRAMES && !keyframes.contains(id) {
                    keyframes.push(*id);
                }
            }
        }
        if keyframes.is_empty() {
            keyframes.push(best);
        }
        keyframes.sort_unstable();
        if self.version != view.version() || self.keyframes != *keyframes {
            std::mem::swap(&mut self.keyframes, keyframes);
            self.gather(view);
        }
        best
    }

    /// Selects the keyframes of a submap with views similar to that of a pose uncertain by some decimetres, and gathers
    /// their landmarks, regardless of matches.
    pub(super) fn update_around(
        &mut self,
        view: &Arc<MapView>,
        submap: Option<SubmapId>,
        camera_from_world: &Se3,
    ) {
        let camera = camera_from_world.inverse();
        let axis = |pose: &Se3| pose.rotation * Vec3::z();
        let of_submap = view.keyframes().filter(|k| Some(k.submap) == submap);
        let mut near: Vec<(f64, KeyframeId)> = of_submap
            .filter_map(|k| {
                let pose = &k.world_from_camera;
                let off = (pose.translation - camera.translation).norm();
                let cosine = axis(pose).dot(&axis(&camera));
                // A rotation by 60 degrees counts as a metre.
                (off < AROUND_M && cosine > 0.5).then_some((off + 2.0 * (1.0 - cosine), k.id))
            })
            .collect();
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(MAX_KEYFRAMES);
        let mut keyframes: Vec<KeyframeId> = near.iter().map(|n| n.1).collect();
        keyframes.sort_unstable();
        if self.version != view.version() || self.keyframes != keyframes {
            self.keyframes = keyframes;
            self.gather(view);
        }
    }

    fn gather(&mut self, view: &MapView) {
        self.marked.clear();
        self.entries.clear();
        for id in &self.keyframes {
            let Some(k) = view.keyframe(*id) else {
                continue;
            };
            for id in k.matches.iter().flatten() {
                if !self.marked.insert(*id) {
                    continue;
                }
                let Some(l) = view.landmark(*id) else {
                    continue;
                };
                let Some(anchor) = view.keyframe(l.anchor) else {
                    continue;
                };
                let pose = &anchor.world_from_camera;
                self.entries.push(Entry {
                    id: *id,
                    position: pose.transform(&l.position_in_anchor),
                    direction: pose.rotation * l.direction_in_anchor,
                    range: l.scale_range,
                    descriptor: l.descriptor,
                });
            }
        }
        self.version = view.version();
    }

    /// Searches unmatched local landmarks around their projections, and reports the visibility of all that are in the
    /// field of view, from the depth image if unmatched.
    pub(super) fn search(
        &mut self,
        data: &KeyframeData,
        camera_from_world: &Se3,
        area: &SearchArea<'_>,
        matches: &mut Matches,
        sight: impl Fn(&Vec3) -> Sight + Sync,
        mut seen: impl FnMut(LandmarkId, Sight),
    ) -> LocalSearch {
        let SearchArea {
            bounds,
            level_scales,
            radius_px,
        } = *area;
        self.marked.clear();
        for target in matches.targets.iter().flatten() {
            if let Some(id) = target.landmark {
                self.marked.insert(id);
                seen(id, Sight::Open);
            }
        }
        let viewpoint = Viewpoint::new(camera_from_world, &data.camera, bounds);
        let scale = f64::from(level_scales.get(1).copied().unwrap_or(1.2));
        let log_scale = libm::log(scale.max(1.01));
        let top_level = level_scales.len().saturating_sub(1) as f64;
        let Memory {
            visible,
            missed,
            sights,
            ..
        } = &mut self.memory;
        visible.clear();
        visible.resize(self.entries.len(), None);
        workers::fill(visible, |i| viewpoint.see(&self.entries[i]));
        let mut result = LocalSearch::default();
        // Sequential, since matches compete for features.
        missed.clear();
        for (e, visible) in self.entries.iter().zip(visible) {
            let Some(visible) = visible else { continue };
            result.visible += 1;
            if self.marked.contains(e.id) {
                continue;
            }
            let level = level_at(&e.range, visible.distance, log_scale, top_level);
            // A landmark seen from its usual direction is well predicted: this angle and the two radii are those of
            // ORB-SLAM2.
            let frontal = visible.cosine > 0.998;
            let expected = Expected {
                landmark: e.id,
                position: e.position,
                descriptor: &e.descriptor,
                pixel: visible.pixel,
                level,
                radius_px: radius_px * if frontal { 2.5 } else { 4.0 },
            };
            if match_expected(data, &expected, level_scales, matches) {
                seen(e.id, Sight::Open);
            } else {
                missed.push((e.id, visible.point));
            }
        }
        sights.clear();
        sights.resize(missed.len(), Sight::Open);
        workers::fill(sights, |i| sight(&missed[i].1));
        for ((id, _), sight) in missed.iter().zip(sights) {
            seen(*id, *sight);
        }
        result
    }
}

struct Viewpoint<'a> {
    rotation: Mat3,
    translation: Vec3,
    centre: Vec3,
    camera: &'a Camera,
    bounds: [f32; 4],
}

/// A landmark in the field of view.
#[derive(Clone, Copy)]
struct Visible {
    /// In camera coordinates, m.
    point: Vec3,
    /// Undistorted px.
    pixel: [f32; 2],
    /// From the camera, m.
    distance: f64,
    /// Cosine of the angle to its mean viewing direction.
    cosine: f64,
}

impl<'a> Viewpoint<'a> {
    fn new(camera_from_world: &Se3, camera: &'a Camera, bounds: [f32; 4]) -> Self {
        Self {
            rotation: camera_from_world.rotation_matrix(),
            translation: camera_from_world.translation,
            centre: camera_from_world.inverse().translation,
            camera,
            bounds,
        }
    }

    /// Projects a landmark; `None` if outside the image, or too near, far or oblique to match.
    fn see(&self, e: &Entry) -> Option<Visible> {
        let point = self.rotation * e.position + self.translation;
        if point.z <= 0.05 {
            return None;
        }
        let px = self.camera.project(&point);
        let pixel = [px.x as f32, px.y as f32];
        if !in_bounds(pixel, self.bounds) {
            return None;
        }
        let ray = e.position - self.centre;
        let distance = ray.norm();
        let cosine = ray.dot(&e.direction) / distance;
        if !is_in_range(&e.range, distance) || cosine < MIN_VIEW_COSINE {
            return None;
        }
        Some(Visible {
            point,
            pixel,
            distance,
            cosine,
        })
    }
}

#[cfg(test)]
mod tests;

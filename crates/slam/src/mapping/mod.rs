//! Mapping: inserts keyframes into the map, and keeps it small and consistent.
//!
//! Owns the map. Takes messages and replies with views.

mod create;
mod cull;
mod fuse;
mod refine;
mod remeasure;

use crate::landmark_set::LandmarkSet;
use crate::map_shift::MapShift;
use crate::messages::{Exposure, MapperMsg, MapperOut, MapperReport, NewKeyframe};
use crate::report::CorrectionReport;
use crate::report::{MappingReport, RejudgeReport, RevokeReport};
use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_map::{Correction, Keyframe, KeyframeId, LandmarkId, Map, MapView};

/// Minimum number of shared landmarks of covisible keyframes, as in ORB-SLAM (Mur-Artal, Montiel, Tardos, T-RO 2015).
const MIN_SHARED: u32 = 15;

/// Settings of mapping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MappingConfig {
    /// Neighbours with which a keyframe triangulates and fuses. Range: 0 to 100.
    pub neighbours: usize,
    /// Maximum number of free keyframes in local bundle adjustment; half as many again are fixed. Range: 1 to 100.
    /// Effort grows with its square.
    pub window: usize,
    /// A keyframe is redundant if three others see this share of its landmarks at the same or a finer scale. Range: 0.5
    /// to 1.
    pub redundant_share: f64,
    /// Maximum number of keyframes in the map; beyond it the most redundant are culled. Range: 0 (no limit), or 50
    /// to 100000. Bounds memory and the time of loop closing in a long run.
    pub max_keyframes: usize,
}

impl Default for MappingConfig {
    fn default() -> Self {
        // As in ORB-SLAM2 for RGB-D cameras (Mur-Artal, Tardos 2017), except for the window of bundle adjustment and
        // the limit on keyframes, which it does not have.
        Self {
            neighbours: 10,
            window: 20,
            redundant_share: 0.9,
            max_keyframes: 0,
        }
    }
}

impl MappingConfig {
    /// The configured work per keyframe.
    #[must_use]
    pub fn effort(&self) -> MappingEffort {
        MappingEffort {
            neighbours: self.neighbours as u32,
            window: self.window as u32,
        }
    }

    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("neighbours", self.neighbours as f64, 0.0, 100.0);
        c.range("window", self.window as f64, 1.0, 100.0);
        c.range("redundant_share", self.redundant_share, 0.5, 1.0);
        if self.max_keyframes != 0 {
            c.range("max_keyframes", self.max_keyframes as f64, 50.0, 1e5);
        }
    }
}

/// Settings of the mapper, made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct MapperSetup {
    /// Settings of mapping.
    pub mapping: MappingConfig,
    /// Minimum number of landmarks shared with other keyframes to refine a pose; the number tracking needs for a pose.
    pub min_held: usize,
    /// Points nearer than this become landmarks from depth alone, m.
    pub close_depth: f64,
    /// Pyramid levels.
    pub levels: usize,
    /// Scale factor between levels.
    pub scale_factor: f32,
}

/// Work per keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingEffort {
    /// Maximum number of neighbours to triangulate and fuse with.
    pub neighbours: u32,
    /// Maximum number of free keyframes in local bundle adjustment; half as many again are fixed.
    pub window: u32,
}

/// Builds the map.
pub struct Mapper {
    config: MappingConfig,
    /// Minimum number of landmarks shared with other keyframes to refine a pose.
    min_held: usize,
    /// Current work per keyframe, at most the configured one.
    effort: MappingEffort,
    /// Points nearer than this become landmarks from depth alone, m.
    close_depth: f64,
    scale_factor: f64,
    map: Map,
    /// Landmarks of recent keyframes that are not confirmed yet.
    young: Vec<LandmarkId>,
    order: Vec<KeyframeId>,
    /// Exposure assumed for each keyframe of this run.
    exposures: BTreeMap<KeyframeId, Exposure>,
    seen: LandmarkSet,
}

impl Mapper {
    /// A mapper with an empty map.
    #[must_use]
    pub fn new(setup: impl Into<MapperSetup>) -> Self {
        let setup = setup.into();
        Self {
            min_held: setup.min_held,
            effort: setup.mapping.effort(),
            config: setup.mapping,
            close_depth: setup.close_depth,
            scale_factor: f64::from(setup.scale_factor),
            map: Map::new(setup.levels, setup.scale_factor),
            young: Vec::new(),
            order: Vec::new(),
            exposures: BTreeMap::new(),
            seen: LandmarkSet::default(),
        }
    }

    /// Starts from an existing map.
    #[must_use]
    pub fn with_map(mut self, map: Map) -> Self {
        self.order = map.view().keyframes().map(|k| k.id).collect();
        self.map = map;
        self
    }

    /// Sets the work per keyframe, limited to the configured one, with at least one free keyframe.
    pub fn set_effort(&mut self, effort: MappingEffort) {
        self.effort = MappingEffort {
            neighbours: effort.neighbours.min(self.config.neighbours as u32),
            window: effort.window.clamp(1, self.config.window as u32),
        };
    }

    /// Maximum number of fixed keyframes in local bundle adjustment: half as many again as free ones. They are cheap
    /// and stabilise the window.
    fn fixed_window(&self) -> usize {
        (3 * self.effort.window as usize).div_ceil(2)
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The map at the end of mapping.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.map
    }

    pub(crate) fn publish(&mut self) -> Arc<MapView> {
        self.map.publish()
    }

    /// Processes a message and replies with the new version of the map.
    pub fn step(&mut self, message: MapperMsg) -> MapperOut {
        match message {
            MapperMsg::Keyframe(keyframe) => self.take_keyframe(&keyframe),
            MapperMsg::Rejudge { keyframe, features } => self.rejudge(keyframe, &features),
            MapperMsg::Revoke { first, last } => self.revoke(first, last),
            MapperMsg::Correct(correction) => self.correct(&correction),
        }
    }

    fn take_keyframe(&mut self, keyframe: &NewKeyframe) -> MapperOut {
        let _span = tracing::info_span!("map").entered();
        let id = keyframe.id;
        let mut report = MappingReport {
            keyframe: id,
            map_version: 0,
            keyframes: 0,
            landmarks: 0,
            created_from_depth: 0,
            triangulated: 0,
            fused: 0,
            culled_landmarks: 0,
            culled_keyframes: 0,
            bundle: Default::default(),
        };
        self.measure_again(keyframe.exposure.readout);
        self.insert(keyframe);
        report.culled_landmarks = self.cull_moved(&keyframe.statistics) + self.cull_landmarks(id);
        report.created_from_depth = self.create_from_depth(id);
        report.triangulated = self.triangulate(id);
        report.fused = self.fuse(id);
        report.bundle = self.refine(id);
        report.culled_keyframes = self.cull_keyframes(id) + self.cull_surplus(id);
        if cfg!(debug_assertions) {
            self.map.check().expect("the map keeps its invariants");
        }
        let view = self.map.publish();
        report.map_version = view.version();
        report.keyframes = view.keyframe_count();
        report.landmarks = view.landmark_count();
        let report = MapperReport::Mapped(report);
        MapperOut { view, report }
    }

    /// Removes landmarks created by features of a keyframe, and their observations of other landmarks.
    fn rejudge(&mut self, id: KeyframeId, features: &[u32]) -> MapperOut {
        let landmarks = self.map.disown(id, features);
        let view = self.map.publish();
        let report = MapperReport::Rejudged(RejudgeReport {
            keyframe: id,
            map_version: view.version(),
            landmarks,
        });
        MapperOut { view, report }
    }

    /// Removes the keyframes with ids from `first` to `last`. The oldest later one becomes the reference of the map.
    fn revoke(&mut self, first: KeyframeId, last: KeyframeId) -> MapperOut {
        let view = self.map.view();
        let submap = view.submap_of(first);
        let later = |k: &&Arc<Keyframe>| k.id > last && Some(k.submap) == submap;
        let onto = view.keyframes().find(later).map(|k| k.id);
        let keyframes = match onto {
            Some(onto) => self.map.revoke(
                |k| k.id >= first && k.id <= last && Some(k.submap) == submap,
                onto,
            ),
            None => 0,
        };
        let map = &self.map;
        self.order
            .retain(|id| *id < first || *id > last || map.view().keyframe(*id).is_some());
        if cfg!(debug_assertions) {
            self.map.check().expect("the map keeps its invariants");
        }
        let view = self.map.publish();
        let report = MapperReport::Revoked(RevokeReport {
            first,
            last,
            map_version: view.version(),
            keyframes,
        });
        MapperOut { view, report }
    }

    /// Applies a correction computed from an older version.
    fn correct(&mut self, correction: &Correction) -> MapperOut {
        let _span = tracing::info_span!("apply").entered();
        let before = self.map.view().clone();
        let applied = self.map.apply(correction);
        for keyframe in &applied.touched {
            self.map.refresh_covisibility(*keyframe, MIN_SHARED);
        }
        if cfg!(debug_assertions) {
            self.map.check().expect("the map keeps its invariants");
        }
        let view = self.map.publish();
        let report = MapperReport::Corrected(CorrectionReport {
            map_version: view.version(),
            base_version: correction.base_version,
            keyframes: applied.poses,
            composed: applied.composed,
            propagated: applied.propagated,
            merged: applied.merged,
            moved: MapShift::between(&before, &view),
        });
        MapperOut { view, report }
    }

    /// Inserts the keyframe with its observations, at its pose relative to the current pose of its reference keyframe.
    fn insert(&mut self, keyframe: &NewKeyframe) {
        let _span = tracing::info_span!("insert").entered();
        for s in &keyframe.statistics {
            let id = self.map.view().resolve_landmark(s.id);
            if let Some(l) = id.and_then(|id| self.map.landmark_mut(id)) {
                l.visible += s.visible;
                l.found += s.found;
                l.static_odds = cull::static_odds(l.static_odds, s);
            }
        }
        let view = self.map.view();
        let world_from_reference = keyframe
            .reference
            .and_then(|r| view.world_from_keyframe(r))
            .unwrap_or(Se3::identity());
        let parent = keyframe.reference.and_then(|r| view.resolve_keyframe(r));
        let pose = (world_from_reference * keyframe.reference_from_camera).normalized();
        let data = keyframe.data.clone();
        self.map.insert_keyframe(keyframe.id, data, pose, parent);
        self.order.push(keyframe.id);
        self.exposures.insert(keyframe.id, keyframe.exposure);
        for (feature, landmark) in keyframe.matches.iter().enumerate() {
            let known = landmark.filter(|_| keyframe.data.mappable[feature]);
            let Some(landmark) = known.and_then(|l| self.map.view().resolve_landmark(l)) else {
                continue;
            };
            if self
                .map
                .add_observation(landmark, keyframe.id, feature as u32)
            {
                self.map.refresh_landmark(landmark);
            }
        }
        self.map.refresh_covisibility(keyframe.id, MIN_SHARED);
    }

    /// The `count` keyframes that share most landmarks with `id`.
    fn neighbours(&self, id: KeyframeId, count: usize) -> Vec<KeyframeId> {
        let Some(k) = self.map.view().keyframe(id) else {
            return Vec::new();
        };
        k.covisible.iter().take(count).map(|c| c.0).collect()
    }
}

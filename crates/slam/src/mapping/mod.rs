//! Mapping: builds keyframes into the map and keeps it lean and consistent.
//!
//! Owns the map. Reads messages, answers with views; does not track.

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

/// Keyframes share at least this many landmarks to count as covisible, a number, as in ORB-SLAM (Mur-Artal, Montiel, Tardos, T-RO 2015).
const MIN_SHARED: u32 = 15;

/// How the map is built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MappingConfig {
    /// Neighbours with which a keyframe triangulates and fuses. Range: 0 to 100.
    pub neighbours: usize,
    /// Free keyframes of local bundle adjustment, at most; half as many again hold it in place. Range: 1 to 100. Effort grows with
    /// its square.
    pub window: usize,
    /// A keyframe is redundant when this share of its landmarks is seen by three others as finely. Range: 0.5 to 1.
    pub redundant_share: f64,
    /// Keyframes in the map, at most: beyond that the most redundant go, whatever they add. Range: 0 (no limit), or 50 to 100000.
    /// Bounds memory and the time of loop closing in a long run.
    pub max_keyframes: usize,
}

impl Default for MappingConfig {
    fn default() -> Self {
        // Those of ORB-SLAM2 for RGB-D cameras (Mur-Artal, Tardos 2017), but for the windows of bundle adjustment and the limit on
        // keyframes, which it does not have.
        Self {
            neighbours: 10,
            window: 20,
            redundant_share: 0.9,
            max_keyframes: 0,
        }
    }
}

impl MappingConfig {
    /// The work per keyframe that is configured.
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

/// What of the configuration concerns the mapper: made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct MapperSetup {
    /// How the map is built.
    pub mapping: MappingConfig,
    /// Landmarks that a keyframe shares with others, at least, for its pose to be refined: as many as make a pose in tracking.
    pub min_held: usize,
    /// Points nearer than this make landmarks from their depth alone, m.
    pub close_depth: f64,
    /// Levels of the features' pyramid.
    pub levels: usize,
    /// Factor between two of them.
    pub scale_factor: f32,
}

/// How much work goes into a keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingEffort {
    /// Neighbours with which it triangulates and fuses, at most.
    pub neighbours: u32,
    /// Free keyframes of its local bundle adjustment, at most; half as many again are fixed.
    pub window: u32,
}

/// Builds the map.
pub struct Mapper {
    config: MappingConfig,
    /// Landmarks that a keyframe shares with others, at least, for its pose to be refined.
    min_held: usize,
    /// Work per keyframe as of now; at most what is configured.
    effort: MappingEffort,
    /// Points nearer than this make landmarks from their depth alone, m.
    close_depth: f64,
    scale_factor: f64,
    map: Map,
    /// Landmarks made at recent keyframes that have not proved themselves yet.
    young: Vec<LandmarkId>,
    /// Keyframes in the order in which they came.
    order: Vec<KeyframeId>,
    /// What those of this run were measured with.
    exposures: BTreeMap<KeyframeId, Exposure>,
    /// Landmarks that a keyframe sees, where another's are searched in it.
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

    /// The mapper with a map that is there already.
    #[must_use]
    pub fn with_map(mut self, map: Map) -> Self {
        self.order = map.view().keyframes().map(|k| k.id).collect();
        self.map = map;
        self
    }

    /// From now on so much work goes into a keyframe: what is configured at most, and one keyframe of adjustment at least.
    pub fn set_effort(&mut self, effort: MappingEffort) {
        self.effort = MappingEffort {
            neighbours: effort.neighbours.min(self.config.neighbours as u32),
            window: effort.window.clamp(1, self.config.window as u32),
        };
    }

    /// Fixed keyframes of local bundle adjustment, at most: half as many again as free ones. They cost little, and hold the window.
    fn fixed_window(&self) -> usize {
        (3 * self.effort.window as usize).div_ceil(2)
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The map, when mapping is over.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.map
    }

    /// Publishes the map as it is.
    pub(crate) fn publish(&mut self) -> Arc<MapView> {
        self.map.publish()
    }

    /// Takes a message and answers with the new version of the map.
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

    /// Takes out the landmarks that features of a keyframe made, and the observations that they added to others.
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

    /// Takes back the keyframes from one to another. The oldest after them holds the map in place from now on.
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

    /// Brings a correction of an older version into the map as it is now.
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

    /// Adds the keyframe with its observations; its pose follows its reference keyframe, whatever became of it since.
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

    /// The keyframes that share most landmarks with `id`, at most `count`.
    fn neighbours(&self, id: KeyframeId, count: usize) -> Vec<KeyframeId> {
        let Some(k) = self.map.view().keyframe(id) else {
            return Vec::new();
        };
        k.covisible.iter().take(count).map(|c| c.0).collect()
    }
}

//! The shown part of the map.

use super::ledger::Ledger;
use crate::report::{Column, numbers, triple};
use serde::{Deserialize, Serialize};
use stillpoint_map::{KeyframeId, LandmarkId, MapView, SubmapId};

/// Maximum number of shown landmarks, of 20 bytes each. Beyond it, those with ids divisible by a power of two are shown.
const MOST_LANDMARKS: usize = 60_000;
/// Position changes below this are not sent, m: less than a pixel of the image.
const STILL: f32 = 2e-3;
/// Change of a landmark's probability of being static that is sent, in 255ths.
const ALIKE: u8 = 12;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Landmark {
    position: [f32; 3],
    frame: u32,
    stands_still: u8,
}

#[derive(Clone, Debug)]
pub(super) struct MapScene {
    landmarks: Ledger<Landmark>,
    keyframes: Ledger<[f32; 7]>,
    loops: Vec<u32>,
    loops_changed: u64,
    count: usize,
    most: usize,
}

impl Default for MapScene {
    fn default() -> Self {
        Self {
            landmarks: Ledger::default(),
            keyframes: Ledger::default(),
            loops: Vec::new(),
            loops_changed: 0,
            count: 0,
            most: MOST_LANDMARKS,
        }
    }
}

impl MapScene {
    #[cfg(test)]
    pub(super) fn set_most(&mut self, most: usize) {
        self.most = most;
    }

    /// Updates from a submap in a map version. `exactly`: includes changes too small to see.
    pub(super) fn follow(
        &mut self,
        version: u64,
        view: &MapView,
        submap: Option<SubmapId>,
        exactly: bool,
    ) {
        let part = Part { view, submap };
        self.follow_landmarks(version, &part, exactly);
        self.follow_keyframes(version, &part, exactly);
        self.follow_loops(version, &part);
    }

    fn follow_landmarks(&mut self, version: u64, part: &Part<'_>, exactly: bool) {
        let count = |one_in: u32| {
            let all = part.landmarks();
            all.filter(|(id, _)| id.number().is_multiple_of(one_in))
                .count()
        };
        self.count = count(1);
        // Ids divisible by it are spread over the whole map, and the selection stays until the map has doubled.
        let mut one_in = 1_u32;
        while count(one_in) > self.most {
            one_in *= 2;
        }
        self.landmarks.retain(version, |number, _| {
            let landmark = part.view.landmark(LandmarkId::new(number));
            number.is_multiple_of(one_in) && landmark.is_some_and(|l| part.has(l.anchor))
        });
        for (id, landmark) in part.landmarks() {
            if !id.number().is_multiple_of(one_in) {
                continue;
            }
            let odds = f64::from(landmark.static_odds);
            let now = Landmark {
                position: triple(part.view.landmark_position(id).as_ref()),
                frame: landmark.created_at.0,
                stands_still: (255.0 / (1.0 + (-odds).exp())).round() as u8,
            };
            let known = self.landmarks.get(id.number());
            if known.is_none_or(|k| k.differs(&now) || (exactly && *k != now)) {
                self.landmarks.set(version, id.number(), now);
            }
        }
    }

    fn follow_keyframes(&mut self, version: u64, part: &Part<'_>, exactly: bool) {
        self.keyframes.retain(version, |number, _| {
            let id = KeyframeId(number);
            part.view.keyframe(id).is_some() && part.has(id)
        });
        for keyframe in part.view.keyframes().filter(|k| part.has(k.id)) {
            let pose = numbers(Some(&keyframe.world_from_camera));
            let known = self.keyframes.get(keyframe.id.0);
            if known.is_none_or(|k| far(k, &pose) || (exactly && *k != pose)) {
                self.keyframes.set(version, keyframe.id.0, pose);
            }
        }
    }

    /// Loops whose keyframes exist, or whose anchors do.
    fn follow_loops(&mut self, version: u64, part: &Part<'_>) {
        let ends = part.view.loops().filter_map(|edge| {
            let [a, b] = [edge.old, edge.new].map(|id| part.view.resolve_keyframe(id));
            Some([a?, b?])
        });
        let ends = ends.filter(|e| e.iter().all(|id| part.has(*id)));
        let loops: Vec<u32> = ends.flatten().map(|id| id.0).collect();
        if loops != self.loops {
            self.loops = loops;
            self.loops_changed = version;
        }
    }

    pub(super) fn since(&self, version: u64) -> MapUpdate {
        let (landmarks, keyframes) = (self.landmarks.since(version), self.keyframes.since(version));
        let mut update = MapUpdate {
            whole: landmarks.whole,
            count: self.count as u32,
            removed: Column(landmarks.removed),
            keyframes: KeyframeUpdate {
                whole: keyframes.whole,
                removed: Column(keyframes.removed),
                ..KeyframeUpdate::default()
            },
            loops: (self.loops_changed > version || version == 0)
                .then(|| Column(self.loops.clone())),
            ..MapUpdate::default()
        };
        for (id, landmark) in landmarks.set {
            update.id.0.push(id);
            update.position.extend(landmark.position);
            update.frame.0.push(landmark.frame);
            update.stands_still.0.push(landmark.stands_still);
        }
        for (id, pose) in keyframes.set {
            update.keyframes.id.0.push(id);
            update.keyframes.pose.extend(*pose);
        }
        update
    }
}

/// The shown part of a map version: a submap, or everything while no submap is known.
struct Part<'a> {
    view: &'a MapView,
    submap: Option<SubmapId>,
}

impl Part<'_> {
    fn has(&self, id: KeyframeId) -> bool {
        self.submap.is_none() || self.view.submap_of(id) == self.submap
    }

    fn landmarks(&self) -> impl Iterator<Item = (LandmarkId, &stillpoint_map::Landmark)> {
        self.view.landmarks().filter(|(_, l)| self.has(l.anchor))
    }
}

fn far(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > STILL)
}

impl Landmark {
    fn differs(&self, other: &Self) -> bool {
        far(&self.position, &other.position)
            || self.stands_still.abs_diff(other.stands_still) >= ALIKE
    }
}

/// New or changed landmarks and keyframes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapUpdate {
    /// Whether previously sent landmarks must be discarded.
    pub whole: bool,
    /// Number of landmarks in the map, possibly more than shown.
    pub count: u32,
    /// Removed landmarks; to be applied first.
    pub removed: Column<u32>,
    /// Landmark ids.
    pub id: Column<u32>,
    /// Positions: three numbers each, m.
    pub position: Column<f32>,
    /// Frame in which each was created.
    pub frame: Column<u32>,
    /// Probability of being static, in 255ths.
    pub stands_still: Column<u8>,
    /// Keyframes.
    pub keyframes: KeyframeUpdate,
    /// All pairs of keyframes connected by loops, if changed.
    pub loops: Option<Column<u32>>,
}

/// New or changed keyframes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeUpdate {
    /// Whether previously sent keyframes must be discarded.
    pub whole: bool,
    /// Removed keyframes; to be applied first.
    pub removed: Column<u32>,
    /// Keyframe ids.
    pub id: Column<u32>,
    /// Poses: seven numbers each, position and quaternion (x, y, z, w).
    pub pose: Column<f32>,
}

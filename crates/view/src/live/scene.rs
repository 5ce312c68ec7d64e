//! The map of a run that goes on, as far as it is shown.

use super::ledger::Ledger;
use crate::report::{Column, numbers, triple};
use serde::{Deserialize, Serialize};
use stillpoint_map::{KeyframeId, LandmarkId, MapView, SubmapId};

/// Landmarks that are shown, at most; 20 bytes each. Of more, those are shown whose number is a multiple of a power of two.
const MOST_LANDMARKS: usize = 60_000;
/// What moved by less is not told again, m: less than a pixel of the picture.
const STILL: f32 = 2e-3;
/// By how much the probability that a landmark stands still changes until that is told, in 255ths.
const ALIKE: u8 = 12;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Landmark {
    position: [f32; 3],
    frame: u32,
    stands_still: u8,
}

/// What is shown of the map.
#[derive(Clone, Debug)]
pub(super) struct MapScene {
    landmarks: Ledger<Landmark>,
    keyframes: Ledger<[f32; 7]>,
    loops: Vec<u32>,
    /// The version at which loops changed.
    loops_changed: u64,
    /// Landmarks of the map.
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

    /// Takes what a version of the map says of a submap. `exactly`: also what moved by less than is seen.
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
        // Numbers that are multiples of it are spread over the whole map, and stay the same until there are twice as many.
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

    /// Loops whose keyframes are there, or what carries their tombstones.
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

    /// What changed since a version.
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

/// What is shown of a version of the map: a submap, or all of it where none is known yet.
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

/// Whether one sees a difference between positions or poses.
fn far(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).any(|(a, b)| (a - b).abs() > STILL)
}

impl Landmark {
    /// Whether one sees a difference.
    fn differs(&self, other: &Self) -> bool {
        far(&self.position, &other.position)
            || self.stands_still.abs_diff(other.stands_still) >= ALIKE
    }
}

/// Landmarks and keyframes that are new or other than before.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapUpdate {
    /// All landmarks that were told before are void.
    pub whole: bool,
    /// Landmarks of the map: those that are shown may be fewer.
    pub count: u32,
    /// Numbers of landmarks that are there no more; to be taken out first.
    pub removed: Column<u32>,
    /// Numbers of landmarks.
    pub id: Column<u32>,
    /// Positions: three numbers each, m.
    pub position: Column<f32>,
    /// Number of the frame that each was made at.
    pub frame: Column<u32>,
    /// Probability that it stands still, in 255ths.
    pub stands_still: Column<u8>,
    /// Keyframes.
    pub keyframes: KeyframeUpdate,
    /// All pairs of keyframes that loops tie together, where they changed.
    pub loops: Option<Column<u32>>,
}

/// Keyframes that are new or other than before.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeUpdate {
    /// All keyframes that were told before are void.
    pub whole: bool,
    /// Numbers of keyframes that are there no more; to be taken out first.
    pub removed: Column<u32>,
    /// Numbers of keyframes.
    pub id: Column<u32>,
    /// Poses: seven numbers each, position and quaternion (x, y, z, w).
    pub pose: Column<f32>,
}

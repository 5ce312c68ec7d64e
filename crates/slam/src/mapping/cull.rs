//! Culling of landmarks and keyframes. Rules follow ORB-SLAM2 (Mur-Artal, Tardos 2017), except for moving landmarks and
//! the limit on keyframes.

use super::Mapper;
use crate::messages::LandmarkStatistic;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use stillpoint_map::KeyframeId;

/// Log odds of a landmark being static, added per frame of 30 Hz in which it was found: 9 per second. Chosen: a third
/// of `GONE`, since objects that moved and stopped are found as well.
const FOUND: f32 = 0.3;
/// Log odds subtracted per frame of 30 Hz in which the camera saw through its place: 30 per second. Its position is
/// known to some pixels, and thin objects have holes in depth: no single frame is proof. Chosen: three frames make odds
/// of 1 in 20 (`MIN_ODDS`).
const GONE: f32 = 1.0;
/// Upper bound of the log odds: years of evidence must be overturned within a third of a second, and nine frames of
/// `GONE` lead from here to `MIN_ODDS`.
const MAX_ODDS: f32 = 6.0;
/// Log odds of being static below which a landmark is culled: 1 in 20, the usual 5 %, chosen.
const MIN_ODDS: f32 = -3.0;

/// Minimum share of frames with a landmark in view in which it must be found, as in ORB-SLAM (Mur-Artal, Montiel,
/// Tardos, T-RO 2015).
const MIN_FOUND_SHARE: f64 = 0.25;

/// Maximum number of surplus keyframes culled per new keyframe: a loaded map may have hundreds too many, and no frame
/// should wait for that. Chosen: hundreds are gone after some ten keyframes.
const MAX_SURPLUS: usize = 20;

/// A candidate for culling when there are too many keyframes, ordered by redundancy; the oldest is the greatest of
/// equals.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surplus {
    /// Share of its landmarks seen by three others, 0 to 1.
    share: f64,
    keyframe: KeyframeId,
}

impl Eq for Surplus {}

impl Ord for Surplus {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_share = self.share.total_cmp(&other.share);
        by_share.then(other.keyframe.cmp(&self.keyframe))
    }
}

impl PartialOrd for Surplus {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Bayes update in log odds with the observations of a landmark since the last keyframe.
pub(super) fn static_odds(before: f32, seen: &LandmarkStatistic) -> f32 {
    let after = before + FOUND * seen.found_worth - GONE * seen.gone_worth;
    after.clamp(2.0 * MIN_ODDS, MAX_ODDS)
}

impl Mapper {
    /// Culls landmarks that are no longer static.
    pub(super) fn cull_moved(&mut self, seen: &[LandmarkStatistic]) -> u32 {
        let mut culled = 0;
        for s in seen.iter().filter(|s| s.gone > 0) {
            let Some(id) = self.map.view().resolve_landmark(s.id) else {
                continue;
            };
            let moved = |id| Some(self.map.view().landmark(id)?.static_odds < MIN_ODDS);
            if moved(id) == Some(true) {
                self.map.cull_landmark(id);
                culled += 1;
            }
        }
        culled
    }

    /// Culls young landmarks that are rarely found or not confirmed by other keyframes in time. Landmarks older than
    /// three keyframes are kept.
    pub(super) fn cull_landmarks(&mut self, now: KeyframeId) -> u32 {
        let _span = tracing::info_span!("cull").entered();
        // Counted in keyframes: ids are frame numbers, with gaps.
        let age_of = |created: KeyframeId| {
            self.order.partition_point(|k| *k <= now)
                - self.order.partition_point(|k| *k <= created)
        };
        let mut doomed = Vec::new();
        let map = &self.map;
        self.young.retain(|id| {
            let Some(l) = map.view().landmark(*id) else {
                return false;
            };
            let age = age_of(l.created_at);
            // A point is determined by one observation with depth or two without; one more is required as confirmation.
            let needed = if l.depth_observers > 0 { 2 } else { 3 };
            let rare = f64::from(l.found) < MIN_FOUND_SHARE * f64::from(l.visible);
            if rare || (age >= 2 && l.observers < needed) {
                doomed.push(*id);
                return false;
            }
            age < 3
        });
        for id in &doomed {
            self.map.cull_landmark(*id);
        }
        doomed.len() as u32
    }

    /// Culls covisible keyframes whose close landmarks are nearly all seen by three others at the same or a finer
    /// scale.
    pub(super) fn cull_keyframes(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("cull").entered();
        let mut culled = 0;
        // The first keyframe fixes the map's reference frame.
        let first = self.order.first().copied();
        for other in self.neighbours(id, usize::MAX) {
            if Some(other) == first || !self.is_redundant(other) {
                continue;
            }
            if self.map.cull_keyframe(other) {
                culled += 1;
            }
        }
        culled
    }

    /// Culls some of the most redundant keyframes while there are more than allowed. Keeps the first one, which fixes
    /// the reference frame, and those around the newest.
    pub(super) fn cull_surplus(&mut self, now: KeyframeId) -> u32 {
        let count = self.map.view().keyframe_count();
        let most = self.config.max_keyframes;
        if most == 0 || count <= most {
            return 0;
        }
        let _span = tracing::info_span!("cull").entered();
        let mut stay = self.neighbours(now, self.config.window);
        stay.push(now);
        stay.extend(self.order.first());
        let candidates = self.map.view().keyframes().map(|k| k.id);
        let mut ranked: BinaryHeap<Surplus> = candidates
            .filter(|id| !stay.contains(id))
            .map(|id| self.surplus(id))
            .collect();
        let wanted = (count - most).min(MAX_SURPLUS) as u32;
        let mut culled = 0;
        while culled < wanted {
            let Some(best) = ranked.pop() else { break };
            // Recomputed, as culling others reduces redundancy.
            let again = self.surplus(best.keyframe);
            if again < best && ranked.peek().is_some_and(|next| again < *next) {
                ranked.push(again);
                continue;
            }
            culled += u32::from(self.map.cull_keyframe(best.keyframe));
        }
        culled
    }

    /// Redundancy of a keyframe, by its close landmarks, or by all if none is close.
    fn surplus(&self, keyframe: KeyframeId) -> Surplus {
        let (mut redundant, mut total) = self.redundancy(keyframe, self.close_depth);
        if total == 0 {
            (redundant, total) = self.redundancy(keyframe, f64::INFINITY);
        }
        Surplus {
            // A keyframe without landmarks is fully redundant.
            share: f64::from(redundant + 1) / f64::from(total + 1),
            keyframe,
        }
    }

    fn is_redundant(&self, id: KeyframeId) -> bool {
        let (redundant, total) = self.redundancy(id, self.close_depth);
        total > 0 && f64::from(redundant) > self.config.redundant_share * f64::from(total)
    }

    /// Of a keyframe's landmarks closer than `far` (m), the number that three others see at the same or a finer scale,
    /// and the total. Those without depth count only if `far` is infinite.
    fn redundancy(&self, id: KeyframeId, far: f64) -> (u32, u32) {
        let view = self.map.view();
        let Some(k) = view.keyframe(id) else {
            return (0, 0);
        };
        let (mut total, mut redundant) = (0u32, 0u32);
        for (feature, landmark) in k.matches.iter().enumerate() {
            let Some(landmark) = landmark else { continue };
            if k.data.depth(feature).unwrap_or(f64::MAX) >= far {
                continue;
            }
            total += 1;
            let level = k.data.keypoints[feature].level;
            let finer = self
                .map
                .observations(*landmark)
                .iter()
                .filter(|(other, f)| {
                    *other != id
                        && view
                            .keyframe(*other)
                            .is_some_and(|o| o.data.keypoints[*f as usize].level <= level + 1)
                })
                .count();
            redundant += u32::from(finer >= 3);
        }
        (redundant, total)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.

    mod young;

    use super::*;
    use crate::config::Config;
    use crate::messages::{Exposure, MapperMsg, NewKeyframe};
    use std::sync::Arc;
    use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
    use stillpoint_geometry::{Camera, Se3};
    use stillpoint_map::{KeyframeData, LandmarkId, NewLandmark};

    /// Features of each keyframe, each matched to a landmark.
    const FEATURES: usize = 20;

    fn data(depth: f32) -> Arc<KeyframeData> {
        let camera = Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]);
        let positions: Vec<[f32; 2]> = (0..FEATURES).map(|i| [30.0 * i as f32, 50.0]).collect();
        let keypoint = |p: &[f32; 2]| Keypoint {
            x: p[0],
            y: p[1],
            level: 0,
            angle: 0.0,
            response: 1.0,
            edge: Edge::default(),
        };
        Arc::new(KeyframeData {
            stamp: 0.0,
            camera,
            keypoints: positions.iter().map(keypoint).collect(),
            sigma_px: vec![1.0; FEATURES],
            depths: vec![depth; FEATURES],
            depth_sigmas: vec![0.01; FEATURES],
            descriptors: Arc::new(vec![Descriptor([7; 4]); FEATURES]),
            mappable: vec![true; FEATURES],
            grid: FeatureGrid::build(
                &positions,
                &[0; FEATURES],
                KeyframeData::grid_bounds(&camera),
            ),
            positions,
        })
    }

    /// A mapper that visited places one after another, each with this number of keyframes, which all see the same
    /// landmarks at this depth.
    fn mapper(places: &[(u32, f32)], max_keyframes: usize) -> Mapper {
        let mut config = Config::default();
        config.mapping.max_keyframes = max_keyframes;
        config.mapping.window = 1;
        let mut mapper = Mapper::new(&config);
        let mut next = 0;
        for (keyframes, depth) in places {
            let data = data(*depth);
            let ids: Vec<KeyframeId> = (next..next + keyframes).map(KeyframeId).collect();
            next += keyframes;
            for id in &ids {
                let parent = id.0.checked_sub(1).map(KeyframeId);
                let pose = Se3::identity();
                mapper
                    .map
                    .insert_keyframe(*id, Arc::clone(&data), pose, parent);
                mapper.order.push(*id);
            }
            for feature in 0..FEATURES {
                let new = NewLandmark {
                    position: data
                        .camera
                        .backproject(data.position(feature), f64::from(*depth)),
                    observation: (ids[0], feature as u32),
                };
                let landmark = mapper.map.insert_landmark(&new).unwrap();
                for id in &ids[1..] {
                    mapper.map.add_observation(landmark, *id, feature as u32);
                }
            }
            for id in ids {
                mapper.map.refresh_covisibility(id, 15);
            }
        }
        mapper
    }

    /// Adds a keyframe that found the first landmark in `found` frames and saw through it in `gone`; returns its log
    /// odds.
    fn tell(mapper: &mut Mapper, found: u32, gone: u32) -> Option<f32> {
        let last = *mapper.order.last().unwrap();
        let id = LandmarkId::new(0);
        let statistics = vec![LandmarkStatistic {
            id,
            visible: found + gone,
            found,
            gone,
            found_worth: found as f32,
            gone_worth: gone as f32,
        }];
        let view = mapper.map.view();
        let matches = view.keyframe(last).unwrap().matches.clone();
        mapper.step(MapperMsg::Keyframe(Box::new(NewKeyframe {
            id: KeyframeId(last.0 + 1),
            data: data(1.0),
            reference: Some(last),
            reference_from_camera: Se3::identity(),
            matches,
            statistics,
            exposure: Exposure::default(),
        })));
        Some(mapper.map.view().landmark(id)?.static_odds)
    }

    #[test]
    fn landmark_seen_through_is_culled() {
        let mut mapper = mapper(&[(4, 1.0)], 0);
        // Equation 37, with its clamp.
        let expected = |odds: f32| move |found: Option<f32>| (found.unwrap() - odds).abs() < 1e-6;
        assert!(expected(1.5)(tell(&mut mapper, 5, 0)));
        assert!(expected(0.5)(tell(&mut mapper, 0, 1)));
        assert!(expected(MAX_ODDS)(tell(&mut mapper, 1000, 0)));
        // A landmark at the upper bound takes nine frames to be culled.
        assert!(expected(-2.5)(tell(&mut mapper, 5, 10)));
        assert_eq!(tell(&mut mapper, 0, 1), None);
        let stays = |i: usize| {
            mapper
                .map
                .view()
                .landmark(LandmarkId::new(i as u32))
                .is_some()
        };
        assert!((1..FEATURES).all(stays));
    }

    fn live(mapper: &Mapper, ids: std::ops::Range<u32>) -> usize {
        let keyframes = mapper.map.view().keyframes();
        keyframes.filter(|k| ids.contains(&k.id.0)).count()
    }

    /// All keyframes of the first place look as redundant as those of the second, until the first of them are gone.
    #[test]
    fn surplus_culling_keeps_keyframes_at_every_place() {
        // The camera is at the last place. Landmarks of the third are too far to be close.
        let mut mapper = mapper(&[(30, 1.0), (30, 1.0), (30, 1e3), (1, 1.0)], 20);
        let now = KeyframeId(90);
        let mut steps = 0;
        while mapper.map.view().keyframe_count() > 20 {
            let before = mapper.map.view().keyframe_count();
            let culled = mapper.cull_surplus(now) as usize;
            assert_eq!(culled, (before - 20).min(MAX_SURPLUS));
            assert_eq!(mapper.map.check(), Ok(()));
            steps += 1;
        }
        assert_eq!(steps, 4);
        assert_eq!(mapper.cull_surplus(now), 0);
        for place in [0..30, 30..60, 60..90] {
            let left = live(&mapper, place.clone());
            assert!(left >= 3, "{left} keyframes are left of {place:?}");
        }
        assert_eq!((live(&mapper, 0..1), live(&mapper, 90..91)), (1, 1));
    }

    #[test]
    fn no_keyframe_is_culled_without_or_below_the_limit() {
        for limit in [0, 31] {
            let mut mapper = mapper(&[(30, 1.0), (1, 1.0)], limit);
            assert_eq!(mapper.cull_surplus(KeyframeId(30)), 0);
            assert_eq!(live(&mapper, 0..31), 31);
        }
    }
}

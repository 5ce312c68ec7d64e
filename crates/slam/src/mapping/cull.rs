//! What the map does without: landmarks that did not prove themselves, keyframes that add nothing.

use super::Mapper;
use crate::messages::LandmarkStatistic;
use stillpoint_map::KeyframeId;

/// Log odds that one frame adds to a landmark's being static when it was found where it should be. Little: things that
/// moved and stopped are found as well.
const FOUND: f32 = 0.3;
/// Log odds that one frame takes when the camera saw through its place. The place is known to some pixels, and thin things
/// have holes in depth: no single frame is proof.
const GONE: f32 = 1.0;
/// Years of evidence must be overturned within ten frames.
const MAX_ODDS: f32 = 6.0;
/// A landmark less likely to be static than this leaves the map: 1 in 20.
const MIN_ODDS: f32 = -3.0;

/// Bayes' rule in log odds for what was seen of a landmark since the last keyframe.
pub(super) fn static_odds(before: f32, seen: &LandmarkStatistic) -> f32 {
    let after = before + FOUND * seen.found as f32 - GONE * seen.gone as f32;
    after.clamp(2.0 * MIN_ODDS, MAX_ODDS)
}

impl Mapper {
    /// Takes out landmarks that have stopped being static.
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

    /// Culls young landmarks that are rarely found, or that no second keyframe confirmed in time. Landmarks older than
    /// three keyframes have proved themselves.
    pub(super) fn cull_landmarks(&mut self, now: KeyframeId) -> u32 {
        let _span = tracing::info_span!("cull").entered();
        let age_of = |created: KeyframeId| {
            self.order.partition_point(|k| *k <= now)
                - self.order.partition_point(|k| *k <= created)
        };
        let mut doomed = Vec::new();
        let (map, min_found) = (&self.map, self.config.min_found_share);
        self.young.retain(|id| {
            let Some(l) = map.view().landmark(*id) else {
                return false;
            };
            let age = age_of(l.created_at);
            let needed = if l.depth_observers > 0 { 2 } else { 3 };
            let rare = f64::from(l.found) < min_found * f64::from(l.visible);
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

    /// Culls covisible keyframes whose close landmarks are nearly all seen by three others at the same or a finer scale.
    pub(super) fn cull_keyframes(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("cull").entered();
        let mut culled = 0;
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

    /// Culls the most redundant keyframes until there are no more than allowed. Those around the newest one are in use, and the
    /// first one holds the map in place: they stay.
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
        let view = self.map.view();
        let candidates = view.keyframes().map(|k| k.id);
        let mut ranked: Vec<(f64, KeyframeId)> = candidates
            .filter(|id| !stay.contains(id))
            .map(|id| {
                let (redundant, total) = self.redundancy(id);
                // One that sees nothing close is missed by none.
                (f64::from(redundant + 1) / f64::from(total + 1), id)
            })
            .collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut culled = 0;
        for (_, id) in ranked {
            if count - culled as usize <= most {
                break;
            }
            culled += u32::from(self.map.cull_keyframe(id));
        }
        culled
    }

    fn is_redundant(&self, id: KeyframeId) -> bool {
        let (redundant, total) = self.redundancy(id);
        total > 0 && f64::from(redundant) > self.config.redundant_share * f64::from(total)
    }

    /// Of a keyframe's close landmarks, how many three others see as finely, and how many there are.
    fn redundancy(&self, id: KeyframeId) -> (u32, u32) {
        let view = self.map.view();
        let Some(k) = view.keyframe(id) else {
            return (0, 0);
        };
        let (mut total, mut redundant) = (0u32, 0u32);
        for (feature, landmark) in k.matches.iter().enumerate() {
            let Some(landmark) = landmark else { continue };
            let close = k
                .data
                .depth(feature)
                .is_some_and(|z| z < self.sensor.close_depth);
            if !close {
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

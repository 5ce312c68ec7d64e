//! What the map does without: landmarks that did not prove themselves, keyframes that add nothing.

use super::Mapper;
use stillpoint_map::KeyframeId;

impl Mapper {
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

    fn is_redundant(&self, id: KeyframeId) -> bool {
        let view = self.map.view();
        let Some(k) = view.keyframe(id) else {
            return false;
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
        total > 0 && f64::from(redundant) > self.config.redundant_share * f64::from(total)
    }
}

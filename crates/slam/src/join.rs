//! Merging of two maps.

use crate::config::Config;
use crate::looping::LoopCloser;
use crate::mapping::Mapper;
use crate::messages::{LoopCloserMsg, MapperMsg};
use crate::report::LoopReport;
use crate::shutter::TYPICAL_DEPTH;
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_map::{AppendError, KeyframeId, Map, MapView, SubmapId};

/// Result of merging two maps.
#[derive(Debug)]
pub struct JoinedMaps {
    /// Both maps, the second under new ids. They share the reference frame of the first if places were recognised;
    /// otherwise they remain separate submaps.
    pub map: Map,
    /// Loop candidates between the second map and the first, with outcomes.
    pub reports: Vec<LoopReport>,
    /// Number of submaps before and after.
    pub submaps: [usize; 2],
    /// Offset added to the keyframe ids of the second map; ids of the first are below it.
    pub added: u32,
    /// Pose of each map's oldest submap in the joined map; `None` if it remained a separate submap.
    pub placed: [Option<Placed>; 2],
}

/// How a map was placed in another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Best-fitting rigid motion of its keyframes.
    pub joined_from_map: Se3,
    /// Largest deviation of a keyframe from that motion, m, since keyframes are adjusted individually. Rotations count
    /// as their displacement at a depth of 2 m.
    pub bent: f64,
}

impl Placed {
    /// From the keyframes of a map before and after, with ids raised by `added`.
    fn of(before: &MapView, after: &MapView, added: u32) -> Option<Self> {
        let world = after.keyframes().next()?.submap;
        let own = before.keyframes().next()?.submap;
        let pairs = before.keyframes().filter(|k| k.submap == own);
        let pairs = pairs.filter_map(|k| {
            let now = after.keyframe(KeyframeId(k.id.0 + added))?;
            (now.submap == world).then_some((k.world_from_camera, now.world_from_camera))
        });
        Self::fitting(&pairs.collect::<Vec<_>>())
    }

    fn fitting(pairs: &[(Se3, Se3)]) -> Option<Self> {
        let (first, count) = (pairs.first()?, pairs.len() as f64);
        let turn = |p: &(Se3, Se3)| p.1.rotation * p.0.rotation.inverse();
        let about = turn(first);
        let apart = |p: &(Se3, Se3)| so3::log(&(about.inverse() * turn(p)));
        let mean = pairs.iter().map(apart).sum::<Vec3>() / count;
        let rotation = about * so3::exp(&mean);
        let shift = |p: &(Se3, Se3)| p.1.translation - rotation * p.0.translation;
        let translation = pairs.iter().map(shift).sum::<Vec3>() / count;
        let bent = pairs.iter().map(|p| {
            let turned = so3::angle(&(rotation.inverse() * turn(p)));
            (shift(p) - translation).norm() + TYPICAL_DEPTH * turned
        });
        Some(Self {
            joined_from_map: Se3::new(rotation, translation),
            bent: bent.fold(0.0, f64::max),
        })
    }
}

impl JoinedMaps {
    /// World of the second map in that of the first, as the first was before. Applies to data registered with either
    /// map.
    #[must_use]
    pub fn first_from_second(&self) -> Option<Se3> {
        let [first, second] = self.placed;
        Some(first?.joined_from_map.inverse() * second?.joined_from_map)
    }

    /// Number of submaps with keyframes of both maps; 0 if the maps are not connected.
    #[must_use]
    pub fn shared_submaps(&self) -> usize {
        let mut of: BTreeMap<SubmapId, [bool; 2]> = BTreeMap::new();
        for k in self.map.view().keyframes() {
            of.entry(k.submap).or_default()[usize::from(k.id.0 >= self.added)] = true;
        }
        of.values().filter(|both| **both == [true; 2]).count()
    }
}

/// Merges two maps where places of the second are recognised in the first, keyframe by keyframe, as if the second map's
/// camera revisited the first.
///
/// # Errors
/// [`AppendError`] if their features cannot be compared.
pub fn join_maps(config: &Config, mut base: Map, other: &Map) -> Result<JoinedMaps, AppendError> {
    let mut loop_closer = LoopCloser::new(config);
    let first = base.publish();
    loop_closer.step(LoopCloserMsg::Known {
        view: Arc::clone(&first),
    });
    let added = base.append(other)?;
    let mut mapper = Mapper::new(config).with_map(base);
    let mut view = mapper.publish();
    let before = view.submaps().len();
    let mut reports = Vec::new();
    let ids = view.keyframes().map(|k| k.id);
    let new: Vec<KeyframeId> = ids.filter(|id| id.0 >= added).collect();
    for id in new {
        let out = loop_closer.step(LoopCloserMsg::Keyframe {
            id,
            view: Arc::clone(&view),
        });
        reports.extend(out.report);
        if let Some(correction) = out.correction {
            let out = mapper.step(MapperMsg::Correct(correction));
            view = out.view;
            let map_version = view.version();
            loop_closer.step(LoopCloserMsg::Corrected { map_version });
        }
    }
    let submaps = [before, view.submaps().len()];
    let map = mapper.into_map();
    let placed = [(&*first, 0), (other.view(), added)];
    Ok(JoinedMaps {
        placed: placed.map(|(before, added)| Placed::of(before, map.view(), added)),
        map,
        reports,
        submaps,
        added,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Vec6;

    #[test]
    fn rigid_fit_is_exact_and_reports_the_bending() {
        let motion = Se3::exp(&Vec6::new(1.0, -2.0, 0.5, 0.3, -2.0, 0.7));
        let pose = |k: u32| {
            let k = f64::from(k);
            Se3::exp(&Vec6::new(
                0.1 * k,
                0.02 * k * k,
                0.3,
                0.2 * k,
                0.1,
                -0.05 * k,
            ))
        };
        let mut pairs: Vec<(Se3, Se3)> = (0..9).map(|k| (pose(k), motion * pose(k))).collect();
        let off = |p: Placed| (p.joined_from_map.inverse() * motion).log().norm();
        let found = Placed::fitting(&pairs).unwrap();
        assert!(off(found) < 1e-9 && found.bent < 1e-9, "{found:?}");
        for (k, (_, now)) in pairs.iter_mut().enumerate() {
            now.translation.x += if k % 3 == 0 { 0.02 } else { -0.01 };
        }
        let found = Placed::fitting(&pairs).unwrap();
        assert!(off(found) < 1e-9, "{found:?}");
        assert!((found.bent - 0.02).abs() < 1e-9, "{found:?}");
        assert_eq!(Placed::fitting(&[]), None);
    }
}

//! Landmarks and their observations.

use super::super::MapFileError;
use super::super::sections::{CULLED, Counts, NONE, Part};
use super::{Source, descriptors, reader};
use crate::{Keyframe, KeyframeId, Landmark, ScaleRange};
use stillpoint_geometry::Vec3;

/// Per landmark: [`NONE`] when live, [`CULLED`], or the landmark it was merged into.
pub(super) fn slots(source: &Source<'_>, counts: &Counts) -> Result<Vec<u32>, MapFileError> {
    let bytes = source.bytes(Part::LandmarkSlots)?;
    let mut from = reader(Part::LandmarkSlots, &bytes);
    let count = counts.landmark_slots;
    let mut slots = Vec::with_capacity(from.take(count as usize, 4)?.len() / 4);
    from = reader(Part::LandmarkSlots, &bytes);
    for id in 0..count {
        let slot = from.u32()?;
        if slot != NONE && slot != CULLED && (slot >= count || slot == id) {
            let expected = format!("landmark {id} merged into another of {count}");
            return Err(MapFileError::invalid("landmark slots", expected, slot));
        }
        slots.push(slot);
    }
    from.end()?;
    let live = slots.iter().filter(|s| **s == NONE).count();
    if live != counts.landmarks as usize {
        let expected = format!("{} live landmarks, as the header says", counts.landmarks);
        return Err(MapFileError::invalid("landmark slots", expected, live));
    }
    Ok(slots)
}

/// The live landmarks, by id, without counts of observers.
pub(super) fn landmarks(source: &Source<'_>, count: usize) -> Result<Vec<Landmark>, MapFileError> {
    let bytes = source.bytes(Part::Landmarks)?;
    let mut from = reader(Part::Landmarks, &bytes);
    let (anchor, created_at) = (from.column32(count)?, from.column32(count)?);
    let (visible, found) = (from.column32(count)?, from.column32(count)?);
    let static_odds = from.floats32(count)?;
    let (nearest, farthest) = (from.floats32(count)?, from.floats32(count)?);
    from.end()?;
    let bytes = source.bytes(Part::LandmarkPositions)?;
    let mut from = reader(Part::LandmarkPositions, &bytes);
    let mut vectors = || -> Result<Vec<Vec3>, MapFileError> {
        let (x, y, z) = (
            from.floats64(count)?,
            from.floats64(count)?,
            from.floats64(count)?,
        );
        Ok((0..count).map(|i| Vec3::new(x[i], y[i], z[i])).collect())
    };
    let (positions, directions) = (vectors()?, vectors()?);
    from.end()?;
    let descriptors = descriptors(source, Part::LandmarkDescriptors, count)?;
    let landmark = |i: usize| Landmark {
        anchor: KeyframeId(anchor[i]),
        position_in_anchor: positions[i],
        direction_in_anchor: directions[i],
        scale_range: ScaleRange {
            min_distance: nearest[i],
            max_distance: farthest[i],
        },
        descriptor: descriptors[i],
        observers: 0,
        depth_observers: 0,
        created_at: KeyframeId(created_at[i]),
        visible: visible[i],
        found: found[i],
        static_odds: static_odds[i],
    };
    Ok((0..count).map(landmark).collect())
}

pub(super) type Observations = Vec<Vec<(KeyframeId, u32)>>;

/// The inverse index. Keyframes are in the order of ids, so each list is sorted.
pub(super) fn observations(
    keyframes: &[Keyframe],
    slots: &[u32],
) -> Result<Observations, MapFileError> {
    let mut counts = vec![0; slots.len()];
    for k in keyframes {
        for id in k.matches.iter().flatten() {
            if slots.get(id.index()) != Some(&NONE) {
                let expected = format!("live landmarks observed by keyframe {}", k.id);
                return Err(MapFileError::invalid("matches", expected, id));
            }
            counts[id.index()] += 1;
        }
    }
    let mut lists: Observations = counts.into_iter().map(Vec::with_capacity).collect();
    for k in keyframes {
        for (feature, id) in k.matches.iter().enumerate() {
            let Some(id) = id else { continue };
            let list = &mut lists[id.index()];
            if list.last().is_some_and(|last| last.0 == k.id) {
                let expected = format!("one feature of keyframe {} per landmark", k.id);
                let found = format!("two that observe {id}");
                return Err(MapFileError::invalid("matches", expected, found));
            }
            list.push((k.id, feature as u32));
        }
    }
    Ok(lists)
}

pub(super) fn count_observers(
    landmark: &mut Landmark,
    list: &[(KeyframeId, u32)],
    keyframes: &[Keyframe],
) {
    let has_depth = |(id, feature): &(KeyframeId, u32)| {
        let at = keyframes.binary_search_by_key(id, |k| k.id);
        at.is_ok_and(|i| keyframes[i].data.depths[*feature as usize] > 0.0)
    };
    landmark.observers = list.len() as u32;
    landmark.depth_observers = list.iter().filter(|o| has_depth(o)).count() as u32;
}

//! Keyframes and their features.

use super::super::MapFileError;
use super::super::encode::displaced;
use super::super::sections::{Counts, NONE, Part};
use super::{Source, descriptors, pose, reader};
use crate::{Keyframe, KeyframeData, KeyframeId, LandmarkId, SubmapId};
use std::ops::Range;
use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Se3};

/// Stored attributes of a live keyframe.
pub(super) struct Record {
    id: KeyframeId,
    parent: Option<KeyframeId>,
    pub(super) camera: Camera,
    /// Bounds of the feature grid, px.
    bounds: [f32; 4],
    features: usize,
    stamp: f64,
    world_from_camera: Se3,
    submap: SubmapId,
}

pub(super) fn records(
    source: &Source<'_>,
    counts: &Counts,
    cameras: &[Camera],
) -> Result<Vec<Record>, MapFileError> {
    let bytes = source.bytes(Part::Keyframes)?;
    let mut from = reader(Part::Keyframes, &bytes);
    let bounds: Vec<[f32; 4]> = cameras.iter().map(KeyframeData::grid_bounds).collect();
    let mut records: Vec<Record> = Vec::new();
    let mut features = 0;
    for _ in 0..counts.keyframes {
        let id = KeyframeId(from.u32()?);
        if let Some(last) = records.last().filter(|last| last.id >= id) {
            let expected = format!("ascending ids after {}", last.id);
            return Err(MapFileError::invalid("keyframes", expected, id));
        }
        let parent = Some(from.u32()?).filter(|p| *p != NONE).map(KeyframeId);
        let index = from.u32()? as usize;
        let (Some(camera), Some(bounds)) = (cameras.get(index), bounds.get(index)) else {
            let expected = format!("one of {} cameras of keyframe {id}", cameras.len());
            return Err(MapFileError::invalid("keyframes", expected, index));
        };
        let record = Record {
            id,
            parent,
            camera: *camera,
            bounds: *bounds,
            features: from.u32()? as usize,
            stamp: from.f64()?,
            world_from_camera: pose(&mut from)?,
            submap: SubmapId(from.u32()?),
        };
        if record.submap.0 >= counts.keyframe_slots {
            let expected = format!("a submap below {} of keyframe {id}", counts.keyframe_slots);
            return Err(MapFileError::invalid("keyframes", expected, record.submap));
        }
        features += record.features as u64;
        records.push(record);
    }
    from.end()?;
    if features != counts.features {
        let expected = format!("{} features, as the header says", counts.features);
        return Err(MapFileError::invalid("keyframes", expected, features));
    }
    Ok(records)
}

pub(super) fn keyframes(
    source: &Source<'_>,
    records: Vec<Record>,
    features: u64,
) -> Result<Vec<Keyframe>, MapFileError> {
    let columns = Columns::read(source, features as usize)?;
    let mut begin = 0;
    let keyframe = |r: Record| {
        let range = begin..begin + r.features;
        begin = range.end;
        Keyframe {
            id: r.id,
            matches: columns.matches[range.clone()].to_vec(),
            data: Arc::new(columns.data(&r, range)),
            world_from_camera: r.world_from_camera,
            covisible: Vec::new(),
            parent: r.parent,
            submap: r.submap,
        }
    };
    Ok(records.into_iter().map(keyframe).collect())
}

struct Columns {
    keypoints: Vec<Keypoint>,
    positions: Vec<[f32; 2]>,
    sigma_px: Vec<f32>,
    depths: Vec<f32>,
    depth_sigmas: Vec<f32>,
    descriptors: Vec<Descriptor>,
    matches: Vec<Option<LandmarkId>>,
    mappable: Vec<bool>,
}

impl Columns {
    fn read(source: &Source<'_>, count: usize) -> Result<Self, MapFileError> {
        let keypoints = keypoints(&source.bytes(Part::Keypoints)?, source.version, count)?;
        let bytes = source.bytes(Part::Positions)?;
        let mut from = reader(Part::Positions, &bytes);
        let (x, y) = (from.column32(count)?, from.column32(count)?);
        let sigma_px = from.floats32(count)?;
        from.end()?;
        let near = x.iter().zip(&y).zip(&keypoints);
        let positions = near.map(|((x, y), k)| [displaced(*x, k.x), displaced(*y, k.y)]);
        let positions = positions.collect();
        let bytes = source.bytes(Part::Depths)?;
        let mut from = reader(Part::Depths, &bytes);
        let (depths, depth_sigmas) = (from.floats32(count)?, from.floats32(count)?);
        from.end()?;
        let (matches, mappable) = matches(&source.bytes(Part::Matches)?, count)?;
        Ok(Self {
            keypoints,
            positions,
            sigma_px,
            depths,
            depth_sigmas,
            descriptors: descriptors(source, Part::Descriptors, count)?,
            matches,
            mappable,
        })
    }

    fn data(&self, record: &Record, range: Range<usize>) -> KeyframeData {
        let keypoints = self.keypoints[range.clone()].to_vec();
        let positions = self.positions[range.clone()].to_vec();
        let levels: Vec<u8> = keypoints.iter().map(|k| k.level).collect();
        KeyframeData {
            stamp: record.stamp,
            camera: record.camera,
            grid: FeatureGrid::build(&positions, &levels, record.bounds),
            keypoints,
            positions,
            sigma_px: self.sigma_px[range.clone()].to_vec(),
            depths: self.depths[range.clone()].to_vec(),
            depth_sigmas: self.depth_sigmas[range.clone()].to_vec(),
            descriptors: Arc::new(self.descriptors[range.clone()].to_vec()),
            mappable: self.mappable[range].to_vec(),
        }
    }
}

/// Format 1 has no edges: all keypoints count as ideal corners.
fn keypoints(bytes: &[u8], format: u32, count: usize) -> Result<Vec<Keypoint>, MapFileError> {
    let mut from = reader(Part::Keypoints, bytes);
    let (x, y) = (from.floats32(count)?, from.floats32(count)?);
    let (angle, response) = (from.floats32(count)?, from.floats32(count)?);
    let levels = from.take(count, 1)?;
    let edges = match format {
        1 => None,
        _ => Some([from.take(count, 1)?, from.take(count, 1)?]),
    };
    from.end()?;
    let keypoint = |i: usize| Keypoint {
        x: x[i],
        y: y[i],
        level: levels[i],
        angle: angle[i],
        response: response[i],
        edge: edges.map_or_else(Edge::default, |[x, y]| Edge::from_bytes([x[i], y[i]])),
    };
    Ok((0..count).map(keypoint).collect())
}

type Matches = (Vec<Option<LandmarkId>>, Vec<bool>);

fn matches(bytes: &[u8], count: usize) -> Result<Matches, MapFileError> {
    let mut from = reader(Part::Matches, bytes);
    let matches = from.column32(count)?.into_iter();
    let matches = matches.map(|m| (m != NONE).then_some(LandmarkId::new(m)));
    let mappable = from.take(count, 1)?;
    from.end()?;
    if let Some(odd) = mappable.iter().find(|b| **b > 1) {
        return Err(MapFileError::invalid("matches", "0 or 1 per feature", odd));
    }
    Ok((
        matches.collect(),
        mappable.iter().map(|b| *b == 1).collect(),
    ))
}

pub(super) fn covisibility(
    source: &Source<'_>,
    counts: &Counts,
    keyframes: &mut [Keyframe],
) -> Result<(), MapFileError> {
    let bytes = source.bytes(Part::Covisibility)?;
    let mut from = reader(Part::Covisibility, &bytes);
    let count = counts.covisible_pairs as usize;
    let (first, second) = (from.column32(count)?, from.column32(count)?);
    let shared = from.column32(count)?;
    from.end()?;
    let mut last = None;
    for ((a, b), n) in first.into_iter().zip(second).zip(shared) {
        let of = |id: u32| keyframes.binary_search_by_key(&KeyframeId(id), |k| k.id);
        let (Ok(i), Ok(j), true, true) = (of(a), of(b), a < b && last < Some((a, b)), n > 0) else {
            return Err(MapFileError::invalid(
                "covisibility",
                "pairs of live keyframes, the smaller id first, in ascending order, that share landmarks",
                format!("{a} and {b} with {n}"),
            ));
        };
        last = Some((a, b));
        keyframes[i].covisible.push((KeyframeId(b), n));
        keyframes[j].covisible.push((KeyframeId(a), n));
    }
    for k in keyframes {
        crate::map::sort_by_weight(&mut k.covisible);
        k.covisible.shrink_to_fit();
    }
    Ok(())
}

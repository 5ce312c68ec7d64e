//! Sections as a map. Indices are checked here, where something is looked up by them; what values may be is checked after.

use super::MapFileError;
use super::bytes::Reader;
use super::container::Stored;
use super::encode::displaced;
use super::sections::{CULLED, Counts, MAX_KEYFRAME_SLOTS, NONE, Part};
use super::validate;
use crate::{
    Chunked, Keyframe, KeyframeData, KeyframeId, KeyframeSlot, Landmark, LandmarkId, LandmarkSlot,
    Map, MapView, PieceId, ScaleRange,
};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use stillpoint_features::{Descriptor, FeatureGrid, Keypoint};
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec3};

/// The map of its sections, from a file of `file_length` bytes.
pub(super) fn map(sections: &[Stored<'_>], file_length: usize) -> Result<Map, MapFileError> {
    let names = || sections.iter().map(|s| s.name);
    if !names().eq(Part::ALL.iter().map(|p| p.name())) {
        let found: Vec<&str> = names().take(2 * Part::ALL.len()).collect();
        return Err(MapFileError::invalid(
            "the list of sections",
            Part::ALL.map(Part::name).join(", "),
            found.join(", ").escape_debug(),
        ));
    }
    let source = Source { sections };
    let (version, level_scales, counts) = header(&source)?;
    let cameras = cameras(&source, &counts)?;
    let records = keyframe_records(&source, &counts, &cameras)?;
    validate::grids(records.iter().map(|r| &r.camera), file_length)?;
    let mut keyframes = keyframes(&source, records, counts.features)?;
    covisibility(&source, &counts, &mut keyframes)?;
    let slots = landmark_slots(&source, &counts)?;
    let observations = observations(&keyframes, &slots)?;
    let mut view = MapView {
        version,
        keyframes: Chunked::filled(KeyframeSlot::Empty, counts.keyframe_slots as usize),
        landmarks: Chunked::filled(LandmarkSlot::Culled, slots.len()),
        live_keyframes: keyframes.len(),
        live_landmarks: counts.landmarks as usize,
    };
    let mut landmarks = landmarks(&source, counts.landmarks as usize)?.into_iter();
    for (id, slot) in slots.iter().enumerate() {
        let new = match *slot {
            CULLED => continue,
            NONE => landmarks.next().map(|mut landmark| {
                count_observers(&mut landmark, &observations[id], &keyframes);
                LandmarkSlot::Live(landmark)
            }),
            into => Some(LandmarkSlot::Merged(LandmarkId(into))),
        };
        if let (Some(slot), Some(new)) = (view.landmarks.get_mut(id), new) {
            *slot = new;
        }
    }
    tombstones(&source, &counts, &mut view)?;
    for keyframe in keyframes {
        let id = keyframe.id;
        fill(
            &mut view,
            id,
            KeyframeSlot::Live(Arc::new(keyframe)),
            Part::Keyframes,
        )?;
    }
    Ok(Map {
        view,
        observations,
        level_scales,
    })
}

/// The sections, which are those of [`Part::ALL`].
struct Source<'a> {
    sections: &'a [Stored<'a>],
}

impl<'a> Source<'a> {
    fn bytes(&self, part: Part) -> Result<Cow<'a, [u8]>, MapFileError> {
        let section = &self.sections[part as usize];
        if section.compressed && !part.may_compress() {
            return Err(MapFileError::invalid(
                part.name(),
                "plain bytes",
                "compressed ones",
            ));
        }
        section.bytes()
    }
}

/// The same for whoever reads only a part.
fn reader(part: Part, bytes: &[u8]) -> Reader<'_> {
    Reader::new(part.name(), bytes)
}

fn header(source: &Source<'_>) -> Result<(u64, Vec<f32>, Counts), MapFileError> {
    let bytes = source.bytes(Part::Header)?;
    let mut from = reader(Part::Header, &bytes);
    let version = from.u64()?;
    let counts = Counts {
        features: from.u64()?,
        cameras: from.u32()?,
        keyframe_slots: from.u32()?,
        keyframes: from.u32()?,
        tombstones: from.u32()?,
        covisible_pairs: from.u32()?,
        landmark_slots: from.u32()?,
        landmarks: from.u32()?,
    };
    let levels = from.u32()? as usize;
    let scales = from.take(levels, 4)?.chunks_exact(4);
    let scales = scales.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let scales = scales.collect();
    from.end()?;
    if counts.keyframe_slots as usize > MAX_KEYFRAME_SLOTS {
        let most = format!("at most {MAX_KEYFRAME_SLOTS} ids of keyframes");
        return Err(MapFileError::invalid("header", most, counts.keyframe_slots));
    }
    Ok((version, scales, counts))
}

fn cameras(source: &Source<'_>, counts: &Counts) -> Result<Vec<Camera>, MapFileError> {
    let bytes = source.bytes(Part::Cameras)?;
    let mut from = reader(Part::Cameras, &bytes);
    let mut cameras = Vec::new();
    for _ in 0..counts.cameras {
        let mut camera = Camera::pinhole(from.u32()?, from.u32()?, [0.0; 4]);
        camera.fx = from.f64()?;
        camera.fy = from.f64()?;
        camera.cx = from.f64()?;
        camera.cy = from.f64()?;
        camera.distortion = BrownConrady {
            k1: from.f64()?,
            k2: from.f64()?,
            p1: from.f64()?,
            p2: from.f64()?,
            k3: from.f64()?,
        };
        validate::camera(&camera)?;
        cameras.push(camera);
    }
    from.end()?;
    Ok(cameras)
}

/// What is stored of each live keyframe as a whole.
struct Record {
    id: KeyframeId,
    parent: Option<KeyframeId>,
    camera: Camera,
    /// Where a grid has its cells, px.
    bounds: [f32; 4],
    features: usize,
    stamp: f64,
    world_from_camera: Se3,
    piece: PieceId,
}

fn keyframe_records(
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
            piece: PieceId(from.u32()?),
        };
        if record.piece.0 >= counts.keyframe_slots {
            let expected = format!("a piece below {} of keyframe {id}", counts.keyframe_slots);
            return Err(MapFileError::invalid("keyframes", expected, record.piece));
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

/// Not normalised, so that the bits stay; whether it is a rotation is checked later.
fn pose(from: &mut Reader<'_>) -> Result<Se3, MapFileError> {
    let (i, j, k, w) = (from.f64()?, from.f64()?, from.f64()?, from.f64()?);
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    let translation = Vec3::new(from.f64()?, from.f64()?, from.f64()?);
    Ok(Se3::new(rotation, translation))
}

/// The keyframes, not yet covisible.
fn keyframes(
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
            piece: r.piece,
        }
    };
    Ok(records.into_iter().map(keyframe).collect())
}

/// The features of all keyframes, one after another.
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
        let keypoints = keypoints(&source.bytes(Part::Keypoints)?, count)?;
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
            descriptors: self.descriptors[range.clone()].to_vec(),
            mappable: self.mappable[range].to_vec(),
        }
    }
}

fn keypoints(bytes: &[u8], count: usize) -> Result<Vec<Keypoint>, MapFileError> {
    let mut from = reader(Part::Keypoints, bytes);
    let (x, y) = (from.floats32(count)?, from.floats32(count)?);
    let (angle, response) = (from.floats32(count)?, from.floats32(count)?);
    let levels = from.take(count, 1)?;
    from.end()?;
    let keypoint = |i: usize| Keypoint {
        x: x[i],
        y: y[i],
        level: levels[i],
        angle: angle[i],
        response: response[i],
    };
    Ok((0..count).map(keypoint).collect())
}

type Matches = (Vec<Option<LandmarkId>>, Vec<bool>);

fn matches(bytes: &[u8], count: usize) -> Result<Matches, MapFileError> {
    let mut from = reader(Part::Matches, bytes);
    let matches = from.column32(count)?.into_iter();
    let matches = matches.map(|m| (m != NONE).then_some(LandmarkId(m)));
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

fn descriptors(
    source: &Source<'_>,
    part: Part,
    count: usize,
) -> Result<Vec<Descriptor>, MapFileError> {
    let bytes = source.bytes(part)?;
    let mut from = reader(part, &bytes);
    let all = from.take(count, 32)?.chunks_exact(32);
    from.end()?;
    let word = |b: &[u8]| b.iter().rev().fold(0, |w, byte| w << 8 | u64::from(*byte));
    Ok(all
        .map(|b| Descriptor(std::array::from_fn(|i| word(&b[8 * i..8 * i + 8]))))
        .collect())
}

/// Gives both of each pair the other.
fn covisibility(
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

/// For each landmark [`NONE`] when it is live, [`CULLED`], or which it was merged into.
fn landmark_slots(source: &Source<'_>, counts: &Counts) -> Result<Vec<u32>, MapFileError> {
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

/// The live landmarks, in the order of their ids. Their observers are counted later.
fn landmarks(source: &Source<'_>, count: usize) -> Result<Vec<Landmark>, MapFileError> {
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

type Observations = Vec<Vec<(KeyframeId, u32)>>;

/// The inverse index. Keyframes come by id, so each list is sorted.
fn observations(keyframes: &[Keyframe], slots: &[u32]) -> Result<Observations, MapFileError> {
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

fn count_observers(landmark: &mut Landmark, list: &[(KeyframeId, u32)], keyframes: &[Keyframe]) {
    let has_depth = |(id, feature): &(KeyframeId, u32)| {
        let at = keyframes.binary_search_by_key(id, |k| k.id);
        at.is_ok_and(|i| keyframes[i].data.depths[*feature as usize] > 0.0)
    };
    landmark.observers = list.len() as u32;
    landmark.depth_observers = list.iter().filter(|o| has_depth(o)).count() as u32;
}

fn tombstones(
    source: &Source<'_>,
    counts: &Counts,
    view: &mut MapView,
) -> Result<(), MapFileError> {
    let bytes = source.bytes(Part::Tombstones)?;
    let mut from = reader(Part::Tombstones, &bytes);
    for _ in 0..counts.tombstones {
        let (id, parent) = (KeyframeId(from.u32()?), KeyframeId(from.u32()?));
        let slot = KeyframeSlot::Culled {
            parent,
            parent_from_this: pose(&mut from)?,
        };
        fill(view, id, slot, Part::Tombstones)?;
    }
    from.end()
}

/// Puts something where nothing is.
fn fill(
    view: &mut MapView,
    id: KeyframeId,
    new: KeyframeSlot,
    part: Part,
) -> Result<(), MapFileError> {
    let bound = view.keyframes.len();
    match view.keyframes.get_mut(id.index()) {
        Some(slot @ KeyframeSlot::Empty) => {
            *slot = new;
            Ok(())
        }
        _ => {
            let expected = format!("ids below {bound}, each once");
            Err(MapFileError::invalid(part.name(), expected, id))
        }
    }
}

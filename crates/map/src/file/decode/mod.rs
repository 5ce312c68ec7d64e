//! Decodes sections to a map. Indices are checked here, before their use; value ranges are checked afterwards.

mod keyframes;
mod landmarks;

use super::MapFileError;
use super::bytes::Reader;
use super::container::Stored;
use super::sections::{CULLED, Counts, MAX_KEYFRAME_SLOTS, NONE, Part};
use super::validate;
use crate::sparse::Sparse;
use crate::{KeyframeId, KeyframeSlot, LandmarkId, Map, MapView};
use std::borrow::Cow;
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec3};

/// Decodes the sections of a file of this version of the format and of `file_length` bytes.
pub(super) fn map(
    (sections, version): (&[Stored<'_>], u32),
    file_length: usize,
) -> Result<Map, MapFileError> {
    let names = || sections.iter().map(|s| s.name);
    if !names().eq(Part::ALL.iter().map(|p| p.name())) {
        let found: Vec<&str> = names().take(2 * Part::ALL.len()).collect();
        return Err(MapFileError::invalid(
            "the list of sections",
            Part::ALL.map(Part::name).join(", "),
            found.join(", ").escape_debug(),
        ));
    }
    let source = Source { sections, version };
    let (version, level_scales, counts) = header(&source)?;
    let cameras = cameras(&source, &counts)?;
    let records = keyframes::records(&source, &counts, &cameras)?;
    validate::grids(records.iter().map(|r| &r.camera), file_length)?;
    let mut keyframes = keyframes::keyframes(&source, records, counts.features)?;
    keyframes::covisibility(&source, &counts, &mut keyframes)?;
    let slots = landmarks::slots(&source, &counts)?;
    let lists = landmarks::observations(&keyframes, &slots)?;
    let mut view = MapView {
        version,
        keyframes: Sparse::empty(counts.keyframe_slots as usize),
        landmarks: Sparse::empty(slots.len()),
        merged: Sparse::empty(slots.len()),
        loops: Arc::default(),
        live_keyframes: keyframes.len(),
        live_landmarks: counts.landmarks as usize,
    };
    let mut landmarks = landmarks::landmarks(&source, counts.landmarks as usize)?.into_iter();
    let mut observations = Sparse::empty(slots.len());
    for (id, (slot, list)) in slots.iter().zip(lists).enumerate() {
        match *slot {
            CULLED => {}
            NONE => {
                if let Some(mut landmark) = landmarks.next() {
                    landmarks::count_observers(&mut landmark, &list, &keyframes);
                    view.landmarks.set(id, Arc::new(landmark));
                    observations.set(id, list);
                }
            }
            into => view.merged.set(id, LandmarkId::new(into)),
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

/// The sections, known to be those of [`Part::ALL`].
struct Source<'a> {
    sections: &'a [Stored<'a>],
    /// Of the format.
    version: u32,
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
    validate::camera_count(counts.cameras as usize)?;
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

/// Not normalised, to preserve all bits; checked to be a rotation later.
pub(super) fn pose(from: &mut Reader<'_>) -> Result<Se3, MapFileError> {
    let (i, j, k, w) = (from.f64()?, from.f64()?, from.f64()?, from.f64()?);
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    let translation = Vec3::new(from.f64()?, from.f64()?, from.f64()?);
    Ok(Se3::new(rotation, translation))
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

fn fill(
    view: &mut MapView,
    id: KeyframeId,
    new: KeyframeSlot,
    part: Part,
) -> Result<(), MapFileError> {
    let bound = view.keyframes.len();
    if id.index() >= bound || view.keyframes.get(id.index()).is_some() {
        let expected = format!("ids below {bound}, each once");
        return Err(MapFileError::invalid(part.name(), expected, id));
    }
    view.keyframes.set(id.index(), new);
    Ok(())
}

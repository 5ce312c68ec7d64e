//! Encodes a map as sections.

use super::MapFileError;
use super::bytes::Writer;
use super::container::{Kind, Section};
use super::sections::{CULLED, Counts, MAX_KEYFRAME_SLOTS, NONE, Part};
use crate::landmark::LandmarkSlot;
use crate::{Keyframe, KeyframeData, KeyframeId, KeyframeSlot, Landmark, LandmarkId, Map};
use std::borrow::Cow;
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_geometry::{Camera, Se3};

/// The sections of a checked map, in the order of [`Part::ALL`].
pub(super) fn sections(map: &Map) -> Result<Vec<Section<'static>>, MapFileError> {
    let content = Content::new(map)?;
    let section = |part: Part| Section {
        kind: Kind::Map,
        name: part.name(),
        bytes: Cow::Owned(content.write(part)),
        compress: part.may_compress(),
    };
    Ok(Part::ALL.into_iter().map(section).collect())
}

struct Content<'a> {
    map: &'a Map,
    cameras: Vec<Camera>,
    /// Live keyframes with the indices of their cameras.
    keyframes: Vec<(&'a Keyframe, u32)>,
    tombstones: Vec<(u32, KeyframeId, Se3)>,
    pairs: Vec<[u32; 3]>,
    landmarks: Vec<&'a Landmark>,
    counts: Counts,
}

impl<'a> Content<'a> {
    fn new(map: &'a Map) -> Result<Self, MapFileError> {
        let mut cameras: Vec<Camera> = Vec::new();
        let mut keyframes = Vec::new();
        let mut features = 0;
        for k in map.view.keyframes() {
            let camera = &k.data.camera;
            let index = match cameras.iter().position(|c| same(c, camera)) {
                Some(index) => index,
                None => {
                    cameras.push(*camera);
                    cameras.len() - 1
                }
            };
            keyframes.push((&**k, index as u32));
            features += k.data.len() as u64;
        }
        let slots = map.view.keyframes.len();
        if slots > MAX_KEYFRAME_SLOTS {
            let most = format!("keyframe ids below {MAX_KEYFRAME_SLOTS}");
            return Err(MapFileError::invalid("keyframes", most, slots - 1));
        }
        let tombstone = |(i, slot): (usize, &KeyframeSlot)| match slot {
            KeyframeSlot::Culled {
                parent,
                parent_from_this,
            } => Some((i as u32, *parent, *parent_from_this)),
            _ => None,
        };
        let tombstones: Vec<_> = map.view.keyframes.iter().filter_map(tombstone).collect();
        let pairs = covisible_pairs(map)?;
        let landmarks: Vec<&Landmark> = map.view.landmarks().map(|(_, l)| l).collect();
        let counts = Counts {
            cameras: cameras.len() as u32,
            keyframe_slots: slots as u32,
            keyframes: keyframes.len() as u32,
            tombstones: tombstones.len() as u32,
            covisible_pairs: pairs.len() as u32,
            landmark_slots: map.view.landmarks.len() as u32,
            landmarks: landmarks.len() as u32,
            features,
        };
        Ok(Self {
            map,
            cameras,
            keyframes,
            tombstones,
            pairs,
            landmarks,
            counts,
        })
    }

    fn write(&self, part: Part) -> Vec<u8> {
        let mut to = Writer::default();
        match part {
            Part::Header => self.header(&mut to),
            Part::Cameras => self.cameras.iter().for_each(|c| camera(&mut to, c)),
            Part::Keyframes => self.keyframes(&mut to),
            Part::Tombstones => self.tombstones(&mut to),
            Part::Covisibility => {
                for column in 0..3 {
                    to.column32(self.pairs.iter().map(|p| p[column]));
                }
            }
            Part::Keypoints => self.keypoints(&mut to),
            Part::Positions => self.positions(&mut to),
            Part::Depths => {
                to.column32(self.features(|d, i| d.depths[i].to_bits()));
                to.column32(self.features(|d, i| d.depth_sigmas[i].to_bits()));
            }
            Part::Descriptors => self
                .keyframes
                .iter()
                .flat_map(|(k, _)| k.data.descriptors.iter())
                .for_each(|d| descriptor(&mut to, d)),
            Part::Matches => self.matches(&mut to),
            Part::LandmarkSlots => self.landmark_slots(&mut to),
            Part::Landmarks => self.landmarks(&mut to),
            Part::LandmarkPositions => {
                let of =
                    |f: fn(&Landmark) -> f64| self.landmarks.iter().map(move |l| f(l).to_bits());
                for axis in [
                    |l: &Landmark| l.position_in_anchor.x,
                    |l: &Landmark| l.position_in_anchor.y,
                    |l: &Landmark| l.position_in_anchor.z,
                    |l: &Landmark| l.direction_in_anchor.x,
                    |l: &Landmark| l.direction_in_anchor.y,
                    |l: &Landmark| l.direction_in_anchor.z,
                ] {
                    to.column64(of(axis));
                }
            }
            Part::LandmarkDescriptors => self
                .landmarks
                .iter()
                .for_each(|l| descriptor(&mut to, &l.descriptor)),
        }
        to.bytes
    }

    fn header(&self, to: &mut Writer) {
        let c = &self.counts;
        to.u64(self.map.view.version);
        to.u64(c.features);
        for count in [
            c.cameras,
            c.keyframe_slots,
            c.keyframes,
            c.tombstones,
            c.covisible_pairs,
            c.landmark_slots,
            c.landmarks,
            self.map.level_scales.len() as u32,
        ] {
            to.u32(count);
        }
        for scale in &self.map.level_scales {
            to.u32(scale.to_bits());
        }
    }

    fn keyframes(&self, to: &mut Writer) {
        for (k, camera) in &self.keyframes {
            to.u32(k.id.0);
            to.u32(k.parent.map_or(NONE, |p| p.0));
            to.u32(*camera);
            to.u32(k.data.len() as u32);
            to.f64(k.data.stamp);
            pose(to, &k.world_from_camera);
            to.u32(k.submap.0);
        }
    }

    fn tombstones(&self, to: &mut Writer) {
        for (id, parent, parent_from_this) in &self.tombstones {
            to.u32(*id);
            to.u32(parent.0);
            pose(to, parent_from_this);
        }
    }

    fn features<T>(
        &self,
        of: impl Fn(&Arc<KeyframeData>, usize) -> T + Copy,
    ) -> impl Iterator<Item = T> {
        self.keyframes
            .iter()
            .flat_map(move |(k, _)| (0..k.data.len()).map(move |i| of(&k.data, i)))
    }

    fn keypoints(&self, to: &mut Writer) {
        to.column32(self.features(|d, i| d.keypoints[i].x.to_bits()));
        to.column32(self.features(|d, i| d.keypoints[i].y.to_bits()));
        to.column32(self.features(|d, i| d.keypoints[i].angle.to_bits()));
        to.column32(self.features(|d, i| d.keypoints[i].response.to_bits()));
        to.bytes.extend(self.features(|d, i| d.keypoints[i].level));
        for axis in 0..2 {
            let edges = self.features(|d, i| d.keypoints[i].edge.to_bytes()[axis]);
            to.bytes.extend(edges);
        }
    }

    fn positions(&self, to: &mut Writer) {
        to.column32(self.features(|d, i| difference(d.positions[i][0], d.keypoints[i].x)));
        to.column32(self.features(|d, i| difference(d.positions[i][1], d.keypoints[i].y)));
        to.column32(self.features(|d, i| d.sigma_px[i].to_bits()));
    }

    fn matches(&self, to: &mut Writer) {
        let matches = self.keyframes.iter().flat_map(|(k, _)| &k.matches);
        to.column32(matches.map(|m| m.map_or(NONE, |l| l.number())));
        to.bytes
            .extend(self.features(|d, i| u8::from(d.mappable[i])));
    }

    fn landmark_slots(&self, to: &mut Writer) {
        let view = &self.map.view;
        for id in 0..view.landmark_bound() as u32 {
            to.u32(match view.landmark_slot(LandmarkId::new(id)) {
                LandmarkSlot::Live(_) => NONE,
                LandmarkSlot::Merged(into) => into.number(),
                LandmarkSlot::Culled => CULLED,
            });
        }
    }

    fn landmarks(&self, to: &mut Writer) {
        let of = |f: fn(&Landmark) -> u32| self.landmarks.iter().map(move |l| f(l));
        to.column32(of(|l| l.anchor.0));
        to.column32(of(|l| l.created_at.0));
        to.column32(of(|l| l.visible));
        to.column32(of(|l| l.found));
        to.column32(of(|l| l.static_odds.to_bits()));
        to.column32(of(|l| l.scale_range.min_distance.to_bits()));
        to.column32(of(|l| l.scale_range.max_distance.to_bits()));
    }
}

/// Each pair of covisible keyframes once, smaller id first, in ascending order: [id, id, shared landmarks].
fn covisible_pairs(map: &Map) -> Result<Vec<[u32; 3]>, MapFileError> {
    let mut pairs: Vec<[u32; 3]> = Vec::new();
    for k in map.view.keyframes() {
        let begin = pairs.len();
        let later = k.covisible.iter().filter(|c| c.0 > k.id);
        pairs.extend(later.map(|&(other, shared)| [k.id.0, other.0, shared]));
        pairs[begin..].sort_unstable();
    }
    match pairs.windows(2).find(|w| w[0][..2] == w[1][..2]) {
        None => Ok(pairs),
        Some(w) => Err(MapFileError::invalid(
            "covisibility",
            "each pair of keyframes once",
            format!("{} and {} twice", w[0][0], w[0][1]),
        )),
    }
}

/// Bitwise equality, which distinguishes signs of zero.
fn same(a: &Camera, b: &Camera) -> bool {
    (a.width, a.height) == (b.width, b.height)
        && numbers(a).map(f64::to_bits) == numbers(b).map(f64::to_bits)
}

fn numbers(camera: &Camera) -> [f64; 9] {
    let d = &camera.distortion;
    [
        camera.fx, camera.fy, camera.cx, camera.cy, d.k1, d.k2, d.p1, d.p2, d.k3,
    ]
}

fn camera(to: &mut Writer, camera: &Camera) {
    to.u32(camera.width);
    to.u32(camera.height);
    for number in numbers(camera) {
        to.f64(number);
    }
}

pub(super) fn pose(to: &mut Writer, pose: &Se3) {
    for number in pose.rotation.coords.iter().chain(pose.translation.iter()) {
        to.f64(*number);
    }
}

fn descriptor(to: &mut Writer, descriptor: &Descriptor) {
    for word in descriptor.0 {
        to.u64(word);
    }
}

/// Difference of the bits of two floats; small differences of either sign become small numbers.
fn difference(value: f32, from: f32) -> u32 {
    let d = value.to_bits().wrapping_sub(from.to_bits()) as i32;
    ((d << 1) ^ (d >> 31)) as u32
}

/// Inverse of [`difference`].
pub(super) fn displaced(difference: u32, from: f32) -> f32 {
    let d = (difference >> 1) ^ (difference & 1).wrapping_neg();
    f32::from_bits(from.to_bits().wrapping_add(d))
}

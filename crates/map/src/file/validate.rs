//! Valid ranges of a map's values, applied to both reading and writing, so that every written map can be read.

use super::{Extension, MapFileError, loops};
use crate::{Keyframe, KeyframeData, KeyframeId, KeyframeSlot, Landmark, LandmarkId, Map};
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_geometry::{Camera, Se3, Vec3};

/// Maximum number of distinct cameras: one per merged run. Checking one takes a millisecond.
pub(super) const MAX_CAMERAS: usize = 1024;
/// Side of a bucket, px, and maximum buckets per side, as in [`stillpoint_features::FeatureGrid`].
const BUCKET: f32 = 16.0;
const MAX_BUCKETS: u64 = 512;
/// Bytes of buckets allowed for any map, and additional ones per byte of the file: a keyframe with one feature per
/// bucket takes some 20 times its buckets.
const FREE_BUCKETS: u64 = 256 << 20;
const BUCKETS_PER_BYTE: u64 = 16;
/// Tolerance of the unit length of rotations and directions: a thousand times the drift of products of rotations.
const UNIT_TOLERANCE: f64 = 1e-6;
/// Maximum of frame counters; larger ones are implausible and might overflow.
const MAX_FRAMES: u32 = 1 << 30;
/// Maximum map version.
const MAX_VERSION: u64 = 1 << 60;

/// Checks a whole map, for a file of `file_length` bytes.
pub(super) fn check(map: &Map, file_length: usize) -> Result<(), MapFileError> {
    let scales = &map.level_scales;
    let scales_are_well = scales.iter().all(|s| s.is_finite() && *s > 0.0);
    expect(
        "header",
        scales_are_well && (1..=256).contains(&scales.len()),
        || {
            (
                "1 to 256 positive scales of levels".into(),
                format!("{} of them: {:?} ...", scales.len(), scales.first()),
            )
        },
    )?;
    expect("header", map.view.version <= MAX_VERSION, || {
        (
            format!("a version of the map below {MAX_VERSION}"),
            map.view.version.to_string(),
        )
    })?;
    cameras(map.view.keyframes().map(|k| &k.data.camera))?;
    for k in map.view.keyframes() {
        lengths(k)?;
        pose("keyframes", k.id, &k.world_from_camera)?;
        expect("keyframes", k.data.stamp.is_finite(), || {
            (
                format!("a finite stamp of keyframe {}", k.id),
                k.data.stamp.to_string(),
            )
        })?;
        features(k, scales.len())?;
    }
    grids(map.view.keyframes().map(|k| &k.data.camera), file_length)?;
    for (i, slot) in map.view.keyframes.iter() {
        if let KeyframeSlot::Culled {
            parent_from_this, ..
        } = slot
        {
            pose("tombstones", KeyframeId(i as u32), parent_from_this)?;
        }
    }
    for (id, l) in map.view.landmarks() {
        landmark(id, l)?;
        let made = map.view.keyframe_slot(l.created_at);
        expect("landmarks", !matches!(made, KeyframeSlot::Empty), || {
            (
                format!("a keyframe at which landmark {id} was made"),
                l.created_at.to_string(),
            )
        })?;
    }
    map.check()?;
    Ok(())
}

fn expect(
    section: &str,
    holds: bool,
    otherwise: impl FnOnce() -> (String, String),
) -> Result<(), MapFileError> {
    if holds {
        return Ok(());
    }
    let (expected, found) = otherwise();
    Err(MapFileError::invalid(section, expected, found))
}

pub(super) fn names(extensions: &[Extension]) -> Result<(), MapFileError> {
    let mut names: Vec<&str> = extensions.iter().map(|e| e.name.as_str()).collect();
    names.sort_unstable();
    for (i, name) in names.iter().enumerate() {
        let is_new = names.get(i + 1) != Some(name);
        expect(
            "the extensions",
            is_new && (1..=255).contains(&name.len()),
            || {
                (
                    "names of 1 to 255 bytes, each once".into(),
                    format!("\"{}\"", name.escape_debug()),
                )
            },
        )?;
    }
    Ok(())
}

/// Checks that no extension uses the name reserved for the map's own.
pub(super) fn free(extensions: &[Extension]) -> Result<(), MapFileError> {
    let taken = extensions.iter().any(|e| e.name == loops::NAME);
    expect("the extensions", !taken, || {
        (
            "names other than that of the map's own extension".into(),
            format!("\"{}\"", loops::NAME),
        )
    })
}

pub(super) fn camera(camera: &Camera) -> Result<(), MapFileError> {
    let checked = camera.check();
    checked.map_err(|e| MapFileError::invalid("cameras", e.expected(), e.found()))
}

pub(super) fn camera_count(count: usize) -> Result<(), MapFileError> {
    expect("cameras", count <= MAX_CAMERAS, || {
        (format!("at most {MAX_CAMERAS}"), count.to_string())
    })
}

/// Checks the cameras of all keyframes, each distinct one once.
fn cameras<'a>(all: impl Iterator<Item = &'a Camera>) -> Result<(), MapFileError> {
    let mut seen = BTreeSet::new();
    for of_keyframe in all {
        if seen.insert(bits(of_keyframe)) {
            camera_count(seen.len())?;
            camera(of_keyframe)?;
        }
    }
    Ok(())
}

fn bits(camera: &Camera) -> [u64; 10] {
    let d = &camera.distortion;
    let size = u64::from(camera.width) << 32 | u64::from(camera.height);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::to_bits);
    let [k1, k2, p1, p2, k3] = [d.k1, d.k2, d.p1, d.p2, d.k3].map(f64::to_bits);
    [size, fx, fy, cx, cy, k1, k2, p1, p2, k3]
}

/// Checks that the feature grids of keyframes with these cameras take a plausible amount of memory.
pub(super) fn grids<'a>(
    cameras: impl Iterator<Item = &'a Camera>,
    file_length: usize,
) -> Result<(), MapFileError> {
    let side = |length: f32| ((length / BUCKET).ceil() as u64).clamp(1, MAX_BUCKETS);
    // Maps have few distinct cameras, and bounds are expensive compared to a look-up.
    let (mut bytes, mut known) = (0, BTreeMap::new());
    for camera in cameras {
        bytes += *known.entry(bits(camera)).or_insert_with(|| {
            let [left, top, right, bottom] = KeyframeData::grid_bounds(camera);
            4 * side(right - left) * side(bottom - top)
        });
    }
    let most = FREE_BUCKETS + BUCKETS_PER_BYTE * file_length as u64;
    expect("keyframes", bytes <= most, || {
        (
            "no more buckets than features".into(),
            format!("{bytes} bytes of buckets"),
        )
    })
}

fn lengths(k: &Keyframe) -> Result<(), MapFileError> {
    let d = &k.data;
    let lengths = [
        d.positions.len(),
        d.sigma_px.len(),
        d.depths.len(),
        d.depth_sigmas.len(),
        d.descriptors.len(),
        d.mappable.len(),
        k.matches.len(),
    ];
    expect("keyframes", lengths.iter().all(|n| *n == d.len()), || {
        (
            format!("{} values of each kind in keyframe {}", d.len(), k.id),
            format!("{lengths:?}"),
        )
    })
}

pub(super) fn pose(section: &str, id: KeyframeId, pose: &Se3) -> Result<(), MapFileError> {
    let norm2: f64 = pose.rotation.coords.iter().map(|x| x * x).sum();
    // Also false for NaN.
    let holds = pose.is_finite() && (norm2 - 1.0).abs() <= 2.0 * UNIT_TOLERANCE;
    expect(section, holds, || {
        (
            format!("a finite pose with a unit quaternion of keyframe {id}"),
            format!("{:?}, {:?}", pose.rotation.coords, pose.translation),
        )
    })
}

fn features(k: &Keyframe, levels: usize) -> Result<(), MapFileError> {
    let d = &k.data;
    let fail = |section: &str, i: usize, expected: &str, found: String| {
        let expected = format!("{expected} of feature {i} of keyframe {}", k.id);
        Err(MapFileError::invalid(section, expected, found))
    };
    for (i, p) in d.keypoints.iter().enumerate() {
        let finite = [p.x, p.y, p.angle, p.response]
            .iter()
            .all(|x| x.is_finite());
        let [x, y] = p.edge.vector();
        let edged = x * x + y * y <= 1.0;
        if !finite || !edged || usize::from(p.level) >= levels {
            let expected =
                format!("finite numbers, a level below {levels}, and an edge no longer than 127,");
            return fail("keypoints", i, &expected, format!("{p:?}"));
        }
    }
    for (i, (p, sigma)) in d.positions.iter().zip(&d.sigma_px).enumerate() {
        if !(p[0].is_finite() && p[1].is_finite() && sigma.is_finite() && *sigma > 0.0) {
            let expected = "a finite position with a positive deviation";
            return fail("positions", i, expected, format!("{p:?} +- {sigma}"));
        }
    }
    for (i, (z, sigma)) in d.depths.iter().zip(&d.depth_sigmas).enumerate() {
        if !(z.is_finite() && sigma.is_finite() && *z >= 0.0 && *sigma >= 0.0) {
            let expected = "a depth and its deviation, finite and not negative";
            return fail("depths", i, expected, format!("{z} +- {sigma}"));
        }
    }
    Ok(())
}

fn landmark(id: LandmarkId, l: &Landmark) -> Result<(), MapFileError> {
    let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
    // The mean direction is shorter for landmarks seen from many sides.
    let directed =
        finite(&l.direction_in_anchor) && l.direction_in_anchor.norm() <= 1.0 + UNIT_TOLERANCE;
    expect(
        "landmark positions",
        finite(&l.position_in_anchor) && directed,
        || {
            (
                format!("a finite position and a unit direction of landmark {id}"),
                format!("{:?}, {:?}", l.position_in_anchor, l.direction_in_anchor),
            )
        },
    )?;
    let range = l.scale_range;
    let holds = range.max_distance.is_finite()
        && 0.0 <= range.min_distance
        && range.min_distance <= range.max_distance
        && l.static_odds.is_finite()
        && l.visible <= MAX_FRAMES
        && l.found <= MAX_FRAMES;
    expect("landmarks", holds, || {
        (
            format!("distances in order, finite odds and counts of frames of landmark {id}"),
            format!(
                "{range:?}, odds {}, found {} of {}",
                l.static_odds, l.found, l.visible
            ),
        )
    })
}

//! Rejection of invalid files, by kind.

use super::made::{looped_map, random_map};
use super::{Raw, sealed, taken_apart};
use crate::file::sections::Part;
use crate::file::{Extension, MapFile, loops};
use crate::{Keyframe, KeyframeId, KeyframeSlot, LandmarkId};
use std::sync::Arc;
use stillpoint_features::Edge;

/// The error message after `change` of the sections.
fn refusal(change: impl FnOnce(&mut Vec<Raw>)) -> String {
    let mut raw = taken_apart(&random_map(3, 6, 300).to_bytes(&[]).unwrap());
    change(&mut raw);
    match MapFile::from_bytes(&sealed(&raw, true)) {
        Err(e) => e.to_string(),
        Ok(_) => panic!("nothing was refused"),
    }
}

fn check(change: impl FnOnce(&mut Vec<Raw>), words: &[&str]) {
    let message = refusal(change);
    for word in words {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
}

fn put(raw: &mut [Raw], part: Part, at: usize, new: &[u8]) {
    raw[part as usize].2[at..at + new.len()].copy_from_slice(new);
}

#[test]
fn every_invalid_content_has_its_message() {
    let nan = f64::NAN.to_le_bytes();
    // Layout of keyframe records: id, parent, camera, features, stamp, quaternion, translation, submap.
    check(
        |r| put(r, Part::Keyframes, 16, &nan),
        &["finite stamp", "keyframes", "NaN"],
    );
    check(
        |r| put(r, Part::Keyframes, 24, &1.5f64.to_le_bytes()),
        &["unit quaternion"],
    );
    check(|r| put(r, Part::Keyframes, 56, &nan), &["finite pose"]);
    check(
        |r| put(r, Part::Keyframes, 8, &[9]),
        &["cameras of keyframe"],
    );
    check(
        |r| put(r, Part::Keyframes, 80, &[255; 4]),
        &["a submap below"],
    );
    let own = |r: &mut Vec<Raw>| {
        let id = r[Part::Keyframes as usize].2[..4].to_vec();
        put(r, Part::Keyframes, 4, &id);
    };
    check(own, &["parent"]);
    check(
        |r| put(r, Part::Keyframes, 12, &[200]),
        &["features, as the header says"],
    );
    check(|r| put(r, Part::Cameras, 0, &[0, 0]), &["an image of 1 to"]);
    check(|r| put(r, Part::Cameras, 8, &nan), &["focal"]);
    // More cameras than merged runs could have; and the same lens without its last coefficient.
    check(
        |r| put(r, Part::Header, 16, &50_000u32.to_le_bytes()),
        &["at most 1024 in cameras", "50000"],
    );
    let folded = |r: &mut Vec<Raw>| {
        let bytes = &mut r[Part::Cameras as usize].2;
        let records: Vec<usize> = (0..bytes.len() / 80).map(|i| 80 * i).collect();
        for at in records {
            bytes[at + 72..at + 80].fill(0);
        }
    };
    check(folded, &["k3 is 0: was it left out?"]);
    let own = |r: &mut Vec<Raw>| {
        let id = r[Part::Tombstones as usize].2[..4].to_vec();
        put(r, Part::Tombstones, 4, &id);
    };
    check(own, &["tombstone", "does not hold"]);
    // Counts that contradict the sections: version, features, cameras, slots, keyframes, tombstones, pairs, landmark
    // slots, landmarks.
    check(
        |r| put(r, Part::Header, 8, &u64::MAX.to_le_bytes()),
        &["features, as the header says"],
    );
    check(
        |r| put(r, Part::Header, 20, &u32::MAX.to_le_bytes()),
        &["ids of keyframes"],
    );
    for count in [16, 24, 28, 32, 36, 40, 44] {
        refusal(|r| put(r, Part::Header, count, &u32::MAX.to_le_bytes()));
        refusal(|r| put(r, Part::Header, count, &[0; 4]));
    }
    check(|r| drop(r.remove(4)), &["covisibility", "list of sections"]);
    check(|r| r[4].2.push(0), &["covisibility", "bytes"]);
    check(
        |r| put(r, Part::LandmarkSlots, 0, &[0; 4]),
        &["merged into another"],
    );
    check(
        |r| r[Part::Matches as usize].2.fill(255),
        &["0 or 1 per feature"],
    );
    let none = |r: &mut Vec<Raw>| {
        let bytes = &mut r[Part::Matches as usize].2;
        let features = bytes.len() / 5;
        bytes[..4 * features].fill(255);
    };
    check(none, &["is observed"]);
    let floats = |part: Part| {
        // The upper two planes of the first column.
        move |r: &mut Vec<Raw>| {
            let features = r[Part::Matches as usize].2.len() / 5;
            r[part as usize].2[2 * features..4 * features].fill(255);
        }
    };
    check(floats(Part::Keypoints), &["finite numbers", "keypoints"]);
    check(floats(Part::Depths), &["depths", "finite and not negative"]);
}

#[test]
fn cyclic_merges_are_refused() {
    let mut map = random_map(3, 6, 300);
    for (from, into) in [(0, 1), (1, 2), (2, 0)] {
        map.cull_landmark(LandmarkId::new(from));
        map.view.merged.set(from as usize, LandmarkId::new(into));
    }
    let e = map.to_bytes(&[]).unwrap_err();
    assert!(e.to_string().contains("come to an end"), "{e}");
}

#[test]
fn invalid_map_is_not_written() {
    let refuse = |change: fn(&mut Keyframe)| {
        let mut map = random_map(3, 6, 300);
        let id = map.view.keyframes().next().unwrap().id;
        change(map.keyframe_mut(id).unwrap());
        let mut out = Vec::new();
        let e = map.write(&mut out, &[]).unwrap_err();
        assert!(out.is_empty());
        assert_eq!(e.kind(), std::io::ErrorKind::InvalidData);
        e.to_string()
    };
    assert!(refuse(|k| k.world_from_camera.translation.x = f64::NAN).contains("finite pose"));
    assert!(refuse(|k| k.covisible.push((k.id, 0))).contains("covisib"));
    assert!(refuse(|k| Arc::make_mut(&mut k.data).depths.clear()).contains("values of each kind"));
    assert!(
        refuse(|k| Arc::make_mut(&mut k.data).keypoints[0].level = 8).contains("level below 8")
    );
    let long = |k: &mut Keyframe| {
        Arc::make_mut(&mut k.data).keypoints[0].edge = Edge::from_bytes([100, 100]);
    };
    assert!(refuse(long).contains("edge no longer than 127"));
}

#[test]
fn map_with_too_many_cameras_is_not_written() {
    let refusal = |cameras: u32| {
        let mut map = random_map(5, 4, 40);
        let one = map.view.keyframes().next().unwrap().clone();
        let mut slots = crate::sparse::Sparse::default();
        for i in 0..cameras {
            let mut k = (*one).clone();
            (k.id, k.parent) = (KeyframeId(i), None);
            Arc::make_mut(&mut k.data).camera.fx = 500.0 + 0.01 * f64::from(i);
            slots.set(i as usize, KeyframeSlot::Live(Arc::new(k)));
        }
        map.view.keyframes = slots;
        map.to_bytes(&[]).unwrap_err().to_string()
    };
    assert!(refusal(1025).contains("at most 1024 in cameras"));
    // Other errors of such a map are irrelevant here.
    assert!(!refusal(1024).contains("in cameras"));
}

#[test]
fn invalid_loop_sections_are_refused() {
    let map = looped_map(7, 12, 1500);
    assert!(map.view.loops().count() > 5);
    let bytes = map.to_bytes(&[]).unwrap();
    let refusal = |change: fn(&mut Vec<u8>)| {
        let mut raw = taken_apart(&bytes);
        let section = raw.iter_mut().find(|s| s.1 == loops::NAME).unwrap();
        change(&mut section.2);
        let Err(e) = MapFile::from_bytes(&sealed(&raw, true)) else {
            panic!("nothing was refused");
        };
        e.to_string()
    };
    let nan = f64::NAN.to_le_bytes();
    for (found, part) in [
        // Layout: two ids, a quaternion, a translation, 21 elements of a matrix, a count.
        (refusal(|b| b[0..4].fill(0xfe)), "the loop from keyframe"),
        (
            refusal(|b| b.copy_within(0..4, 4)),
            "the loop from keyframe",
        ),
        (refusal(|b| b[8..16].fill(0)), "unit quaternion"),
        (refusal(|b| b[15] ^= 0x7f), "unit quaternion"),
        (refusal(|b| b.truncate(b.len() - 1)), "stillpoint/loops"),
        (
            {
                let mut raw = taken_apart(&bytes);
                let section = raw.iter_mut().find(|s| s.1 == loops::NAME).unwrap();
                section.2[64..72].copy_from_slice(&nan);
                MapFile::from_bytes(&sealed(&raw, true))
                    .unwrap_err()
                    .to_string()
            },
            "the loop from keyframe",
        ),
    ] {
        assert!(found.contains(part), "{found:?} lacks {part:?}");
    }
    let own = Extension {
        name: loops::NAME.into(),
        bytes: Vec::new(),
    };
    let e = map.to_bytes(&[own]).unwrap_err().to_string();
    assert!(e.contains("names other than"), "{e}");
}

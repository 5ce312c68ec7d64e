//! Maps, their files, and what becomes of damaged files.

use super::container::{self, Kind, Section};
use super::sections::Part;
use super::{Extension, MapFile, MapFileError, blocks, loops};
use crate::{
    Correction, Keyframe, KeyframeData, KeyframeId, KeyframeSlot, LandmarkId, LandmarkSlot,
    LoopEdge, Map, NewLandmark,
};
use proptest::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;
use stillpoint_features::{Descriptor, FeatureGrid, Keypoint};
use stillpoint_geometry::{BrownConrady, Camera, Mat6, Se3, Vec3, Vec6};

/// SplitMix64.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u32) -> u32 {
        (self.bits() % u64::from(n.max(1))) as u32
    }

    /// In [0, 1).
    fn share(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }
}

const LEVELS: usize = 8;

fn cameras() -> [Camera; 2] {
    let mut wide = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    wide.distortion = BrownConrady {
        k1: 0.26,
        k2: -0.95,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.16,
    };
    [
        wide,
        Camera::pinhole(320, 240, [260.0, 260.0, 160.0, 120.0]),
    ]
}

fn data(random: &mut Random, features: u32, stamp: f64) -> Arc<KeyframeData> {
    let camera = cameras()[random.below(2) as usize];
    let n = features as usize;
    let keypoint = |_| Keypoint {
        x: random.below(camera.width) as f32,
        y: random.below(camera.height) as f32,
        level: random.below(LEVELS as u32) as u8,
        angle: 6.0 * random.share() - 3.0,
        response: 1.0 + random.below(255) as f32,
    };
    let keypoints: Vec<Keypoint> = (0..n).map(keypoint).collect();
    let positions: Vec<[f32; 2]> = keypoints
        .iter()
        .map(|k| {
            [
                k.x + 20.0 * random.share() - 10.0,
                k.y - 3.0 * random.share(),
            ]
        })
        .collect();
    let levels: Vec<u8> = keypoints.iter().map(|k| k.level).collect();
    let depths: Vec<f32> = (0..n)
        .map(|_| (5.0 * random.share() - 1.0).max(0.0))
        .collect();
    Arc::new(KeyframeData {
        stamp,
        camera,
        sigma_px: levels.iter().map(|l| 1.0 + 0.2 * f32::from(*l)).collect(),
        depth_sigmas: depths.iter().map(|z| 0.002 * z * z).collect(),
        depths,
        descriptors: (0..n)
            .map(|_| Descriptor(std::array::from_fn(|_| random.bits())))
            .collect(),
        mappable: (0..n).map(|_| random.below(10) > 0).collect(),
        grid: FeatureGrid::build(&positions, &levels, KeyframeData::grid_bounds(&camera)),
        keypoints,
        positions,
    })
}

fn pose(random: &mut Random) -> Se3 {
    let mut twist = Vec6::zeros();
    for x in twist.iter_mut() {
        *x = f64::from(random.share()) - 0.5;
    }
    Se3::exp(&twist)
}

fn point(random: &mut Random) -> Vec3 {
    let mut x = || 4.0 * f64::from(random.share()) - 2.0;
    Vec3::new(x(), x(), x() + 3.0)
}

/// A map after `changes` changes of every kind.
fn random_map(seed: u64, features: u32, changes: u32) -> Map {
    let random = &mut Random(seed);
    let mut map = Map::new(LEVELS, 1.2);
    let mut next = 0;
    for _ in 0..changes {
        // Mostly one that is there: most ids stand for nothing.
        let live: Vec<KeyframeId> = map.view.keyframes().map(|k| k.id).collect();
        let one = random.below(live.len() as u32) as usize;
        let keyframe = match live.get(one) {
            Some(id) if random.below(8) > 0 => *id,
            _ => KeyframeId(random.below(next)),
        };
        let landmark = |random: &mut Random, map: &Map| {
            LandmarkId(random.below(map.view.landmark_bound() as u32))
        };
        let (a, b) = (landmark(random, &map), landmark(random, &map));
        match random.below(32) {
            0..=3 => {
                let some = || map.view.keyframes().next().map(|k| k.id);
                let parent = map.view.resolve_keyframe(keyframe).or_else(some);
                // A few begin submaps of their own.
                let parent = parent.filter(|_| random.below(16) > 0);
                let data = data(random, features, 1e9 + f64::from(next) / 30.0);
                map.insert_keyframe(KeyframeId(next), data, pose(random), parent);
                next += 1 + random.below(3) * random.below(200);
            }
            4..=11 => {
                let observation = (keyframe, random.below(features));
                let position = point(random);
                map.insert_landmark(&NewLandmark {
                    position,
                    observation,
                });
            }
            12..=22 => {
                map.add_observation(a, keyframe, random.below(features));
            }
            23 => map.remove_observation(a, keyframe),
            24 => {
                map.merge_landmarks(a, b);
            }
            25 => map.cull_landmark(a),
            26 => {
                map.cull_keyframe(keyframe);
            }
            27 => {
                map.disown(keyframe, &[random.below(features)]);
            }
            28 => map.set_pose(keyframe, pose(random)),
            29 => {
                if let Some(l) = map.landmark_mut(a) {
                    l.visible += random.below(20);
                    l.static_odds = 4.0 * random.share() - 2.0;
                }
                map.publish();
            }
            _ => {
                map.refresh_landmark(a);
                map.refresh_covisibility(keyframe, 1);
            }
        }
    }
    map
}

/// The same with loops between some of its keyframes, where one submap has more than one.
fn looped_map(seed: u64, features: u32, changes: u32) -> Map {
    let mut map = random_map(seed, features, changes);
    let random = &mut Random(seed);
    let ids: Vec<KeyframeId> = map.view.keyframes().map(|k| k.id).collect();
    for _ in 0..ids.len() {
        let mut one = || ids[random.below(ids.len() as u32) as usize];
        let (old, new) = (one(), one());
        let mut information = Mat6::from_diagonal_element(f64::from(random.below(1000)));
        information[(1, 4)] = f64::from(random.share());
        information[(4, 1)] = information[(1, 4)];
        map.apply(&Correction {
            measured: Some(Box::new(LoopEdge {
                old,
                new,
                old_from_new: pose(random),
                information,
                inliers: random.below(200),
            })),
            ..Correction::default()
        });
    }
    map
}

/// Everything in a map, in words that differ when a bit differs.
fn words(map: &Map) -> String {
    format!("{map:?}")
}

fn extensions() -> Vec<Extension> {
    let extension = |name: &str, bytes: Vec<u8>| Extension {
        name: name.into(),
        bytes,
    };
    vec![
        extension("trajectory", (0..3000u32).map(|i| (i / 7) as u8).collect()),
        extension("calibration", Vec::new()),
        extension("header", vec![0; 5000]),
    ]
}

#[test]
fn the_maps_of_these_tests_have_everything() {
    let map = random_map(7, 12, 1500);
    let count = |f: fn(&KeyframeSlot) -> bool| map.view.keyframes.iter().filter(|s| f(s)).count();
    assert!(count(|s| matches!(s, KeyframeSlot::Empty)) > 256);
    assert!(count(|s| matches!(s, KeyframeSlot::Culled { .. })) > 3);
    assert!(map.view.keyframe_count() > 20);
    assert!(map.view.submaps().len() > 2);
    let covisible: usize = map.view.keyframes().map(|k| k.covisible.len()).sum();
    assert!(covisible > 4, "{covisible}");
    let count = |f: fn(&LandmarkSlot) -> bool| map.view.landmarks.iter().filter(|s| f(s)).count();
    assert!(count(|s| matches!(s, LandmarkSlot::Merged(_))) > 3);
    assert!(count(|s| matches!(s, LandmarkSlot::Culled)) > 10);
    let observed_often = |l: &&crate::Landmark| l.observers > 2 && l.depth_observers > 0;
    assert!(
        map.view
            .landmarks()
            .filter(|(_, l)| observed_often(l))
            .count()
            > 10
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_map_comes_back_bit_for_bit_and_gives_the_same_bytes(seed: u64, features in 1u32..40, changes in 0u32..400) {
        let map = random_map(seed, features, changes);
        prop_assert_eq!(map.check(), Ok(()));
        let bytes = map.to_bytes(&extensions()).unwrap();
        let back = MapFile::from_bytes(&bytes).unwrap();
        prop_assert_eq!(words(&back.map), words(&map));
        prop_assert_eq!(&back.extensions, &extensions());
        prop_assert_eq!(back.map.to_bytes(&back.extensions).unwrap(), bytes);
    }

    #[test]
    fn loops_come_back_bit_for_bit_and_change_nothing_else(seed: u64, changes in 0u32..400) {
        let map = looped_map(seed, 6, changes);
        prop_assert_eq!(map.check(), Ok(()));
        let bytes = map.to_bytes(&extensions()).unwrap();
        let back = MapFile::from_bytes(&bytes).unwrap();
        prop_assert_eq!(words(&back.map), words(&map));
        prop_assert_eq!(&back.extensions, &extensions());
        prop_assert_eq!(back.map.to_bytes(&back.extensions).unwrap(), bytes);
        // A program that does not know loops sees the map that it knows, and one extension more.
        let plain = random_map(seed, 6, changes).to_bytes(&extensions()).unwrap();
        let mut raw = taken_apart(&map.to_bytes(&extensions()).unwrap());
        raw.retain(|section| section.1 != loops::NAME);
        prop_assert_eq!(raw, taken_apart(&plain));
    }

    #[test]
    fn what_is_done_to_a_loaded_map_is_what_would_have_been_done(seed: u64) {
        let mut map = random_map(seed, 12, 200);
        let mut back = Map::from_bytes(&map.to_bytes(&[]).unwrap()).unwrap();
        for map in [&mut map, &mut back] {
            let ids: Vec<KeyframeId> = map.view.keyframes().map(|k| k.id).collect();
            let next = map.view.keyframes.len() as u32;
            map.insert_keyframe(KeyframeId(next + 300), data(&mut Random(1), 12, 0.0), Se3::identity(), ids.first().copied());
            for id in ids {
                map.refresh_covisibility(id, 1);
                map.cull_keyframe(id);
            }
            for i in 0..map.view.landmark_bound() as u32 {
                map.merge_landmarks(LandmarkId(i), LandmarkId(i / 2));
            }
        }
        prop_assert_eq!(back.check(), Ok(()));
        prop_assert_eq!(words(&back), words(&map));
    }

    #[test]
    fn no_bit_can_change_unseen(seed: u64, at: prop::sample::Index, flip in 1u8..) {
        let mut bytes = random_map(seed % 4, 12, 150).to_bytes(&extensions()).unwrap();
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        let e = MapFile::from_bytes(&bytes).unwrap_err();
        prop_assert!(!matches!(e, MapFileError::Invalid { .. } | MapFileError::Unsound(_)) || at >= 28, "{} at {}", e, at);
    }

    #[test]
    fn files_without_their_end_and_with_more_are_refused(seed in 0u64..4, at: prop::sample::Index, more in 1usize..9) {
        let mut bytes = random_map(seed, 12, 150).to_bytes(&[]).unwrap();
        let e = MapFile::from_bytes(&bytes[..at.index(bytes.len())]).unwrap_err();
        let is_length = matches!(e, MapFileError::Length { .. });
        prop_assert!(is_length, "{e}");
        let length = bytes.len();
        bytes.resize(length + more, 0);
        let e = MapFile::from_bytes(&bytes).unwrap_err();
        prop_assert_eq!(e, MapFileError::Length { expected: length as u64, found: (length + more) as u64 });
    }

    #[test]
    fn other_bytes_are_refused(mut bytes in prop::collection::vec(any::<u8>(), 0..400), as_map: bool) {
        if as_map && bytes.len() >= 32 {
            bytes[..8].copy_from_slice(&container::MAGIC);
            let checksum = crc32fast::hash(&bytes[..24]);
            bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
        }
        prop_assert!(MapFile::from_bytes(&bytes).is_err());
    }
}

#[test]
fn a_file_that_ends_anywhere_is_refused() {
    let bytes = random_map(3, 2, 60).to_bytes(&extensions()[1..]).unwrap();
    assert!(bytes.len() > 1000, "{} bytes", bytes.len());
    assert_eq!(
        MapFile::length(&bytes[..MapFile::HEADER_BYTES]),
        Ok(bytes.len() as u64)
    );
    for length in 0..bytes.len() {
        let e = MapFile::from_bytes(&bytes[..length]).unwrap_err();
        assert!(matches!(e, MapFileError::Length { .. }), "{length}: {e}");
    }
}

#[test]
fn no_single_bit_can_change_unseen() {
    let mut bytes = random_map(3, 2, 60).to_bytes(&extensions()[1..2]).unwrap();
    for at in 0..bytes.len() {
        for bit in 0..8 {
            bytes[at] ^= 1 << bit;
            assert!(
                MapFile::from_bytes(&bytes).is_err(),
                "bit {bit} of byte {at}"
            );
            bytes[at] ^= 1 << bit;
        }
    }
    assert!(MapFile::from_bytes(&bytes).is_ok());
}

/// A section, taken out to be changed.
type Raw = (Kind, String, Vec<u8>);

fn taken_apart(bytes: &[u8]) -> Vec<Raw> {
    let (_, sections) = container::read(bytes).unwrap();
    let raw =
        |s: &container::Stored<'_>| (s.kind, s.name.to_owned(), s.bytes().unwrap().into_owned());
    sections.iter().map(raw).collect()
}

/// The sections with checksums that are right.
fn sealed(raw: &[Raw], compress: bool) -> Vec<u8> {
    let section = |(kind, name, bytes): &'_ Raw| -> Section<'static> {
        let part = Part::ALL.iter().find(|p| p.name() == name);
        Section {
            kind: *kind,
            name: Box::leak(name.clone().into_boxed_str()),
            bytes: Cow::Owned(bytes.clone()),
            compress: compress && part.is_none_or(|p| p.may_compress()),
        }
    };
    container::write(&raw.iter().map(section).collect::<Vec<_>>())
}

#[derive(Clone, Debug)]
enum Damage {
    /// Another byte.
    Byte(u8),
    /// Another number of 32 bits, aligned.
    Number(u32),
    /// Another number of 64 bits, aligned.
    Long(u64),
    Remove(u8),
    Insert(u8),
    /// The section of another place.
    Swap(prop::sample::Index),
    /// The same section again.
    Again,
    Drop,
}

fn damage() -> impl Strategy<Value = Damage> {
    let odd = prop_oneof![
        any::<u32>(),
        0u32..40,
        Just(u32::MAX),
        Just(u32::MAX - 1),
        Just(1 << 24),
        Just(f32::NAN.to_bits()),
        Just(f32::INFINITY.to_bits()),
        Just((-1f32).to_bits()),
    ];
    let odd_long = prop_oneof![
        any::<u64>(),
        Just(u64::MAX),
        Just(f64::NAN.to_bits()),
        Just(1e300f64.to_bits()),
    ];
    prop_oneof![
        6 => any::<u8>().prop_map(Damage::Byte),
        6 => odd.prop_map(Damage::Number),
        3 => odd_long.prop_map(Damage::Long),
        1 => any::<u8>().prop_map(Damage::Remove),
        1 => any::<u8>().prop_map(Damage::Insert),
        1 => any::<prop::sample::Index>().prop_map(Damage::Swap),
        1 => Just(Damage::Again),
        1 => Just(Damage::Drop),
    ]
}

fn inflict(raw: &mut Vec<Raw>, section: usize, at: prop::sample::Index, damage: &Damage) {
    let bytes = &mut raw[section].2;
    let len = bytes.len();
    let mut put = |at: usize, new: &[u8]| {
        for (byte, new) in bytes.iter_mut().skip(at).zip(new) {
            *byte = *new;
        }
    };
    match damage {
        Damage::Byte(b) => put(at.index(len + 1), &[*b]),
        Damage::Number(n) => put(at.index(len / 4 + 1) * 4, &n.to_le_bytes()),
        Damage::Long(n) => put(at.index(len / 8 + 1) * 8, &n.to_le_bytes()),
        Damage::Remove(n) => bytes.truncate(len - usize::from(*n).min(len)),
        Damage::Insert(n) => bytes.resize(len + usize::from(*n), 0),
        Damage::Swap(other) => {
            let other = other.index(raw.len());
            let name = raw[section].1.clone();
            raw.swap(section, other);
            raw[section].1 = name;
        }
        Damage::Again => raw.insert(section, raw[section].clone()),
        Damage::Drop => drop(raw.remove(section)),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// Behind the checksums: whatever the content of the sections, it is refused, or is a map that is sound and that
    /// comes back as it is.
    #[test]
    fn damage_behind_the_checksums_is_seen_or_harmless(
        seed in 0u64..4,
        compress: bool,
        all in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), damage()), 1..4),
    ) {
        let bytes = random_map(seed, 6, 150).to_bytes(&extensions()[..1]).unwrap();
        let mut raw = taken_apart(&bytes);
        for (section, at, damage) in &all {
            let section = section.index(raw.len());
            inflict(&mut raw, section, *at, damage);
        }
        match MapFile::from_bytes(&sealed(&raw, compress)) {
            Err(e) => {
                let is_about_content = matches!(e, MapFileError::Invalid { .. } | MapFileError::Unsound(_));
                prop_assert!(is_about_content, "{e}");
            }
            Ok(file) => {
                prop_assert_eq!(file.map.check(), Ok(()));
                let again = file.map.to_bytes(&file.extensions).unwrap();
                let back = MapFile::from_bytes(&again).unwrap();
                prop_assert_eq!(words(&back.map), words(&file.map));
            }
        }
    }

    #[test]
    fn packed_bytes_come_back_and_damaged_ones_do_no_harm(
        mut raw in prop::collection::vec(0u8..6, 0..3000), repeat in 1usize..150, at: prop::sample::Index, flip: u8,
    ) {
        raw = raw.repeat(repeat);
        if let Some(mut packed) = blocks::pack(&raw) {
            prop_assert!(packed.len() < raw.len() && raw.len() <= 32 * packed.len());
            prop_assert_eq!(&blocks::unpack("x", &packed, raw.len() as u64).unwrap(), &raw);
            let at = at.index(packed.len());
            packed[at] ^= flip;
            if let Ok(other) = blocks::unpack("x", &packed, raw.len() as u64) {
                prop_assert_eq!(other.len(), raw.len());
            }
            prop_assert!(blocks::unpack("x", &packed, 32 * packed.len() as u64 + 1).is_err());
            prop_assert!(blocks::unpack("x", &packed, u64::MAX).is_err());
        }
    }
}

/// Blocks of noise are not compressed, and nothing is taken for noise that is none.
#[test]
fn noise_is_stored_and_everything_else_shrinks() {
    let random = &mut Random(1);
    let noise: Vec<u8> = (0..300_000).map(|_| random.bits() as u8).collect();
    assert_eq!(blocks::pack(&noise), None);
    let few: Vec<u8> = noise.iter().map(|b| b & 0x3f).collect();
    let packed = blocks::pack(&few).unwrap();
    assert!(packed.len() < 240_000, "{} bytes", packed.len());
    assert_eq!(blocks::unpack("x", &packed, 300_000).unwrap(), few);
    // A block of noise after one of zeros, or of the low bytes of counted ids, of which all are as frequent as in noise.
    for first in [&|_| 0, &|i| i as u8] as [&dyn Fn(u32) -> u8; 2] {
        let mut raw: Vec<u8> = (0..1 << 17).map(first).collect();
        raw.extend(&noise[..1 << 17]);
        let packed = blocks::pack(&raw).unwrap();
        let length = packed.len();
        assert!((1 << 17..(1 << 17) + 2000).contains(&length), "{length}");
        assert_eq!(blocks::unpack("x", &packed, 1 << 18).unwrap(), raw);
    }
}

/// What reading the sections of a map says after `change`.
fn refusal(change: impl FnOnce(&mut Vec<Raw>)) -> String {
    let mut raw = taken_apart(&random_map(3, 6, 300).to_bytes(&[]).unwrap());
    change(&mut raw);
    match MapFile::from_bytes(&sealed(&raw, true)) {
        Err(e) => e.to_string(),
        // Without showing the whole map.
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
fn every_kind_of_nonsense_has_its_message() {
    let nan = f64::NAN.to_le_bytes();
    // In the records of keyframes: id, parent, camera, features, stamp, quaternion, translation, submap.
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
    // Its own parent.
    let own = |r: &mut Vec<Raw>| {
        let id = r[Part::Keyframes as usize].2[..4].to_vec();
        put(r, Part::Keyframes, 4, &id);
    };
    check(own, &["parent"]);
    check(
        |r| put(r, Part::Keyframes, 12, &[200]),
        &["features, as the header says"],
    );
    check(|r| put(r, Part::Cameras, 0, &[0, 0]), &["images of 1 to"]);
    check(|r| put(r, Part::Cameras, 8, &nan), &["focal"]);
    // A tombstone that hangs on itself.
    let own = |r: &mut Vec<Raw>| {
        let id = r[Part::Tombstones as usize].2[..4].to_vec();
        put(r, Part::Tombstones, 4, &id);
    };
    check(own, &["tombstone", "does not hold"]);
    // Counts that the sections do not have: version, features, cameras, slots, keyframes, tombstones, pairs, landmark slots, landmarks.
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
    // All observations gone.
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
fn merges_that_go_round_are_refused() {
    let mut map = random_map(3, 6, 300);
    for (from, into) in [(0, 1), (1, 2), (2, 0)] {
        map.cull_landmark(LandmarkId(from));
        *map.view.landmarks.get_mut(from as usize).unwrap() =
            LandmarkSlot::Merged(LandmarkId(into));
    }
    let e = map.to_bytes(&[]).unwrap_err();
    assert!(e.to_string().contains("come to an end"), "{e}");
}

#[test]
fn a_map_that_could_not_be_read_is_not_written() {
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
}

#[test]
fn loops_that_were_not_measured_are_refused() {
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
        // Two ids, a quaternion, a translation, 21 elements of a matrix, a count.
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

#[test]
fn extensions_need_names_of_their_own() {
    let map = Map::new(8, 1.2);
    let extension = |name: &str| Extension {
        name: name.into(),
        bytes: vec![1, 2],
    };
    for names in [&["a", "b", "a"][..], &[""], &["x".repeat(256).as_str()]] {
        let extensions: Vec<Extension> = names.iter().map(|n| extension(n)).collect();
        let e = map.to_bytes(&extensions).unwrap_err();
        assert!(e.to_string().contains("each once"), "{e}");
    }
    let bytes = map.to_bytes(&[extension(&"x".repeat(255))]).unwrap();
    let file = MapFile::from_bytes(&bytes).unwrap();
    assert_eq!(file.extension(&"x".repeat(255)), Some(&[1, 2][..]));
    assert_eq!(file.extension("y"), None);
}

#[test]
fn later_versions_and_other_files_are_named() {
    let mut bytes = Map::new(8, 1.2).to_bytes(&[]).unwrap();
    bytes[8] = 2;
    let e = MapFile::from_bytes(&bytes).unwrap_err();
    assert!(matches!(e, MapFileError::Checksum { .. }), "{e}");
    let checksum = crc32fast::hash(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    let expected = MapFileError::Newer {
        found: 2,
        supported: 1,
    };
    assert_eq!(MapFile::from_bytes(&bytes).unwrap_err(), expected);
    for other in [
        &b"\x89PNG\r\n\x1a\nand more, as images have it"[..],
        b"ply\n",
    ] {
        let e = MapFile::from_bytes(other).unwrap_err();
        assert!(matches!(e, MapFileError::Foreign { .. }), "{e}");
        assert!(e.to_string().contains("--save-map"), "{e}");
    }
    // Sent as text, with line ends changed.
    let bytes = Map::new(8, 1.2).to_bytes(&[]).unwrap();
    let text: Vec<u8> = bytes.into_iter().filter(|b| *b != b'\r').collect();
    let e = MapFile::from_bytes(&text).unwrap_err();
    assert!(matches!(e, MapFileError::Foreign { .. }), "{e}");
    let e = MapFile::from_bytes(&[]).unwrap_err();
    assert!(e.to_string().contains("its end is missing"), "{e}");
}

/// A file of version 1, as it was first written. Whatever changes, it must be read, as the same map.
const GOLDEN: &[u8] = include_bytes!("../../tests/data/map-v1.spmap");

#[test]
fn the_first_file_of_version_1_can_be_read() {
    let file = MapFile::from_bytes(GOLDEN).unwrap();
    assert_eq!(words(&file.map), words(&random_map(7, 12, 400)));
    assert_eq!(file.extensions, extensions());
    assert_eq!(file.format, 1);
}

/// For the first file of a later version; that of version 1 stays.
#[test]
#[ignore = "writes a golden file"]
#[allow(clippy::disallowed_methods)] // A tool to make test data.
fn write_a_golden_file() {
    let bytes = random_map(7, 12, 400).to_bytes(&extensions()).unwrap();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let name = format!("map-v{}.spmap", container::VERSION);
    std::fs::write(folder.join(name), bytes).unwrap();
}

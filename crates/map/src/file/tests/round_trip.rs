//! Maps round-trip through files.

use super::made::{Random, data, extensions, looped_map, random_map, words};
use super::taken_apart;
use crate::file::{Extension, MapFile, loops};
use crate::{KeyframeId, LandmarkId, Map};
use proptest::prelude::*;
use stillpoint_geometry::Se3;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn map_round_trips_bit_for_bit(seed: u64, features in 1u32..40, changes in 0u32..400) {
        let map = random_map(seed, features, changes);
        prop_assert_eq!(map.check(), Ok(()));
        let bytes = map.to_bytes(&extensions()).unwrap();
        let back = MapFile::from_bytes(&bytes).unwrap();
        prop_assert_eq!(words(&back.map), words(&map));
        prop_assert_eq!(&back.extensions, &extensions());
        prop_assert_eq!(back.map.to_bytes(&back.extensions).unwrap(), bytes);
    }

    #[test]
    fn loops_round_trip_in_a_separate_extension(seed: u64, changes in 0u32..400) {
        let map = looped_map(seed, 6, changes);
        prop_assert_eq!(map.check(), Ok(()));
        let bytes = map.to_bytes(&extensions()).unwrap();
        let back = MapFile::from_bytes(&bytes).unwrap();
        prop_assert_eq!(words(&back.map), words(&map));
        prop_assert_eq!(&back.extensions, &extensions());
        prop_assert_eq!(back.map.to_bytes(&back.extensions).unwrap(), bytes);
        // A program without knowledge of loops sees the plain map and one more extension.
        let plain = random_map(seed, 6, changes).to_bytes(&extensions()).unwrap();
        let mut raw = taken_apart(&map.to_bytes(&extensions()).unwrap());
        raw.retain(|section| section.1 != loops::NAME);
        prop_assert_eq!(raw, taken_apart(&plain));
    }

    #[test]
    fn loaded_map_behaves_like_the_original(seed: u64) {
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
                map.merge_landmarks(LandmarkId::new(i), LandmarkId::new(i / 2));
            }
        }
        prop_assert_eq!(back.check(), Ok(()));
        prop_assert_eq!(words(&back), words(&map));
    }
}

#[test]
fn extensions_need_unique_valid_names() {
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

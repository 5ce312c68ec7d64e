//! Serialised dense maps: round trips, and errors.

use crate::room::{config, simulator};
use proptest::prelude::*;
use std::sync::OnceLock;
use stillpoint_dense::{DenseBytesError, DenseMap, Fuser};
use stillpoint_imaging::Simd;

fn map() -> &'static DenseMap {
    static MAP: OnceLock<DenseMap> = OnceLock::new();
    MAP.get_or_init(|| {
        let room = simulator("xyz", 2);
        let mut fuser = Fuser::new(&config(), room.camera(), Simd::detect()).unwrap();
        for i in 0..2 {
            let pose = room.world_from_camera(room.depth_stamp(i));
            fuser.add(&room.frame(i), &[], &pose);
        }
        fuser.map().clone()
    })
}

fn read(bytes: &[u8]) -> Result<DenseMap, DenseBytesError> {
    DenseMap::from_bytes(bytes, Simd::detect())
}

#[test]
fn dense_map_round_trips_through_bytes() {
    let bytes = map().to_bytes();
    let back = read(&bytes).unwrap();
    assert_eq!(
        (back.digest(), back.blocks()),
        (map().digest(), map().blocks())
    );
    assert_eq!(back.to_bytes(), bytes);
}

#[test]
fn damaged_maps_are_refused_with_a_reason() {
    let bytes = map().to_bytes();
    let said = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes.clone();
        change(&mut bytes);
        read(&bytes).err().unwrap().to_string()
    };
    for (expected, found) in [
        ("found other bytes", said(&|b| b[0] = b'X')),
        ("found other bytes", said(&|b| b.truncate(20))),
        ("bytes, found", said(&|b| b.truncate(b.len() - 1))),
        ("bytes, found", said(&|b| b.push(0))),
        ("bytes, found", said(&|b| b[40..48].fill(0xff))),
        ("voxel: expected", said(&|b| b[8..16].fill(0xff))),
        ("a truncation of", said(&|b| b[16] ^= 1)),
        (
            "out of order",
            said(&|b| b.copy_within(48 + 4108..48 + 4120, 48)),
        ),
    ] {
        assert!(
            found.contains(expected) && found.starts_with("expected"),
            "{found}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn changed_bytes_are_read_or_refused(at in any::<prop::sample::Index>(), value in any::<u8>(), head in any::<bool>()) {
        let mut bytes = map().to_bytes();
        let at = at.index(if head { 64 } else { bytes.len() });
        bytes[at] = value;
        if let Ok(map) = read(&bytes) {
            prop_assert_eq!(map.to_bytes(), bytes);
        }
    }
}

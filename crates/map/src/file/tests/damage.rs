//! Damage anywhere in a file is detected or harmless.

use super::made::{Random, extensions, random_map, words};
use super::{Raw, sealed, taken_apart};
use crate::file::{MapFile, MapFileError, blocks, container};
use proptest::prelude::*;

proptest! {
    #[test]
    fn any_changed_byte_is_detected(seed: u64, at: prop::sample::Index, flip in 1u8..) {
        let mut bytes = random_map(seed % 4, 12, 150).to_bytes(&extensions()).unwrap();
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        let e = MapFile::from_bytes(&bytes).unwrap_err();
        prop_assert!(!matches!(e, MapFileError::Invalid { .. } | MapFileError::Unsound(_)) || at >= 28, "{} at {}", e, at);
    }

    #[test]
    fn truncated_or_extended_files_are_refused(seed in 0u64..4, at: prop::sample::Index, more in 1usize..9) {
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
    fn arbitrary_bytes_are_refused(mut bytes in prop::collection::vec(any::<u8>(), 0..400), as_map: bool) {
        if as_map && bytes.len() >= 32 {
            bytes[..8].copy_from_slice(&container::MAGIC);
            let checksum = crc32fast::hash(&bytes[..24]);
            bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
        }
        prop_assert!(MapFile::from_bytes(&bytes).is_err());
    }
}

#[test]
fn file_truncated_at_any_length_is_refused() {
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
fn every_single_bit_flip_is_detected() {
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

#[derive(Clone, Debug)]
enum Damage {
    Byte(u8),
    /// Aligned.
    Number(u32),
    /// Aligned.
    Long(u64),
    Remove(u8),
    Insert(u8),
    Swap(prop::sample::Index),
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

    /// With valid checksums but arbitrary content, a file is rejected, or is a sound map that round-trips.
    #[test]
    fn damage_with_valid_checksums_is_refused_or_harmless(
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
    fn packed_blocks_round_trip_and_damage_is_harmless(
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

/// Noise is not compressed, and compressible data is not mistaken for noise.
#[test]
fn noise_is_stored_and_other_data_is_compressed() {
    let random = &mut Random(1);
    let noise: Vec<u8> = (0..300_000).map(|_| random.bits() as u8).collect();
    assert_eq!(blocks::pack(&noise), None);
    let few: Vec<u8> = noise.iter().map(|b| b & 0x3f).collect();
    let packed = blocks::pack(&few).unwrap();
    assert!(packed.len() < 240_000, "{} bytes", packed.len());
    assert_eq!(blocks::unpack("x", &packed, 300_000).unwrap(), few);
    // A block of noise after zeros, or after the low bytes of consecutive ids, which are uniformly distributed too.
    for first in [&|_| 0, &|i| i as u8] as [&dyn Fn(u32) -> u8; 2] {
        let mut raw: Vec<u8> = (0..1 << 17).map(first).collect();
        raw.extend(&noise[..1 << 17]);
        let packed = blocks::pack(&raw).unwrap();
        let length = packed.len();
        assert!((1 << 17..(1 << 17) + 2000).contains(&length), "{length}");
        assert_eq!(blocks::unpack("x", &packed, 1 << 18).unwrap(), raw);
    }
}

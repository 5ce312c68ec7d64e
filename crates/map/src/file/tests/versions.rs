//! Files of other versions and of other programs, and the first file of version 1.

use super::made::{extensions, random_map, words};
use crate::Map;
use crate::file::{MapFile, MapFileError, container};

#[test]
fn newer_versions_and_foreign_files_are_reported() {
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
    // Transferred as text, with line ends changed.
    let bytes = Map::new(8, 1.2).to_bytes(&[]).unwrap();
    let text: Vec<u8> = bytes.into_iter().filter(|b| *b != b'\r').collect();
    let e = MapFile::from_bytes(&text).unwrap_err();
    assert!(matches!(e, MapFileError::Foreign { .. }), "{e}");
    let e = MapFile::from_bytes(&[]).unwrap_err();
    assert!(e.to_string().contains("its end is missing"), "{e}");
}

/// The first file of version 1. It must stay readable, as the same map.
const GOLDEN: &[u8] = include_bytes!("../../../tests/data/map-v1.spmap");

#[test]
fn first_version_1_file_can_be_read() {
    let file = MapFile::from_bytes(GOLDEN).unwrap();
    assert_eq!(words(&file.map), words(&random_map(7, 12, 400)));
    assert_eq!(file.extensions, extensions());
    assert_eq!(file.format, 1);
}

/// Creates the first file of a later version; that of version 1 stays.
#[test]
#[ignore = "writes a golden file"]
#[allow(clippy::disallowed_methods)] // A tool to make test data.
fn write_a_golden_file() {
    let bytes = random_map(7, 12, 400).to_bytes(&extensions()).unwrap();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let name = format!("map-v{}.spmap", container::VERSION);
    std::fs::write(folder.join(name), bytes).unwrap();
}

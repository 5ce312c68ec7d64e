//! Files of other versions and of other programs, and the first file of each version.

use super::made::{extensions, random_map, words};
use crate::Map;
use crate::file::{MapFile, MapFileError, container};

#[test]
fn newer_versions_and_foreign_files_are_reported() {
    let mut bytes = Map::new(8, 1.2).to_bytes(&[]).unwrap();
    bytes[8] = 3;
    let e = MapFile::from_bytes(&bytes).unwrap_err();
    assert!(matches!(e, MapFileError::Checksum { .. }), "{e}");
    let checksum = crc32fast::hash(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    let expected = MapFileError::Newer {
        found: 3,
        supported: 2,
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

/// The first file of each version. They must stay readable, as the same map.
const GOLDEN: [&[u8]; 2] = [
    include_bytes!("../../../tests/data/map-v1.spmap"),
    include_bytes!("../../../tests/data/map-v2.spmap"),
];

#[test]
fn first_file_of_each_version_can_be_read() {
    let all = words(&random_map(7, 12, 400));
    let bare = without_edges(&all);
    assert!(bare.len() < all.len());
    for (golden, version) in GOLDEN.into_iter().zip(1..) {
        let file = MapFile::from_bytes(golden).unwrap();
        let expected = if version == 1 { &bare } else { &all };
        assert_eq!(&words(&file.map), expected);
        assert_eq!(file.extensions, extensions());
        assert_eq!(file.format, version);
    }
}

/// The words of the same map where no keypoint has an edge.
fn without_edges(words: &str) -> String {
    let mut parts = words.split("Edge([");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |bare, part| {
        let rest = part.split_once(']').map_or(part, |(_, rest)| rest);
        bare + "Edge([0, 0]" + rest
    })
}

/// Creates the first file of a later version; those of earlier ones stay.
#[test]
#[ignore = "writes a golden file"]
#[allow(clippy::disallowed_methods)] // A tool to make test data.
fn write_a_golden_file() {
    let bytes = random_map(7, 12, 400).to_bytes(&extensions()).unwrap();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let name = format!("map-v{}.spmap", container::VERSION);
    std::fs::write(folder.join(name), bytes).unwrap();
}

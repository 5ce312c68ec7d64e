//! Broken files give errors, never panics.
#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod common;

use common::{Folder, depth, gray};
use image::ImageFormat;
use proptest::prelude::*;
use stillpoint_datasets::{Dataset, OpenOptions, read_colour, read_depth, read_gray};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn mutated_images_never_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(), kind in 0usize..4
    ) {
        let f = Folder::empty("x");
        let name = match kind {
            0 => "a.png",
            1 => "a.jpg",
            2 => "a.webp",
            _ => "depth.png",
        };
        f.image(name, &if kind == 3 { depth(7000) } else { gray(90) });
        let path = f.path.join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if cut.index(4) == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        f.bytes(name, &bytes);
        let _ = (read_gray(&path), read_colour(&path), read_depth(&path, 5000.0));
    }

    #[test]
    fn mutated_folders_never_panic(
        file in prop::sample::select(vec!["rgb.txt", "depth.txt", "camera.txt", "groundtruth.txt"]),
        at in any::<prop::sample::Index>(), bytes in proptest::collection::vec(any::<u8>(), 0..8)
    ) {
        let f = Folder::tum("x", 2);
        f.text("groundtruth.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n");
        let mut text = std::fs::read(f.path.join(file)).unwrap();
        let at = at.index(text.len());
        let end = text.len().min(at + bytes.len());
        text.splice(at..end, bytes);
        f.bytes(file, &text);
        if let Ok(d) = Dataset::open(&f.path, &OpenOptions::default()) {
            let _ = d.ground_truth();
        }
    }
}

#[test]
fn formats_are_told_by_content_not_by_name() {
    let f = Folder::empty("x");
    std::fs::create_dir_all(&f.path).unwrap();
    f.image_as("a.png", &gray(50), ImageFormat::Jpeg);
    let g = read_gray(&f.path.join("a.png")).unwrap();
    assert!(g.at(0, 0).abs_diff(50) <= 1);
}

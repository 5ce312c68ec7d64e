//! Extraction on real frames, if available.
// Tests may read environment variables; the library may not.
#![allow(clippy::disallowed_methods, clippy::print_stderr)]

use std::path::PathBuf;

use stillpoint_features::{Features, OrbConfig, OrbExtractor, match_brute_force};
use stillpoint_imaging::{ColourImage, GrayImage, Simd};

fn frames() -> Vec<PathBuf> {
    let Some(folder) = stillpoint_testdata::recording("fr1_xyz") else {
        return Vec::new();
    };
    let entries = std::fs::read_dir(folder.join("rgb")).expect("a folder of images");
    let mut files: Vec<_> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    files.sort();
    files
}

fn load(path: &PathBuf) -> GrayImage {
    let decoded = image::open(path).expect("a readable frame").to_rgb8();
    let size = (decoded.width() as usize, decoded.height() as usize);
    let colour = ColourImage::from_vec(size.0, size.1, decoded.into_raw());
    colour.expect("three bytes per pixel").to_gray()
}

#[test]
fn recorded_frames_extract_equally_and_match_neighbours() {
    let frames = frames();
    let mut portable = OrbExtractor::new(&OrbConfig::default(), Simd::Scalar);
    let mut vector = OrbExtractor::new(&OrbConfig::default(), Simd::detect());
    let (mut first, mut second, mut check) = <(Features, Features, Features)>::default();
    for pair in frames.windows(2).step_by(40) {
        vector.extract(&load(&pair[0]), &mut first);
        vector.extract(&load(&pair[1]), &mut second);
        portable.extract(&load(&pair[1]), &mut check);
        assert_eq!(second, check, "{}", pair[1].display());
        assert!(
            (900..=1100).contains(&first.len()),
            "{} features",
            first.len()
        );
        let found = match_brute_force(&first.descriptors, &second.descriptors, 50, 0.9);
        let matched = found.iter().flatten().count();
        assert!(matched > 150, "{}: {matched} matches", pair[0].display());
    }
}

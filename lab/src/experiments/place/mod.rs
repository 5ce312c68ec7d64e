//! Trains the vocabulary that is embedded in the crate.
//!
//! Run: `cargo run --release -p stillpoint-place --example train_vocabulary [FILE [rooms|both]]`. Writes `data/vocabulary.bin` of the crate, or FILE.
//!
//! The images: every 4th of the recording `fr1_xyz` and every 12th of `corridor_fixed`, which are looked for in the folder of the environment variable
//! STILLPOINT_DATA, else in ../shared/data. Instead of them, or beside them, simulated rooms of seeds from 1000 on. `compare` tests on another recording and on
//! rooms of other seeds, so what is embedded has seen nothing of what it is tested on.
#![allow(clippy::print_stdout, clippy::disallowed_methods)] // A program that prints and writes a file.

#[path = "../common/mod.rs"]
mod common;

use common::train::{Shape, train};
use std::error::Error;
use stillpoint_features::Descriptor;

/// 4680 centres of 32 bytes, 4096 of which are words. Features are paired within 512 groups of 8 words.
const SHAPE: Shape = Shape {
    branching: 8,
    levels: 4,
    match_level: 3,
};

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1);
    let what = std::env::args().nth(2).unwrap_or_default();
    let (recordings, rooms) = match what.as_str() {
        "" => (true, false),
        "rooms" => (false, true),
        "both" => (true, true),
        found => return Err(format!("expected rooms or both, found {found:?}").into()),
    };
    let images = common::train::images(recordings, rooms)?;
    if images.is_empty() {
        return Err(format!("found no recordings in {}", common::data_folder().display()).into());
    }
    let images: Vec<&[Descriptor]> = images.iter().map(Vec::as_slice).collect();
    let bytes = train(&images, SHAPE, 1);
    let embedded = concat!(env!("CARGO_MANIFEST_DIR"), "/data/vocabulary.bin");
    let file = file.unwrap_or_else(|| embedded.to_owned());
    std::fs::write(&file, &bytes)?;
    println!(
        "{} images, {} descriptors; {} bytes in {file}",
        images.len(),
        images.iter().map(|i| i.len()).sum::<usize>(),
        bytes.len()
    );
    Ok(())
}

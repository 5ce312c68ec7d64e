//! Trains the vocabulary that is embedded in the crate.
//!
//! Run: `cargo run --release -p stillpoint-place --example train_vocabulary [FILE [recordings|rooms]]`. Writes `data/vocabulary.bin` of the crate, or FILE, from
//! all images or from one half of them. A minute or two.
//!
//! The images: simulated rooms of seeds from 1000 on, and the recordings `fr1_xyz` and `corridor_fixed`, which are looked for in the folder of the environment
//! variable STILLPOINT_DATA, else in ../shared/data. `compare` tests on other rooms and another recording.
#![allow(clippy::print_stdout, clippy::disallowed_methods)] // A program that prints and writes a file.

#[path = "../common/mod.rs"]
mod common;

use common::train::{Shape, train};
use std::error::Error;
use stillpoint_features::Descriptor;

/// 7380 words centres of 32 bytes.
const SHAPE: Shape = Shape {
    branching: 8,
    levels: 4,
    match_level: 3,
};

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1);
    let only = std::env::args().nth(2).unwrap_or_default();
    if !["", "recordings", "rooms"].contains(&only.as_str()) {
        return Err(format!("expected recordings or rooms, found {only:?}").into());
    }
    let images = common::train::images(only != "rooms", only != "recordings")?;
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

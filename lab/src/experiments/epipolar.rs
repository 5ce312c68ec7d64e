//! How far features of a scene lie from their epipolar lines: the distance D of preset `paper`, whose threshold is 1 px. In a static scene all of it is noise.
//!
//! `cargo run --release -p stillpoint --example epipolar -- PATH...`: a row per data set folder or recording, of its first 300 frames, without a detector.
#![allow(clippy::print_stdout)]

use std::path::Path;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::slam::{Config, FilterParts, Preset, System};

type Failure = Box<dyn std::error::Error>;

const FRAMES: usize = 300;
/// Quantiles that are told.
const SHARES: [f64; 5] = [0.5, 0.75, 0.9, 0.95, 0.99];

fn main() -> Result<(), Failure> {
    println!("| input | features with D | 50 % | 75 % | 90 % | 95 % | 99 % | from 1 px on |");
    println!("|---|---:|---:|---:|---:|---:|---:|---:|");
    for path in std::env::args().skip(1) {
        let mut all = distances(Path::new(&path))?;
        all.sort_by(f32::total_cmp);
        if all.is_empty() {
            println!("| {path} | 0 | - | - | - | - | - | - |");
            continue;
        }
        let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
        let quantiles = SHARES.map(|s| format!("{:.2}", at(s))).join(" | ");
        let above = all.len() - all.partition_point(|d| *d < 1.0);
        println!(
            "| {path} | {} | {quantiles} | {:.1} % |",
            all.len(),
            100.0 * above as f64 / all.len() as f64
        );
    }
    Ok(())
}

/// D of all features that have one, px, at most 4. Without boxes it is the risk that the preset gives a feature, and exactly 0 for those without a pair.
fn distances(path: &Path) -> Result<Vec<f32>, Failure> {
    let input = open(path, &OpenOptions::default())?;
    let mut config = Config::default();
    config.static_filter.preset = Preset::Paper;
    config.static_filter.parts = FilterParts::try_from("G".to_owned())?;
    let mut system = System::new(config, input.camera().camera, Simd::detect())?;
    let mut source = input.frames(&stillpoint::datasets::FrameOptions::default())?;
    let (mut found, mut count) = (Vec::new(), 0);
    while let Some(frame) = source.next_frame().filter(|_| count < FRAMES) {
        let frame = match frame {
            Ok(frame) => frame,
            Err(e) if e.recoverable => continue,
            Err(e) => return Err(e.into()),
        };
        count += 1;
        for event in system.step(frame) {
            if let Some(frame) = event.as_frame() {
                let risks = frame.report.verdicts.iter().map(|v| v.risk);
                found.extend(risks.filter(|d| *d > 0.0));
            }
        }
    }
    Ok(found)
}

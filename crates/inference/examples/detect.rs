//! Runs a network over a recording and writes a script of its boxes, which `--detector scripted:FILE.csv` plays back:
//! `cargo run --release -p stillpoint-inference --example detect -- MODEL.onnx FOLDER OUT.csv [SCORE]`
//! A card beside the model, MODEL.toml, says how it is read; known models need none.
// A program may read files and the clock; the library may not.
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    clippy::print_stderr
)]

use std::path::Path;
use std::time::Instant;
use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions};
use stillpoint_detection::{Detector, ScriptRow, format_script};
use stillpoint_imaging::FrameSource;
use stillpoint_inference::{ModelCard, OnnxDetector, OnnxOptions, Runtime};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (model, folder, out, score) = match &arguments[..] {
        [model, folder, out] => (model, folder, out, None),
        [model, folder, out, score] => (model, folder, out, Some(score)),
        _ => return Err("expected MODEL.onnx FOLDER OUT.csv [SCORE]".into()),
    };
    let mut options = OnnxOptions::default();
    if let Some(score) = score {
        options.score_threshold = score.parse()?;
    }
    let beside = Path::new(model).with_extension("toml");
    let card = if beside.exists() {
        let text = std::fs::read_to_string(&beside)?;
        Some(ModelCard::parse(&beside.display().to_string(), &text)?)
    } else {
        None
    };
    let bytes = std::fs::read(model)?;
    let runtime = Runtime::default();
    let mut detector = OnnxDetector::with_card(bytes, model, card.as_ref(), &runtime, &options)?;
    let dataset = Dataset::open(Path::new(folder), &OpenOptions::default())?;
    let mut source = dataset.frames(&FrameOptions {
        keep_colour: true,
        ..FrameOptions::default()
    })?;
    let (mut rows, mut times) = (Vec::new(), Vec::new());
    while let Some(frame) = source.next_frame() {
        let frame = frame?;
        let start = Instant::now();
        let found = detector.detect(&frame)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
        rows.extend(found.items.iter().map(|&detection| ScriptRow {
            stamp: found.stamp,
            detection,
        }));
    }
    std::fs::write(out, format_script(&rows))?;
    times.sort_by(f64::total_cmp);
    let median = times.get(times.len() / 2).copied().unwrap_or_default();
    if let Some(remark) = detector.remark() {
        eprintln!("{remark}");
    }
    let (width, height) = detector.input_size();
    eprintln!(
        "{} at {width}x{height} px: {} frames, {} boxes, median {median:.1} ms per frame with {} thread(s)",
        detector.card().head,
        times.len(),
        rows.len(),
        options.threads
    );
    Ok(())
}

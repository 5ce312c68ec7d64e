//! Distances of features from their epipolar lines: D of preset `paper`, whose threshold is 1 px. In a static scene all of it is noise.
//!
//! A row per input, of its first 300 frames, without a detector.

use crate::Failure;
use crate::experiments::shared::next_readable;
use crate::table::{self, ABSENT, Table};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stillpoint::datasets::FrameOptions;
use stillpoint::imaging::Simd;
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::slam::{Config, Event, FilterParts, Preset, System};

/// Measures the distances of features from their epipolar lines
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Data set folders or recordings
    #[arg(required = true)]
    paths: Vec<PathBuf>,
}

const FRAMES: usize = 300;
const SHARES: [f64; 5] = [0.5, 0.75, 0.9, 0.95, 0.99];

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut header = vec!["input".to_owned(), "features with D".to_owned()];
    header.extend(SHARES.map(|s| format!("{:.0} %", 100.0 * s)));
    header.push("from 1 px on".to_owned());
    let mut table = Table::new(header);
    for path in &arguments.paths {
        let mut all = distances(path)?;
        all.sort_by(f32::total_cmp);
        let mut row = vec![path.display().to_string(), all.len().to_string()];
        if all.is_empty() {
            row.extend([(); SHARES.len() + 1].map(|()| ABSENT.to_owned()));
        } else {
            let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
            row.extend(SHARES.map(|share| format!("{:.2}", at(share))));
            let above = all.len() - all.partition_point(|d| *d < 1.0);
            row.push(format!("{:.1} %", 100.0 * above as f64 / all.len() as f64));
        }
        table.row(row);
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}

/// D of all features that have one, px, at most 4. Without boxes D equals the preset's risk, which is exactly 0 without a match.
fn distances(path: &Path) -> Result<Vec<f32>, Failure> {
    let input = open(path, &OpenOptions::default())?;
    let mut config = Config::default();
    config.static_filter.preset = Preset::Paper;
    config.static_filter.parts = FilterParts::try_from("G".to_owned())?;
    let mut system = System::new(config, input.camera().camera, Simd::detect())?;
    let mut source = input.frames(&FrameOptions::default())?;
    let mut found = Vec::new();
    for _ in 0..FRAMES {
        let Some(frame) = next_readable(&mut source)? else {
            break;
        };
        let events = system.step(frame);
        for done in events.iter().filter_map(Event::as_frame) {
            let risks = done.report.verdicts.iter().map(|v| v.risk);
            found.extend(risks.filter(|d| *d > 0.0));
        }
    }
    Ok(found)
}

//! Estimated readout time, and cost of the static filter in static scenes: simulated turns with known readout times.
//!
//! A row per scene and true readout time. The exit code is 1 if a bound is missed.

use crate::Failure;
use crate::experiments::shared::{ate_mm, code, each_seed, map_poses, truth, verdict};
use crate::table::{self, Align, Table, figure, median_and_range, spread};
use std::process::ExitCode;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Shutter, Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, Preset, System};

/// True readout times, s: a global shutter, and rolling ones.
const READOUTS: [f64; 3] = [0.0, 0.01, 0.02];
/// All turns of the simulator's rpy paths.
const SCENES: [&str; 4] = ["rpy", "rpy_60", "rpy_100", "rpy_150"];
/// Maximum error of the median estimated readout time, s.
const BIAS: f64 = 3e-3;
/// Maximum share of static features that the filter rejects.
const REJECTED: f64 = 0.02;
/// Maximum ratio of the errors with and without the filter.
const COST: f64 = 1.03;

/// Evaluates the estimated readout time of a rolling shutter, and the cost of the static filter in static scenes
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seeds per scene
    #[arg(long, default_value_t = 10)]
    seeds: u64,
    /// Frames per run
    #[arg(long, default_value_t = 150)]
    frames: usize,
    /// Simulated turns
    #[arg(default_values = SCENES)]
    scenes: Vec<String>,
}

/// A system, and its counts of examined and rejected features.
struct Contestant {
    system: System,
    features: f64,
    rejected: f64,
}

impl Contestant {
    fn new(simulator: &Simulator, preset: Preset) -> Result<Self, Failure> {
        let mut config = Config::default();
        config.static_filter.preset = preset;
        Ok(Self {
            system: System::new(config, *simulator.camera(), Simd::detect())?,
            features: 0.0,
            rejected: 0.0,
        })
    }
}

/// Results of a run, with the filter and without.
struct Row {
    /// Estimated, s.
    readout: [f64; 2],
    /// Standard deviation of the estimate, s.
    sigma: f64,
    /// ATE, mm.
    ate: [f64; 2],
    rejected: f64,
}

fn measure(scene: &str, seed: u64, frames: usize, readout: f64) -> Result<Row, Failure> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        frames: Some(frames),
        shutter: Some(Shutter {
            readout,
            depth_readout: 0.03,
            exposure: 0.01,
        }),
        ..SimulatorConfig::default()
    })?;
    let mut both = [
        Contestant::new(&simulator, Preset::Default)?,
        Contestant::new(&simulator, Preset::Off)?,
    ];
    for i in 0..simulator.len() {
        let frame = simulator.frame(i);
        for c in &mut both {
            let events = c.system.step(frame.clone());
            for done in events.iter().filter_map(Event::as_frame) {
                let counts = &done.report.counts;
                c.features += f64::from(counts.keypoints);
                c.rejected += f64::from(counts.dynamic);
            }
        }
    }
    let truth = truth(&simulator);
    let mut ate = [f64::NAN; 2];
    for (c, ate) in both.iter_mut().zip(&mut ate) {
        c.system.finish();
        *ate = ate_mm(&truth, &map_poses(&c.system))?;
    }
    let estimates = [&both[0], &both[1]].map(|c| c.system.timing());
    Ok(Row {
        readout: estimates.map(|r| r.readout),
        sigma: estimates[0].readout_sigma,
        ate,
        rejected: both[0].rejected / both[0].features.max(1.0),
    })
}

/// Returns whether the row's bounds hold.
fn add(table: &mut Table, scene: &str, readout: f64, rows: &[Row]) -> bool {
    let of = |f: &dyn Fn(&Row) -> f64| spread(rows.iter().map(f));
    let ms = |k: usize| median_and_range(rows.iter().map(|r| 1e3 * r.readout[k]), 1);
    let [estimated, ..] = of(&|r| r.readout[0]);
    let [rejected, ..] = of(&|r| r.rejected);
    let [cost, ..] = of(&|r| r.ate[0] / r.ate[1]);
    let missed = [
        ((estimated - readout).abs() > BIAS, "readout"),
        (rejected > REJECTED, "rejected"),
        (cost > COST, "ATE"),
    ];
    let missed: Vec<&str> = missed.iter().filter(|m| m.0).map(|m| m.1).collect();
    let said = match &missed[..] {
        [] => verdict(true).to_owned(),
        missed => format!("{}: {}", verdict(false), missed.join(", ")),
    };
    table.row([
        format!("`{scene}`"),
        figure(1e3 * readout, 0),
        ms(0),
        figure(1e3 * of(&|r| r.sigma)[0], 2),
        ms(1),
        figure(of(&|r| r.ate[0])[0], 2),
        figure(of(&|r| r.ate[1])[0], 2),
        figure(cost, 3),
        figure(100.0 * rejected, 2),
        said,
    ]);
    missed.is_empty()
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (seeds, frames) = (arguments.seeds, arguments.frames);
    println!(
        "{seeds} seeds, {frames} frames, depth's readout 30 ms, exposure 10 ms; readouts in ms: median (least to greatest)\n"
    );
    let mut table = Table::new("scene | readout | estimated, filter on | its sigma | filter off | ATE on, mm | off, mm | on / off | rejected, % | ".split(" | "))
    .align(9, Align::Left);
    let mut holds = true;
    for scene in &arguments.scenes {
        for readout in READOUTS {
            let rows = each_seed(seeds, |seed| measure(scene, seed, frames, readout))?;
            holds &= add(&mut table, scene, readout, &rows);
        }
    }
    table::print(&table);
    Ok(code(holds))
}

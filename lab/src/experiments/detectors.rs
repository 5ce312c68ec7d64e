//! Detection times: models x input sizes x runtimes x threads, with pre- and postprocessing separate. Medians over rounds in which all
//! cases take turns, so that other load affects all alike.
//!
//! A `MODEL.toml` beside a model is its card.

use crate::Failure;
use crate::experiments::shared::spans::{self, Spans};
use crate::origin::Machine;
use crate::table::{self, Align, Table, figure, spread};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use stillpoint::datasets::read_colour;
use stillpoint::detection::Detector;
use stillpoint::imaging::{ColourImage, FrameId};
use stillpoint::inference::{
    InputSize, ModelCard, OnnxDetector, OnnxOptions, OnnxRuntime, Runtime,
};

/// Measures detection times: models, input sizes, runtimes and threads
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Models in the ONNX format
    #[arg(required = true)]
    models: Vec<String>,
    /// Library of ONNX Runtime; without it, only rten is measured
    #[arg(long)]
    library: Option<PathBuf>,
    /// Input sizes
    #[arg(long, value_delimiter = ',', value_parser = size, default_value = "640x480,416x320,320x256")]
    sizes: Vec<(usize, usize)>,
    #[arg(long, value_delimiter = ',', default_value = "1,2")]
    threads: Vec<usize>,
    /// Rounds, after two for warming up
    #[arg(long, default_value_t = 40)]
    rounds: usize,
    /// Minimum score of a box; 0.6 for random weights, whose scores are all about 0.25
    #[arg(long, default_value_t = OnnxOptions::default().score_threshold)]
    score: f32,
    /// Camera image, PNG or JPEG [default: a pattern of 640x480 px]
    #[arg(long)]
    image: Option<PathBuf>,
}

struct Case {
    model: String,
    size: (usize, usize),
    threads: usize,
    detector: OnnxDetector,
    boxes: usize,
    /// Letterbox, network, and postprocessing, ms.
    times: [Vec<f64>; 3],
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    Spans::Clock.start()?;
    let mut runtimes = vec![Runtime::Rten];
    if let Some(library) = &arguments.library {
        runtimes.push(Runtime::OnnxRuntime(OnnxRuntime::load(library)?));
    }
    let image = match &arguments.image {
        Some(file) => read_colour(file)?,
        None => pattern(640, 480),
    };
    let mut cases = Vec::new();
    for model in &arguments.models {
        for &size in &arguments.sizes {
            for runtime in &runtimes {
                for &threads in &arguments.threads {
                    match Case::new(model, size, runtime, threads, arguments.score) {
                        Ok(case) => cases.push(case),
                        Err(error) => eprintln!("left out: {error}"),
                    }
                }
            }
        }
    }
    if cases.is_empty() {
        return Err("expected a model that can be timed, found none".into());
    }
    const WARM_UP: usize = 2;
    for round in 0..WARM_UP + arguments.rounds {
        eprintln!("round {} of {}", round + 1, WARM_UP + arguments.rounds);
        for case in &mut cases {
            case.run(&image, round >= WARM_UP)?;
        }
    }
    println!(
        "{}; image of {}x{} px; median of {} runs, ms\n",
        Machine::here(),
        image.width(),
        image.height(),
        arguments.rounds
    );
    let header =
        "model | input | runtime | threads | before | network | after | all | boxes".split(" | ");
    let mut table = Table::new(header).align(2, Align::Left);
    for case in &cases {
        table.row(case.row());
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let (width, height) = text
        .split_once('x')
        .ok_or("expected a size such as 640x480")?;
    let number = |text: &str| {
        text.parse()
            .map_err(|_| format!("expected a number of pixels, found {text:?}"))
    };
    Ok((number(width)?, number(height)?))
}

impl Case {
    fn new(
        model: &str,
        size: (usize, usize),
        runtime: &Runtime,
        threads: usize,
        score_threshold: f32,
    ) -> Result<Self, Failure> {
        let name = Path::new(model).file_stem().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        let (width, height) = size;
        let options = OnnxOptions {
            threads,
            score_threshold,
            input: InputSize::Fixed { width, height },
            ..OnnxOptions::default()
        };
        let file = Path::new(model).with_extension("toml");
        let card = match std::fs::read_to_string(&file) {
            Ok(text) => Some(ModelCard::parse(&file.to_string_lossy(), &text)?),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(format!("{}: {error}", file.display()).into()),
        };
        let bytes = std::fs::read(model).map_err(|e| format!("{model}: {e}"))?;
        let detector = OnnxDetector::with_card(bytes, &name, card.as_ref(), runtime, &options)?;
        Ok(Self {
            model: name,
            size,
            threads,
            detector,
            boxes: 0,
            times: Default::default(),
        })
    }

    /// Detects once; `counts` records the times.
    fn run(&mut self, image: &ColourImage, counts: bool) -> Result<(), Failure> {
        spans::take();
        let start = Instant::now();
        self.boxes = self.detector.detect_image(image, FrameId(0))?.len();
        let all = start.elapsed().as_secs_f64();
        let times = spans::take();
        let spent = |name: &str| {
            times
                .iter()
                .filter(|t| t.0.1 == name)
                .map(|t| t.1)
                .sum::<f64>()
        };
        let (before, network) = (spent("letterbox"), spent("network"));
        // Decoding, non-maximum suppression and mapping back into the image.
        let after = all - before - network;
        if counts {
            for (times, time) in self.times.iter_mut().zip([before, network, after]) {
                times.push(1e3 * time);
            }
        }
        Ok(())
    }

    fn row(&self) -> [String; 9] {
        let (width, height) = self.size;
        let all = (0..self.times[0].len()).map(|i| self.times.iter().map(|t| t[i]).sum());
        let median = |times: &[f64]| spread(times.iter().copied())[0];
        let [before, network, after] = &self.times;
        [
            self.model.clone(),
            format!("{width}x{height}"),
            self.detector.info().runtime.unwrap_or_default(),
            self.threads.to_string(),
            figure(median(before), 2),
            figure(median(network), 1),
            figure(median(after), 2),
            figure(spread(all)[0], 1),
            self.boxes.to_string(),
        ]
    }
}

/// As costly as others: only decoding depends on values, and finds nothing.
fn pattern(width: usize, height: usize) -> ColourImage {
    let data = (0..3 * width * height)
        .map(|i| (i * 7 % 251) as u8)
        .collect();
    ColourImage::from_vec(width, height, data).unwrap_or_default()
}

//! How long detectors take, as a Markdown table: models x sizes of the input x runtimes x threads, with what comes before and
//! after the network apart. Medians over rounds in which all of them take turns, so that what else the machine does meets all.
//!
//! `cargo run --release -p stillpoint-inference --features onnxruntime --example detector_times -- [OPTION...] MODEL.onnx...`
//!
//! A `MODEL.toml` beside a model is its card.
//!
//! | option | meaning |
//! |---|---|
//! | `--library FILE` | of ONNX Runtime; without it, `rten` is timed alone |
//! | `--sizes WxH,...` | of the input; default 640x480,416x320,320x256 |
//! | `--threads N,...` | default 1,2 |
//! | `--rounds N` | default 40, after two that do not count |
//! | `--score S` | least score of a box; default as in `OnnxOptions`. 0.6 for random weights, whose scores are all about 0.25 |
//! | `--image FILE` | of a camera; default: 640x480 with a pattern |
// A program may read files and the clock, and keep what a subscriber gathers; the library may not.
#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    clippy::print_stderr,
    clippy::print_stdout
)]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
use stillpoint_imaging::{ColourImage, FrameId};
use stillpoint_inference::{InputSize, ModelCard, OnnxDetector, OnnxOptions, OnnxRuntime, Runtime};
use tracing::span;

type Failure = Box<dyn std::error::Error>;

struct Arguments {
    models: Vec<String>,
    library: Option<String>,
    sizes: Vec<(usize, usize)>,
    threads: Vec<usize>,
    rounds: usize,
    score: f32,
    image: Option<String>,
}

/// One row of the table.
struct Case {
    model: String,
    size: (usize, usize),
    threads: usize,
    detector: OnnxDetector,
    boxes: usize,
    /// Letterbox, network, and what comes after it, ms.
    times: [Vec<f64>; 3],
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse(std::env::args().skip(1))?;
    tracing::subscriber::set_global_default(Spans)?;
    let mut runtimes = vec![Runtime::Rten];
    if let Some(library) = &arguments.library {
        runtimes.push(Runtime::OnnxRuntime(OnnxRuntime::load(Path::new(library))?));
    }
    let image = match &arguments.image {
        Some(file) => {
            let pixels = image::open(file)?.to_rgb8();
            let (width, height) = (pixels.width() as usize, pixels.height() as usize);
            ColourImage::from_vec(width, height, pixels.into_raw())?
        }
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
    const WARM_UP: usize = 2;
    for round in 0..WARM_UP + arguments.rounds {
        eprintln!("round {} of {}", round + 1, WARM_UP + arguments.rounds);
        for case in &mut cases {
            case.run(&image, round >= WARM_UP)?;
        }
    }
    println!(
        "{}; image of {}x{} px; median of {} runs, ms\n",
        cpu(),
        image.width(),
        image.height(),
        arguments.rounds
    );
    println!("| model | input | runtime | threads | before | network | after | all | boxes |");
    println!("|---|---|---|---|---|---|---|---|---|");
    for case in &mut cases {
        println!("{}", case.row());
    }
    Ok(())
}

impl Arguments {
    fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Self, Failure> {
        let mut parsed = Self {
            models: Vec::new(),
            library: None,
            sizes: vec![(640, 480), (416, 320), (320, 256)],
            threads: vec![1, 2],
            rounds: 40,
            score: OnnxOptions::default().score_threshold,
            image: None,
        };
        while let Some(argument) = arguments.next() {
            if !argument.starts_with("--") {
                parsed.models.push(argument);
                continue;
            }
            let value = arguments
                .next()
                .ok_or(format!("{argument}: expected a value"))?;
            match argument.as_str() {
                "--library" => parsed.library = Some(value),
                "--image" => parsed.image = Some(value),
                "--score" => parsed.score = value.parse()?,
                "--rounds" => parsed.rounds = value.parse()?,
                "--threads" => {
                    parsed.threads = value.split(',').map(str::parse).collect::<Result<_, _>>()?;
                }
                "--sizes" => parsed.sizes = value.split(',').map(size).collect::<Result<_, _>>()?,
                _ => return Err(format!("unknown option {argument}").into()),
            }
        }
        if parsed.models.is_empty() || parsed.rounds == 0 {
            return Err("expected MODEL.onnx..., and at least one round".into());
        }
        Ok(parsed)
    }
}

/// A size such as `640x480`.
fn size(text: &str) -> Result<(usize, usize), Failure> {
    let (width, height) = text
        .split_once('x')
        .ok_or("expected a size such as 640x480")?;
    Ok((width.parse()?, height.parse()?))
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
        let bytes = std::fs::read(model)?;
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

    /// Looks at the image once.
    fn run(&mut self, image: &ColourImage, counts: bool) -> Result<(), Failure> {
        SPENT.with_borrow_mut(BTreeMap::clear);
        let start = Instant::now();
        self.boxes = self.detector.detect_image(image, FrameId(0))?.len();
        let all = start.elapsed();
        let spent = |name| SPENT.with_borrow(|s| s.get(name).copied().unwrap_or_default());
        let (before, network) = (spent("letterbox"), spent("network"));
        // Decoding, suppression of overlaps and the way back into the image.
        let after = all.saturating_sub(before + network);
        if counts {
            for (times, time) in self.times.iter_mut().zip([before, network, after]) {
                times.push(1e3 * time.as_secs_f64());
            }
        }
        Ok(())
    }

    fn row(&mut self) -> String {
        let runtime = stillpoint_detection::Detector::info(&self.detector).runtime;
        let (width, height) = self.size;
        let all: Vec<f64> = (0..self.times[0].len())
            .map(|i| self.times.iter().map(|t| t[i]).sum())
            .collect();
        let [before, network, after] = &self.times;
        format!(
            "| {} | {width}x{height} | {} | {} | {:.2} | {:.1} | {:.2} | {:.1} | {} |",
            self.model,
            runtime.unwrap_or_default(),
            self.threads,
            median(before),
            median(network),
            median(after),
            median(&all),
            self.boxes,
        )
    }
}

fn median(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// An image without meaning, which costs what others do: no step looks at values but the decoding, which finds nothing.
fn pattern(width: usize, height: usize) -> ColourImage {
    let data = (0..3 * width * height)
        .map(|i| (i * 7 % 251) as u8)
        .collect();
    ColourImage::from_vec(width, height, data).unwrap_or_default()
}

fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find(|l| l.starts_with("model name"));
    let name = model
        .and_then(|l| l.split(':').nth(1))
        .unwrap_or("unknown CPU");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {cores} cores", name.trim())
}

thread_local! {
    /// Time in spans, by their name.
    static SPENT: RefCell<BTreeMap<&'static str, Duration>> = const { RefCell::new(BTreeMap::new()) };
    /// Spans that are open, innermost last.
    static OPEN: RefCell<Vec<(u64, Instant)>> = const { RefCell::new(Vec::new()) };
    /// Names of spans, by their number less one.
    static NAMES: RefCell<Vec<&'static str>> = const { RefCell::new(Vec::new()) };
}

/// Adds up the time that this thread spends in spans.
struct Spans;

impl tracing::Subscriber for Spans {
    fn enabled(&self, metadata: &tracing::Metadata<'_>) -> bool {
        metadata.is_span()
    }

    fn new_span(&self, attributes: &span::Attributes<'_>) -> span::Id {
        let name = attributes.metadata().name();
        NAMES.with_borrow_mut(|names| {
            let known = names.iter().position(|n| *n == name);
            let place = known.unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            });
            span::Id::from_u64(place as u64 + 1)
        })
    }

    fn enter(&self, span: &span::Id) {
        OPEN.with_borrow_mut(|open| open.push((span.into_u64(), Instant::now())));
    }

    fn exit(&self, span: &span::Id) {
        let now = Instant::now();
        let Some((number, start)) = OPEN.with_borrow_mut(Vec::pop) else {
            return;
        };
        debug_assert_eq!(
            number,
            span.into_u64(),
            "spans are left in the order of a stack"
        );
        let name = NAMES.with_borrow(|names| names[number as usize - 1]);
        SPENT.with_borrow_mut(|spent| *spent.entry(name).or_default() += now - start);
    }

    fn record(&self, _: &span::Id, _: &span::Record<'_>) {}
    fn record_follows_from(&self, _: &span::Id, _: &span::Id) {}
    fn event(&self, _: &tracing::Event<'_>) {}
}

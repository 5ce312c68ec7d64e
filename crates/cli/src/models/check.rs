//! `models check`: describes a model and checks that it runs.

use crate::args::models::CheckArgs;
use crate::bench::runner::median;
use crate::console;
use crate::detector::network::Running;
use crate::detector::tried;
use crate::download::megabytes;
use crate::failure::{Failure, Status};
use crate::models::grey::{SIZE, grey};
use crate::models::{cache, trial};
use crate::run::summary::DetectorJson;
use std::time::Instant;
use stillpoint::detection::{ClassId, Detector};
use stillpoint::imaging::FrameId;
use stillpoint::inference::OnnxDetector;

const OPTION: &str = "models check";
/// Number of timed runs, after one for warming up.
const LOOKS: usize = 5;
const NAMED: usize = 5;

pub(crate) fn check(args: &CheckArgs) -> Result<Status, Failure> {
    if let Some(option) = &args.trial {
        return trial::carry_out(&args.model, &Running::from(args.network), option);
    }
    let model = cache::named(&args.model, OPTION)?;
    let network = tried::open(&model, &Running::from(args.network), OPTION)?;
    let mut detector = network.detector;
    let times = look(&mut detector)?;
    if let Some(remark) = detector.remark() {
        console::warn(&remark);
    }
    let json = DetectorJson {
        library: network.library,
        ..DetectorJson::new(&detector.info())
    };
    let mut text = String::new();
    let mut line = |name: &str, value: &str| text += &format!("{name:<9}{value}\n");
    line(
        "model",
        &format!("{}, {}", model.name, megabytes(model.bytes()?)),
    );
    line("SHA-256", json.sha256.as_deref().unwrap_or_default());
    for port in &detector.interface().inputs {
        line("input", &port.to_string());
    }
    for port in &detector.interface().outputs {
        line("output", &port.to_string());
    }
    line("head", detector.card().head.name());
    line("classes", &classes(&detector));
    line("network", &json.network().unwrap_or_default());
    let (width, height) = SIZE;
    line(
        "time",
        &format!(
            "{:.1} ms on a grey image of {width}x{height} px (median of {LOOKS}; letterbox, network and decoding)",
            median(times)
        ),
    );
    let from = match model.card() {
        Some(path) => path.display().to_string(),
        None => {
            "recognised by inputs and outputs; to change it, put this beside the model as FILE.toml"
                .to_owned()
        }
    };
    console::print(&format!(
        "{text}\ncard ({from}):\n\n{}",
        detector.card().to_toml()
    ));
    Ok(Status::Ok)
}

/// Milliseconds of several runs on a grey image, without the warm-up run.
fn look(detector: &mut OnnxDetector) -> Result<Vec<f64>, Failure> {
    let grey = grey()?;
    let mut times = Vec::new();
    for turn in 0..=LOOKS {
        let start = Instant::now();
        detector
            .detect_image(&grey, FrameId(0))
            .map_err(|e| Failure::input(format!("{OPTION} {e}")))?;
        if turn > 0 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    Ok(times)
}

fn classes(detector: &OnnxDetector) -> String {
    let card = detector.card();
    let all: Vec<ClassId> = (0..card.class_count())
        .filter_map(|i| card.class(i))
        .collect();
    let mut names: Vec<&str> = all.iter().take(NAMED).map(|c| c.name()).collect();
    if all.len() > NAMED {
        names.push("...");
    }
    let left_out = card.class_count() - all.len();
    let note = match left_out {
        0 => String::new(),
        n => format!(", and {n} that are left out"),
    };
    format!("{}: {}{note}", all.len(), names.join(", "))
}

//! `detect`: runs a network on images, without SLAM.

pub(crate) mod images;
pub(crate) mod output;

use crate::args::models::DetectArgs;
use crate::console::{self, Progress, Unit};
use crate::detect::images::Images;
use crate::detect::output::DetectFolder;
use crate::detector::network::{Network, Running};
use crate::detector::tried;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::models::cache::{self, Preferred};
use crate::run::summary::DetectorJson;
use crate::timing::Timing;
use stillpoint::detection::{Detection, Detector, ScriptRow};
use stillpoint::evaluation::{Align, Table};
use stillpoint::imaging::FrameId;
use stillpoint::inference::OnnxDetector;

const OPTION: &str = "--model";
/// Names of the timing spans of one detection.
const PARTS: [&str; 3] = ["letterbox", "network", "decode"];

pub(crate) fn detect(args: &DetectArgs, timing: &Timing) -> Result<Status, Failure> {
    let mut images = images::find(&args.path, &args.topics)?;
    let model = match &args.model {
        Some(name) => cache::named(name, OPTION)?,
        None => match cache::preferred()? {
            Preferred::Model(model) => model,
            Preferred::None(reason) => {
                let said = format!("{OPTION}: expected a model, found none: {reason}");
                return Err(Failure::input(said));
            }
        },
    };
    let mut how = Running::from(args.network);
    how.options.score_threshold = args.score;
    let Network {
        mut detector,
        library,
    } = tried::open(&model, &how, OPTION)?;
    let mut folder = match &args.out {
        Some(out) => Some(DetectFolder::create(out, &args.path)?),
        None => None,
    };
    if let (Some(said), true) = (images.stamps.in_words(), args.out.is_some()) {
        console::info(said);
    }
    let pass = look(&mut images, &mut detector, folder.as_mut(), timing)?;
    if pass.seen.is_empty() {
        return Err(pass.nothing(args, images.items.len()));
    }
    if let Some(remark) = detector.remark() {
        console::warn(&remark);
    }
    let json = DetectorJson {
        library,
        ..DetectorJson::new(&detector.info())
    };
    console::report(&pass.table().to_text());
    console::report(&format!("\n{}\n{}\n", pass.summary(), times(timing)));
    if let Some(network) = json.network() {
        console::report(&format!("network: {}, {network}\n", json.name));
    }
    if let Some(folder) = folder {
        console::report(&folder.finish(&pass.rows())?);
    }
    Ok(pass.status())
}

struct Seen {
    name: String,
    stamp: f64,
    found: Vec<Detection>,
}

#[derive(Default)]
struct Pass {
    seen: Vec<Seen>,
    failed: usize,
    interrupted: bool,
}

/// Processes the images in order until done or interrupted. Unreadable ones are reported and skipped.
fn look(
    images: &mut Images,
    detector: &mut OnnxDetector,
    mut folder: Option<&mut DetectFolder>,
    timing: &Timing,
) -> Result<Pass, Failure> {
    let interrupt = Interrupt::listen();
    let mut pass = Pass::default();
    let mut progress = Progress::of(Unit::Images, Some(images.items.len()), 0);
    for i in 0..images.items.len() {
        if interrupt.requested() {
            pass.interrupted = true;
            break;
        }
        let pixels = images.read(i);
        let image = &images.items[i];
        let result = pixels.and_then(|pixels| {
            let id = FrameId(u32::try_from(i).unwrap_or(u32::MAX));
            let found = tracing::info_span!("detect")
                .in_scope(|| detector.detect_image(&pixels, id))
                .map_err(|e| format!("{}: {e}", image.path.display()))?;
            Ok((pixels, found))
        });
        timing.end_frame();
        match result {
            Ok((pixels, found)) => {
                if let Some(folder) = &mut folder {
                    folder
                        .add(&image.name, pixels, &found)
                        .inspect_err(|_| progress.finish())?;
                }
                pass.seen.push(Seen {
                    name: image.name.clone(),
                    stamp: image.stamp,
                    found,
                });
            }
            Err(e) => {
                console::line(&format!("skipped: {e}"));
                pass.failed += 1;
            }
        }
        progress.show(i + 1, "");
    }
    progress.finish();
    Ok(pass)
}

impl Pass {
    /// Error: no image could be processed.
    fn nothing(&self, args: &DetectArgs, images: usize) -> Failure {
        if self.interrupted {
            return Failure::criteria("interrupted before the first image: nothing was written");
        }
        Failure::input(format!(
            "{}: expected images that can be looked at, found none among {images}",
            args.path.display()
        ))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(["image", "class", "score", "x0", "y0", "x1", "y1"])
            .align(0, Align::Left)
            .align(1, Align::Left);
        for seen in &self.seen {
            if seen.found.is_empty() {
                table.row([&*seen.name, "-", "", "", "", "", ""].map(str::to_owned));
            }
            for d in &seen.found {
                let b = &d.bounds;
                let mut row = vec![
                    seen.name.clone(),
                    d.class.to_string(),
                    format!("{:.3}", d.score),
                ];
                row.extend([b.x0, b.y0, b.x1, b.y1].map(|x| format!("{x:.1}")));
                table.row(row);
            }
        }
        table
    }

    fn summary(&self) -> String {
        let detections: usize = self.seen.iter().map(|s| s.found.len()).sum();
        let mut text = format!("{detections} detections in {} images", self.seen.len());
        if self.failed > 0 {
            text += &format!(", {} images skipped", self.failed);
        }
        if self.interrupted {
            text += ", interrupted";
        }
        text
    }

    fn rows(&self) -> Vec<ScriptRow> {
        let rows = |seen: &Seen| {
            let stamp = seen.stamp;
            let row = move |detection: &Detection| ScriptRow {
                stamp,
                detection: *detection,
            };
            seen.found.iter().map(row).collect::<Vec<_>>()
        };
        self.seen.iter().flat_map(rows).collect()
    }

    fn status(&self) -> Status {
        if self.failed > 0 || self.interrupted {
            Status::Failed
        } else {
            Status::Ok
        }
    }
}

fn times(timing: &Timing) -> String {
    let all = timing.statistics();
    let of = |name: &str| all.iter().find(|s| s.0 == name).map(|s| s.1.median);
    let mut parts: Vec<String> = PARTS
        .iter()
        .filter_map(|name| Some(format!("{name} {:.2}", of(name)?)))
        .collect();
    parts.extend(of("detect").map(|ms| format!("all {ms:.2}")));
    format!("median ms per image: {}", parts.join(", "))
}

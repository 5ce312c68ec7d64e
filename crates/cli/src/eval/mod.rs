//! `eval`: scores a trajectory file against ground truth, and tracks against boxes.

mod objects;
pub(crate) mod offset;
pub(crate) mod order;
mod tracks;

use crate::args::eval::EvalArgs;
use crate::failure::{Failure, Status};
use crate::input::said;
use crate::run::paths;
use crate::run::result::{score_figure, timed};
use crate::run::summary::ScoreJson;
use crate::{console, output, report};
use std::path::Path;
use stillpoint::datasets::{CameraChoice, StampedPose, trajectory};
use stillpoint::evaluation::{EvalOptions, Score, score};
use stillpoint::recordings::{self, OpenOptions, TRUTH_TOPIC};

const OPTION: &str = "--time-offset";

pub(crate) fn eval(args: &EvalArgs) -> Result<Status, Failure> {
    let trajectories = args.ground_truth.as_deref().zip(args.estimate.as_deref());
    let score = trajectories.map(|files| score_files(args, files));
    let score = score.transpose()?;
    let Some(files) = &args.objects else {
        if let Some((score, poses)) = &score {
            let json = ScoreJson::new(score, args.scale);
            if args.json {
                print_json(&json)?;
            } else {
                print_score(&json, *poses);
            }
        }
        return Ok(Status::Ok);
    };
    let truth_from_found = score.as_ref().and_then(|(score, _)| match score {
        // Tracks are metric: with a free scale no rigid transform maps them to the ground truth.
        Score::Moving(e) if !args.scale => Some(e.ate.alignment.target_from_source),
        _ => None,
    });
    let json = objects::evaluate(files, &args.object_options, truth_from_found)?;
    if args.json {
        print_json(&json)?;
    } else {
        if let Some((score, poses)) = &score {
            print_score(&ScoreJson::new(score, args.scale), *poses);
            console::print("\n");
        }
        console::print(&json.text(args.object_options.max_speed));
    }
    Ok(Status::Ok)
}

fn print_json(json: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string(json).map_err(Failure::input)?;
    console::print(&format!("{text}\n"));
    Ok(())
}

/// Prints the score; the last argument holds the numbers of poses of ground truth and estimate.
fn print_score(json: &ScoreJson, [reference, estimate]: [usize; 2]) {
    console::print(&report::score_text(&[("", json)], estimate));
    console::print(&format!(
        "ground truth: {reference} poses; estimate: {estimate} poses\n"
    ));
}

/// The score of two trajectory files, ground truth first, and their numbers of poses; draws the plot.
fn score_files(
    args: &EvalArgs,
    (ground_truth, estimate_file): (&Path, &Path),
) -> Result<(Score, [usize; 2]), Failure> {
    // Reports a wrong plot name before the work.
    let format = args.plot.as_deref().map(plot_format).transpose()?;
    let inputs = [
        ("the ground truth", ground_truth),
        ("the estimate", estimate_file),
    ];
    let files = paths::named([("--plot", args.plot.as_deref())]);
    paths::check(&files, &inputs)?;
    let reference = timed(&reference(ground_truth, args.truth_topic.as_deref())?);
    let mut estimate = timed(&said(trajectory::read_said(estimate_file)?));
    let seconds = if args.find_offset {
        offset::best(&reference, &estimate, args.scale)?
    } else {
        args.time_offset
    };
    estimate.iter_mut().for_each(|p| p.stamp += seconds);
    let options = EvalOptions {
        with_scale: args.scale,
        delta: args.delta,
        ..EvalOptions::default()
    };
    let score = score(&reference, &estimate, &options).map_err(|e| {
        let hint = offset::hint(&e, &reference, &estimate, (args.scale, seconds));
        Failure::input(format!(
            "{} against {}: {e}{hint}",
            estimate_file.display(),
            ground_truth.display()
        ))
    })?;
    order::remark(&reference, &estimate);
    if !args.find_offset {
        offset::remark(&reference, &estimate, (args.scale, seconds), OPTION);
    }
    if let (Some(path), Some(format)) = (&args.plot, format) {
        let title = estimate_file.display().to_string();
        let figure = score_figure(&title, &score, &estimate);
        let bytes = match format {
            PlotFormat::Svg => figure.to_svg().into_bytes(),
            PlotFormat::Png => figure.to_png().map_err(Failure::input)?,
        };
        output::write_file(path, &bytes)?;
    }
    Ok((score, [reference.len(), estimate.len()]))
}

/// The ground truth of a pose file, a data set folder, or a recording.
fn reference(path: &Path, topic: Option<&str>) -> Result<Vec<StampedPose>, Failure> {
    let is_recording = recordings::is_recording(path);
    if !is_recording && !path.is_dir() {
        return match topic {
            Some(_) => Err(Failure::input(format!(
                "--truth-topic: expected a recording, found {}; leave the option out",
                path.display()
            ))),
            None => Ok(said(trajectory::read_said(path)?)),
        };
    }
    let options = OpenOptions {
        truth_topic: topic.map(str::to_owned),
        ..OpenOptions::default()
    };
    // Poses do not depend on the camera.
    let any_camera = OpenOptions {
        camera: Some(CameraChoice::Preset("tum_fr1".to_owned())),
        ..options.clone()
    };
    let opened = recordings::open(path, &options);
    let input = match opened.or_else(|e| recordings::open(path, &any_camera).map_err(|_| e)) {
        // Recordings by Stillpoint have ground truth under a fixed topic name.
        Ok(input) if is_recording && topic.is_none() && input.ground_truth()?.is_none() => {
            let ours = OpenOptions {
                truth_topic: Some(TRUTH_TOPIC.to_owned()),
                ..options
            };
            recordings::open(path, &ours).ok()
        }
        other => Some(other?),
    };
    let truth = input.map(|i| i.ground_truth_said()).transpose()?.flatten();
    truth.map(said).ok_or_else(|| {
        let what = if is_recording {
            "name the topic of its poses: --truth-topic"
        } else {
            "name a file of poses (TUM format)"
        };
        Failure::input(format!(
            "{}: expected ground truth, found none; {what}",
            path.display()
        ))
    })
}

enum PlotFormat {
    Svg,
    Png,
}

fn plot_format(path: &Path) -> Result<PlotFormat, Failure> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("svg") => Ok(PlotFormat::Svg),
        Some("png") => Ok(PlotFormat::Png),
        _ => Err(Failure::input(format!(
            "--plot {}: expected a name that ends with .svg or .png; rename it",
            path.display()
        ))),
    }
}

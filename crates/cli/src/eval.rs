//! `eval`: the score of a trajectory file against a ground truth file.

use crate::args::EvalArgs;
use crate::failure::{Failure, Status};
use crate::run::paths;
use crate::run::result::{score_figure, timed};
use crate::run::summary::ScoreJson;
use crate::{console, output, report};
use std::path::Path;
use stillpoint::datasets::trajectory;
use stillpoint::evaluation::{EvalOptions, score};

/// `eval`.
pub(crate) fn eval(args: &EvalArgs) -> Result<Status, Failure> {
    // A plot that cannot be written is a mistake in the arguments: better said before the work.
    let format = args.plot.as_deref().map(plot_format).transpose()?;
    let inputs = [
        ("the ground truth", &*args.ground_truth),
        ("the estimate", &*args.estimate),
    ];
    paths::check(&[("--plot", args.plot.as_deref())], &inputs)?;
    let reference = trajectory::read(&args.ground_truth)?;
    let estimate = trajectory::read(&args.estimate)?;
    let options = EvalOptions {
        with_scale: args.scale,
        delta: args.delta,
        ..EvalOptions::default()
    };
    let score = score(&timed(&reference), &timed(&estimate), &options).map_err(|e| {
        Failure::input(format!(
            "{} against {}: {e}",
            args.estimate.display(),
            args.ground_truth.display()
        ))
    })?;
    if let (Some(path), Some(format)) = (&args.plot, format) {
        let title = args.estimate.display().to_string();
        let figure = score_figure(&title, &score, &timed(&estimate));
        let bytes = match format {
            PlotFormat::Svg => figure.to_svg().into_bytes(),
            PlotFormat::Png => figure.to_png().map_err(Failure::input)?,
        };
        output::write_file(path, &bytes)?;
    }
    let json = ScoreJson::new(&score, args.scale);
    if args.json {
        let text = serde_json::to_string(&json).map_err(Failure::input)?;
        console::print(&format!("{text}\n"));
    } else {
        console::print(&report::score_text(&[("", &json)], estimate.len()));
        console::print(&format!(
            "ground truth: {} poses; estimate: {} poses\n",
            reference.len(),
            estimate.len()
        ));
    }
    Ok(Status::Ok)
}

enum PlotFormat {
    Svg,
    Png,
}

/// From the name's ending.
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

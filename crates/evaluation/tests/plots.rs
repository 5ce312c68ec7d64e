//! Figures are complete, well-formed and handle odd input.

use stillpoint_evaluation::plot::{
    Series, drift_figure, poses_figure, timing_figure, trajectory_figure,
};
use stillpoint_evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint_geometry::{Se3, Vec3, so3};

fn walk(n: usize, noise: f64) -> Vec<TimedPose> {
    (0..n)
        .map(|i| {
            let s = i as f64 / 30.0;
            let wobble = noise * libm::sin(37.0 * s);
            let at = Vec3::new(
                2.0 * libm::sin(s),
                0.1 * s + wobble,
                1.5 * libm::cos(0.7 * s),
            );
            TimedPose {
                stamp: 5.0 + s,
                world_from_camera: Se3::new(so3::exp(&Vec3::zeros()), at),
            }
        })
        .collect()
}

#[test]
fn trajectory_figure_is_complete() {
    let (truth, mut estimate) = (walk(300, 0.0), walk(300, 0.02));
    estimate.drain(100..150);
    let ate = evaluate(&truth, &estimate, &EvalOptions::default())
        .unwrap()
        .ate;
    let figure = trajectory_figure("a < b & c", &ate, None);
    let svg = figure.to_svg();
    for part in [
        "a &lt; b &amp; c",
        "x (m)",
        "z (m)",
        "time (s)",
        "error (mm)",
        "ground truth",
        "250 pairs",
        "RMSE",
    ] {
        assert!(svg.contains(part), "no {part}");
    }
    assert_eq!(svg.matches("<svg").count(), 1);
    assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"));
    let png = figure.to_png().unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 20_000);
    // The same input gives the same picture.
    assert_eq!(
        png,
        trajectory_figure("a < b & c", &ate, None).to_png().unwrap()
    );
    assert_eq!(figure.size(), (1200.0, 855.0));
}

/// Attribute of the polylines of an SVG that have a colour.
fn strokes<'a>(svg: &'a str, colour: &str) -> Vec<(usize, &'a str)> {
    let lines = svg.lines().enumerate();
    let of = lines.filter(|(_, l)| l.starts_with("<polyline") && l.contains(colour));
    of.map(|(i, l)| {
        let width = l.split("stroke-width=\"").nth(1).unwrap();
        (i, width.split('"').next().unwrap())
    })
    .collect()
}

#[test]
fn relative_errors_are_plotted_below_absolute_ones() {
    let (truth, estimate) = (walk(300, 0.0), walk(300, 0.02));
    let e = evaluate(&truth, &estimate, &EvalOptions::default()).unwrap();
    let rpe = e.rpe.as_ref().unwrap();
    assert_eq!(rpe.errors.len(), rpe.pairs);
    let most = rpe.errors.iter().map(|e| e.translation).fold(0.0, f64::max);
    assert_eq!(most, rpe.translation.max);
    assert!(rpe.errors.is_sorted_by(|a, b| a.stamp < b.stamp));
    let figure = trajectory_figure("a", &e.ate, Some(rpe));
    let svg = figure.to_svg();
    for part in ["RPE, 1 s (mm)", "RPE, 1 s (deg)", "Stillpoint"] {
        assert!(svg.contains(part), "no {part}");
    }
    // On each of the six panels over time, except two above another one.
    assert_eq!(svg.matches(">time (s)<").count(), 4);
    assert!(figure.size().1 > 1200.0);
    figure.to_png().unwrap();
}

#[test]
fn every_panel_has_ticks_on_both_axes() {
    let truth = walk(300, 0.0);
    let e = evaluate(&truth, &walk(300, 0.02), &EvalOptions::default()).unwrap();
    let svg = trajectory_figure("a", &e.ate, e.rpe.as_ref()).to_svg();
    // The walk lasts ten seconds: each of six panels over time has the label of the eighth.
    assert!(svg.matches(">8</text>").count() >= 6);
}

#[test]
fn truth_is_visible_under_a_coinciding_estimate() {
    let truth = walk(300, 0.0);
    let ate = evaluate(&truth, &truth, &EvalOptions::default())
        .unwrap()
        .ate;
    let svg = trajectory_figure("a", &ate, None).to_svg();
    let (wide, thin) = (strokes(&svg, "#868c96"), strokes(&svg, "#0072b2"));
    // From above and in three coordinates, each before the estimate; and in two legends.
    assert!(wide.len() >= 5, "{wide:?}");
    assert!(wide.iter().all(|(_, width)| *width == "5"), "{wide:?}");
    assert!(
        thin.iter()
            .all(|(_, width)| width.parse::<f64>().unwrap() < 2.5)
    );
}

/// An estimate without error is drawn in one colour; only its sign in the legend has the others.
#[test]
fn legend_of_the_estimate_has_all_colours_of_errors() {
    let truth = walk(300, 0.0);
    let ate = evaluate(&truth, &truth, &EvalOptions::default())
        .unwrap()
        .ate;
    let svg = trajectory_figure("a", &ate, None).to_svg();
    let pieces: Vec<&str> = svg
        .lines()
        .filter(|l| l.starts_with("<polyline") && l.contains("stroke-width=\"2.4\""))
        .map(|l| l.split("stroke=\"").nth(1).unwrap())
        .map(|colour| colour.split('"').next().unwrap())
        .collect();
    let colours: std::collections::BTreeSet<&&str> = pieces.iter().collect();
    // Eight pieces here, and one colour in the legend of the coordinates.
    assert_eq!(colours.len(), 9, "{pieces:?}");
}

#[test]
fn perfect_and_short_trajectories_can_be_drawn() {
    let truth = walk(3, 0.0);
    let ate = evaluate(&truth, &truth, &EvalOptions::default())
        .unwrap()
        .ate;
    let figure = trajectory_figure("", &ate, None);
    assert!(!figure.to_svg().contains("NaN") && !figure.to_svg().contains("inf"));
    figure.to_png().unwrap();
}

#[test]
fn drift_figure_is_about_the_first_pose() {
    let estimate = walk(50, 0.0);
    let svg = drift_figure("fixed", &estimate).to_svg();
    // The walk extends along x and z.
    assert!(svg.contains("drift RMS") && svg.contains("50 pairs"));
    assert!(!svg.contains("NaN"));
    assert!(!drift_figure("none", &[]).to_svg().contains("NaN"));
    drift_figure("one", &estimate[..1]).to_png().unwrap();
}

#[test]
fn poses_can_be_drawn_without_ground_truth() {
    let estimate = walk(60, 0.0);
    let svg = poses_figure("map", &estimate).to_svg();
    assert!(svg.contains("60 poses") && svg.contains("no ground truth"));
    assert!(!svg.contains("error") && !svg.contains("NaN"));
    assert!(!poses_figure("none", &[]).to_svg().contains("NaN"));
    poses_figure("map", &estimate).to_png().unwrap();
}

#[test]
fn timing_figure_has_a_line_per_series_and_breaks_at_gaps() {
    let track = [10.0, 12.0, f64::NAN, 11.0, 40.0];
    let empty: [f64; 0] = [];
    let svg = timing_figure(
        "Time per frame",
        &[
            Series {
                name: "track",
                milliseconds: &track,
            },
            Series {
                name: "none",
                milliseconds: &empty,
            },
        ],
    )
    .to_svg();
    assert!(svg.contains("track: median 11.5") && svg.contains("30 Hz"));
    assert!(!svg.contains("NaN"));
    let fast = timing_figure(
        "",
        &[Series {
            name: "f",
            milliseconds: &[1.0, 2.0],
        }],
    );
    assert!(!fast.to_svg().contains("30 Hz"));
    timing_figure("", &[]).to_png().unwrap();
}

//! Text output of the demo.

use crate::console::{self, counted};
use crate::demo::pictures::Hits;
use crate::dense::DenseJson;
use crate::failure::Status;
use crate::run::summary::{ScoreJson, StatisticsJson, Summary};
use std::path::Path;
use stillpoint::datasets::StampedPose;
use stillpoint::evaluation::{Score, Table};

pub(crate) struct Pass {
    pub(crate) summary: Summary,
    pub(crate) score: Option<Score>,
    pub(crate) poses: Vec<StampedPose>,
}

impl Pass {
    /// The name of the error and its statistics: ATE, or drift of a camera that stands still.
    fn error(&self) -> Option<(&'static str, StatisticsJson)> {
        match &self.summary.accuracy.as_ref()?.final_poses {
            ScoreJson::Moving(m) => Some(("ATE", m.ate)),
            ScoreJson::Fixed(f) => Some(("drift", f.drift)),
        }
    }
}

pub(crate) fn error(pass: &Pass) -> String {
    pass.error().map_or_else(
        || "no score".to_owned(),
        |(name, e)| format!("{name} {:.1} mm", e.rmse * 1e3),
    )
}

/// The five final lines: scene, both errors, files, and their folder. `bound` is the limit for the error with the filter, m.
pub(crate) fn lines(
    (scene, people): (&str, bool),
    [off, on]: [&Pass; 2],
    bound: f64,
    (out, film): (&Path, Option<&str>),
) -> String {
    let frames = counted(on.summary.tracking.frames, "frame");
    let room = if people {
        "room with people in it"
    } else {
        "room"
    };
    let error = |pass: &Pass| {
        let error = pass.error().map_or_else(
            || "no score".to_owned(),
            |(name, e)| {
                format!(
                    "{name} {:.1} mm, at most {:.1} mm",
                    e.rmse * 1e3,
                    e.max * 1e3
                )
            },
        );
        let of = counted(pass.summary.tracking.frames, "frame");
        format!("{error}; {} of {of} tracked", pass.summary.tracking.tracked)
    };
    let meets = on.error().is_some_and(|(_, e)| e.rmse <= bound);
    let meets = if meets {
        format!("; within its bound of {:.0} mm", bound * 1e3)
    } else {
        String::new()
    };
    let surface = on
        .summary
        .kept
        .dense
        .as_ref()
        .map(|d: &DenseJson| d.text(false));
    let surface = surface.unwrap_or_else(|| "surface: none\n".to_owned());
    let page = out.join("on").join("report.html");
    let look = match film {
        Some(film) => format!("{}, {}", out.join(film).display(), page.display()),
        None => page.display().to_string(),
    };
    format!(
        "{scene}: {frames} of a simulated {room}, tracked without and with the static filter\n\
         filter off: {}\n\
         filter on: {}{meets}\n\
         {surface}\
         look at {look}\n",
        error(off),
        error(on),
    )
}

/// Both passes side by side, with every figure.
pub(crate) fn text(off: &Pass, on: &Pass, hits: &Hits) -> String {
    let mut table = Table::new(["", "filter off", "filter on"]);
    let mut row = |name: &str, of: &dyn Fn(&Pass) -> String| {
        table.row([name.to_owned(), of(off), of(on)]);
    };
    let name = on.error().or(off.error()).map_or("ATE", |e| e.0);
    let mm = |pass: &Pass, of: fn(&StatisticsJson) -> f64| {
        let e = pass.error();
        e.map_or_else(|| "-".to_owned(), |(_, e)| format!("{:.1}", of(&e) * 1e3))
    };
    row(&format!("{name} RMSE (mm)"), &|p| mm(p, |e| e.rmse));
    row(&format!("{name} SD (mm)"), &|p| mm(p, |e| e.sd));
    row(&format!("largest {name} (mm)"), &|p| mm(p, |e| e.max));
    row("frames with a pose", &|p| {
        format!(
            "{} of {}",
            p.summary.tracking.tracked, p.summary.tracking.frames
        )
    });
    row("keypoints rejected", &|p| {
        format!("{:.1} %", p.summary.stages.features.dynamic_share * 100.0)
    });
    row("landmarks", &|p| p.summary.map.landmarks.to_string());
    row("ms per frame, median", &|p| {
        let stages = &p.summary.pace.timing_ms;
        let frame = stages.iter().find(|s| s.stage == "frame");
        frame.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", s.median))
    });
    format!("\n{}{}", table.to_text(), truth_text(hits))
}

fn truth_text(hits: &Hits) -> String {
    let percent = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    let kept = percent(hits.others - hits.others_rejected, hits.others);
    if hits.people == 0 {
        return format!(
            "\nwith the filter on, {kept:.1} % of the keypoints were kept; nobody is there\n"
        );
    }
    format!(
        "\nwith the filter on, of the keypoints on people {:.1} % were rejected and {:.1} % used because the person stood\n\
         still; of all others {kept:.1} % were kept (by the simulator's masks, in the frames of the animation; {:.0} % of the\n\
         keypoints were on people)\n",
        percent(hits.people_rejected, hits.people),
        percent(hits.people_parked, hits.people),
        percent(hits.people, hits.people + hits.others),
    )
}

/// `Ok` when the pass with the filter succeeded and met its bound, m; otherwise prints why.
pub(crate) fn judge(on: &Pass, bound: f64, status: Status) -> Status {
    let limit = bound * 1e3;
    match on.error() {
        Some((_, e)) if e.rmse <= bound => return status,
        Some((name, _)) => console::line(&format!(
            "the {name} with the filter on exceeds its bound of {limit:.0} mm"
        )),
        None => console::line("the run with the filter on has no score"),
    }
    Status::Failed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_is_reported_against_ground_truth() {
        let hits = Hits {
            people: 200,
            people_rejected: 150,
            people_parked: 40,
            others: 800,
            others_rejected: 8,
        };
        let text = truth_text(&hits);
        for part in [
            "75.0 % were rejected",
            "20.0 % used",
            "99.0 % were kept",
            "20 % of the",
        ] {
            assert!(text.contains(part), "{text}");
        }
        let text = truth_text(&Hits {
            others: 10,
            ..Hits::default()
        });
        assert!(text.contains("nobody is there"), "{text}");
    }
}

//! `--overlay`: frames with what the system saw drawn over them, and an animation of them.

use crate::failure::Failure;
use crate::output::ResultFolder;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use stillpoint::detection::{Motion, MotionWeights, Object, ObjectState};
use stillpoint::imaging::RgbdFrame;
use stillpoint::slam::{FrameReport, Outcome, Reasons};
use stillpoint::view::{
    Animation, AnimationOptions, CellLabels, Colour, Keypoint, Mark, Overlay, OverlayBox, Picture,
    ViewError, draw, write_png,
};

const OPTION: &str = "--overlay";
const ANIMATION: &str = "animation.png";
/// Pictures per second of an animation, at most: that looks smooth enough.
const SMOOTH: f64 = 10.0;
/// Pictures of an animation, at most: some 40 MB. Longer recordings show fewer per second.
const LONGEST: f64 = 400.0;

/// A folder of pictures in the making.
pub(crate) struct OverlayFolder {
    out: PathBuf,
    folder: ResultFolder,
    every: usize,
    /// Frames that went by.
    seen: usize,
    drawn: usize,
    weights: MotionWeights,
    animation: Animation<BufWriter<File>>,
}

impl OverlayFolder {
    /// Begins to draw every `every`-th of `frames` frames, of which there are `rate` per second.
    pub(crate) fn create(
        out: &Path,
        every: usize,
        frames: usize,
        rate: f64,
        weights: &MotionWeights,
    ) -> Result<Self, Failure> {
        let mut folder = ResultFolder::create_of(out, OPTION, is_ours)?;
        let pictures = frames.div_ceil(every) as f64;
        let rate = rate / every as f64;
        let shown = (rate / SMOOTH).max(pictures / LONGEST).ceil();
        let options = AnimationOptions {
            every: shown as usize,
            frames_per_second: rate,
            ..AnimationOptions::default()
        };
        let animation = Animation::new(BufWriter::new(folder.begin(ANIMATION)?), options);
        Ok(Self {
            out: out.to_owned(),
            folder,
            every,
            seen: 0,
            drawn: 0,
            weights: weights.clone(),
            animation,
        })
    }

    /// Every so many frames are drawn.
    pub(crate) fn every(&self) -> usize {
        self.every
    }

    /// Whether the next frame will be drawn.
    pub(crate) fn wants_next(&mut self) -> bool {
        self.seen += 1;
        (self.seen - 1).is_multiple_of(self.every)
    }

    /// Draws a frame.
    pub(crate) fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) -> Result<(), Failure> {
        let picture = picture(frame, report, &self.weights);
        let name = format!("{:06}.png", report.frame.0);
        let mut png = Vec::new();
        write_png(&picture, &mut png)
            .and_then(|()| self.animation.push(&picture))
            .map_err(|e| failure(&self.out, &e))?;
        self.drawn += 1;
        self.folder.write(&name, &png)
    }

    /// Ends the animation and puts everything where it belongs. Returns what there is, for the report.
    pub(crate) fn finish(self) -> Result<String, Failure> {
        let pictures = self.drawn;
        self.animation
            .finish()
            .and_then(|mut sink| Ok(sink.flush().and_then(|()| sink.get_ref().sync_all())?))
            .map_err(|e| failure(&self.out.join(ANIMATION), &e))?;
        self.folder.commit()?;
        Ok(format!(
            "{pictures} pictures and {ANIMATION} in {}\n",
            self.out.display()
        ))
    }
}

/// A frame with what the system said of it drawn over it. Boxes of what is likelier to move are drawn over the others.
pub(crate) fn picture(frame: &RgbdFrame, report: &FrameReport, weights: &MotionWeights) -> Picture {
    let keypoints: Vec<Keypoint> = report
        .verdicts
        .iter()
        .map(|v| {
            let [x, y] = v.pixel;
            let mark = if v.dynamic {
                Mark::Dynamic(colour_of(v.reasons))
            } else {
                Mark::Static
            };
            (x, y, mark)
        })
        .collect();
    let mut objects: Vec<&Object> = report.objects.iter().collect();
    let weight = |object: &Object| weights.get(object.class);
    objects.sort_by(|a, b| weight(a).total_cmp(&weight(b)));
    let boxes: Vec<OverlayBox> = objects.into_iter().map(overlay_box).collect();
    let segments = &report.segments;
    draw(
        frame,
        &Overlay {
            keypoints: &keypoints,
            boxes: &boxes,
            cells: (!segments.labels.is_empty()).then_some(CellLabels {
                cell: segments.cell_px,
                width: segments.width,
                height: segments.height,
                labels: &segments.labels,
            }),
            caption: &caption(report),
        },
    )
}

/// The files that a folder of pictures may hold: an older result's are removed.
fn is_ours(name: &str) -> bool {
    let frame = |number: &str| number.len() >= 6 && number.bytes().all(|b| b.is_ascii_digit());
    name == ANIMATION || name.strip_suffix(".png").is_some_and(frame)
}

fn failure(path: &Path, error: &ViewError) -> Failure {
    match error {
        ViewError::Write(e) => Failure::write_of(path, OPTION, e),
        e => Failure::input(format!("{}: {e}; leave {OPTION} out", path.display())),
    }
}

/// The colour of the reason that says most.
fn colour_of(reasons: Reasons) -> Colour {
    [
        (Reasons::OBJECT, Colour::SEMANTIC),
        (Reasons::RIGID, Colour::RIGID),
        (Reasons::EPIPOLAR, Colour::EPIPOLAR),
        (Reasons::DEPTH, Colour::DEPTH),
    ]
    .into_iter()
    .find(|(reason, _)| reasons.has(*reason))
    .map_or(Colour::HISTORY, |(_, colour)| colour)
}

fn overlay_box(object: &Object) -> OverlayBox {
    let mut label = format!("{} {}", object.class, object.id.0);
    match (object.motion, object.velocity) {
        (Motion::Parked, _) => label += " parked",
        (_, Some(v)) => label += &format!(" {:.1} m/s", v.norm()),
        _ => {}
    }
    if object.state == ObjectState::Tentative {
        label += "?";
    }
    OverlayBox {
        bounds: object.bounds,
        label,
        colour: Colour::of_number(object.id.0),
        coasting: object.state == ObjectState::Coasting,
    }
}

/// The state in a line: short, since a picture of 640 px has room for some fifty letters.
fn caption(report: &FrameReport) -> String {
    let c = &report.counts;
    let state = match report.outcome {
        Outcome::Initialised => "a map begins".to_owned(),
        Outcome::Tracked if report.is_keyframe => format!("keyframe, {} inliers", c.inliers),
        Outcome::Tracked => format!("{} inliers", c.inliers),
        Outcome::Relocalised { .. } => format!("found again, {} inliers", c.inliers),
        Outcome::Lost { reason, .. } => format!("LOST, {reason}"),
    };
    let released = match c.released {
        0 => String::new(),
        n => format!(", {n} kept"),
    };
    format!(
        "{}: {state}; {}/{} move{released}",
        report.frame, c.dynamic, c.keypoints
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pictures_of_an_older_result_are_removed() {
        for (name, ours) in [
            ("000012.png", true),
            ("1000000.png", true),
            ("animation.png", true),
            ("12.png", false),
            ("holiday.png", false),
            ("000012.jpg", false),
        ] {
            assert_eq!(is_ours(name), ours, "{name}");
        }
    }

    #[test]
    fn the_colour_is_that_of_the_reason_that_says_most() {
        let all = Reasons::AGE | Reasons::RIGID | Reasons::OBJECT;
        assert_eq!(colour_of(all), Colour::SEMANTIC);
        assert_eq!(colour_of(Reasons::AGE | Reasons::RIGID), Colour::RIGID);
        assert_eq!(colour_of(Reasons::AGE), Colour::HISTORY);
    }
}

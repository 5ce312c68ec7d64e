//! `--overlay`: frames with what the system saw drawn over them, and an animation of them.

use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::run::session::listeners::Writer;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use stillpoint::detection::{Motion, MotionWeights, Object, ObjectState};
use stillpoint::imaging::RgbdFrame;
use stillpoint::slam::{Event, FrameReport, MOVER, Outcome, Reasons};
use stillpoint::view::{
    Animation, AnimationOptions, CellLabels, Colour, Keypoint, Mark, Overlay, OverlayBox, Picture,
    ViewError, certain_speed, draw, write_png,
};

const OPTION: &str = "--overlay";
const ANIMATION: &str = "animation.gif";
/// What older results hold in its place.
const OLD_ANIMATION: &str = "animation.png";
/// Pictures per second of an animation, at most: that looks smooth enough.
const SMOOTH: f64 = 10.0;
/// Pictures of an animation, at most: some 20 MB. Longer recordings show fewer per second.
const LONGEST: f64 = 400.0;

/// Which objects are labelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Labels {
    /// Every object.
    All,
    /// Objects of classes that move by themselves, and whatever else is seen moving.
    #[default]
    Movers,
    /// None.
    None,
}

/// How objects are drawn.
#[derive(Clone, Debug, Default)]
pub(crate) struct Style {
    /// No lines under the image, which keeps its size.
    pub(crate) bare: bool,
    pub(crate) labels: Labels,
    pub(crate) weights: MotionWeights,
}

impl Style {
    /// Whether it may move by itself at any time, or does move. The rigid test alone is not enough for a thing: features of
    /// someone who walks past its box move too.
    fn mover(&self, object: &Object) -> bool {
        let moved =
            || object.motion == Motion::Moving && certain_speed(object, FOR_THINGS).is_some();
        self.weights.get(object.class) >= MOVER || moved()
    }

    fn labelled(&self, object: &Object) -> bool {
        match self.labels {
            Labels::All => true,
            Labels::Movers => self.mover(object),
            Labels::None => false,
        }
    }
}

/// Standard deviations that the speed of a thing must be above to make it a mover.
const FOR_THINGS: f64 = 2.8;

impl Writer for OverlayFolder {
    /// Draws every so many frames that were tracked. A live run brings a frame without its image where drawing falls behind.
    fn write(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(tracked) = event.as_frame() else {
            return Ok(());
        };
        let turn = self.seen.is_multiple_of(self.every);
        self.seen += 1;
        match &tracked.frame {
            Some(frame) if turn => {
                let _span = tracing::info_span!("overlay").entered();
                self.add(frame, &tracked.report)
            }
            _ => Ok(()),
        }
    }
}

/// A folder of pictures in the making.
pub(crate) struct OverlayFolder {
    out: PathBuf,
    folder: ResultFolder,
    every: usize,
    /// Frames that went by.
    seen: usize,
    drawn: usize,
    style: Style,
    animation: Animation<BufWriter<File>>,
}

impl OverlayFolder {
    /// Begins to draw every `every`-th of `frames` frames, of which there are `rate` per second.
    pub(crate) fn create(
        out: &Path,
        every: usize,
        frames: usize,
        rate: f64,
        style: Style,
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
            style,
            animation,
        })
    }

    /// Every so many frames are drawn.
    pub(crate) fn every(&self) -> usize {
        self.every
    }

    /// Draws a frame.
    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) -> Result<(), Failure> {
        let picture = picture(frame, report, &self.style);
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
pub(crate) fn picture(frame: &RgbdFrame, report: &FrameReport, style: &Style) -> Picture {
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
    let weight = |object: &Object| style.weights.get(object.class);
    objects.sort_by(|a, b| weight(a).total_cmp(&weight(b)));
    let boxes = objects.into_iter().map(|object| overlay_box(object, style));
    let boxes: Vec<OverlayBox> = boxes.collect();
    let segments = &report.segments;
    let caption = caption(report);
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
            badge: (!style.bare).then(|| badge(report)),
            caption: if style.bare { "" } else { &caption },
            legend: !style.bare,
        },
    )
}

/// The files that a folder of pictures may hold: an older result's are removed.
fn is_ours(name: &str) -> bool {
    let frame = |number: &str| number.len() >= 6 && number.bytes().all(|b| b.is_ascii_digit());
    [ANIMATION, OLD_ANIMATION].contains(&name) || name.strip_suffix(".png").is_some_and(frame)
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

fn overlay_box(object: &Object, style: &Style) -> OverlayBox {
    let label = if style.labelled(object) {
        label(object)
    } else {
        String::new()
    };
    OverlayBox {
        bounds: object.bounds,
        label,
        colour: Colour::of_number(object.id.0),
        coasting: matches!(object.state, ObjectState::Coasting | ObjectState::Hidden),
        quiet: !style.mover(object),
    }
}

/// What it is, and how fast where the rigid test says that it moves and the speed is above its own standard deviation.
fn label(object: &Object) -> String {
    let doubt = match object.state {
        ObjectState::Tentative => "?",
        ObjectState::Confirmed | ObjectState::Coasting | ObjectState::Hidden => "",
    };
    let name = format!("{} {}{doubt}", object.class, object.id.0);
    match object.motion {
        Motion::Parked => name + " parked",
        Motion::Unknown => name,
        Motion::Moving => match certain_speed(object, 1.0) {
            Some(speed) => format!("{name}  {speed:.1} m/s"),
            None => name,
        },
    }
}

/// Whether all is well, in a word.
fn badge(report: &FrameReport) -> (&'static str, Colour) {
    match report.outcome {
        Outcome::Initialised => ("NEW MAP", Colour::of_number(0)),
        Outcome::Tracked => ("TRACKED", Colour::STATIC),
        Outcome::Relocalised { .. } => ("FOUND AGAIN", Colour::of_number(0)),
        Outcome::Lost { .. } => ("LOST", Colour::SEMANTIC),
    }
}

/// The state in a line: short, since it stands beside the badge.
fn caption(report: &FrameReport) -> String {
    let c = &report.counts;
    let mut parts = vec![format!("frame {}", report.frame)];
    match report.outcome {
        Outcome::Lost { reason, .. } => parts.push(reason.to_string()),
        Outcome::Initialised => {}
        Outcome::Tracked | Outcome::Relocalised { .. } => {
            parts.push(format!("{} inliers", c.inliers));
        }
    }
    parts.push(format!("{} of {} keypoints move", c.dynamic, c.keypoints));
    if c.released > 0 {
        parts.push(format!("{} of them used", c.released));
    }
    if report.is_keyframe {
        parts.push("keyframe".to_owned());
    }
    parts.join(" \u{b7} ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::detection::{BoundingBox, ClassId, ObjectId};
    use stillpoint::geometry::{Mat6, Vec3};

    #[test]
    fn only_pictures_of_an_older_result_are_removed() {
        for (name, ours) in [
            ("000012.png", true),
            ("1000000.png", true),
            ("animation.gif", true),
            ("animation.png", true),
            ("12.png", false),
            ("holiday.png", false),
            ("000012.jpg", false),
        ] {
            assert_eq!(is_ours(name), ours, "{name}");
        }
    }

    fn object(class: &str, motion: Motion, speed: f64) -> Object {
        Object {
            id: ObjectId(4),
            class: ClassId::from_name(class).unwrap(),
            score: 0.9,
            state: ObjectState::Confirmed,
            bounds: BoundingBox::default(),
            bounds_sigma: [0.0; 2],
            depth_range: None,
            position: Some(Vec3::zeros()),
            velocity: Some(Vec3::new(speed, 0.0, 0.0)),
            // Standard deviations of 0.5 m/s.
            covariance: Some(Mat6::identity() * 0.25),
            size: None,
            last_seen: 0.0,
            motion,
        }
    }

    #[test]
    fn movers_are_labelled_and_certain_speeds_are_shown() {
        let style = |labels| Style {
            labels,
            ..Style::default()
        };
        for (class, motion, speed, expected) in [
            ("person", Motion::Moving, 0.8, "person 4  0.8 m/s"),
            ("person", Motion::Moving, 0.3, "person 4"),
            ("person", Motion::Unknown, 0.8, "person 4"),
            ("person", Motion::Parked, 0.8, "person 4 parked"),
            ("chair", Motion::Moving, 1.6, "chair 4  1.6 m/s"),
            // Someone walks past it.
            ("chair", Motion::Moving, 0.8, ""),
            ("chair", Motion::Unknown, 0.8, ""),
        ] {
            let object = object(class, motion, speed);
            let drawn = overlay_box(&object, &style(Labels::Movers));
            assert_eq!(drawn.label, expected, "{class} {motion:?} {speed}");
            assert_eq!(drawn.quiet, expected.is_empty());
            assert_eq!(overlay_box(&object, &style(Labels::None)).label, "");
            let all = overlay_box(&object, &style(Labels::All)).label;
            assert!(all.starts_with(class), "{all}");
        }
        let chair = object("chair", Motion::Unknown, 0.8);
        assert_eq!(overlay_box(&chair, &style(Labels::All)).label, "chair 4");
    }

    #[test]
    fn the_colour_is_that_of_the_reason_that_says_most() {
        let all = Reasons::AGE | Reasons::RIGID | Reasons::OBJECT;
        assert_eq!(colour_of(all), Colour::SEMANTIC);
        assert_eq!(colour_of(Reasons::AGE | Reasons::RIGID), Colour::RIGID);
        assert_eq!(colour_of(Reasons::AGE), Colour::HISTORY);
    }
}

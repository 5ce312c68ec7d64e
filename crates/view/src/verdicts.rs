//! Draws the system's results over a frame: verdicts, objects, moving regions.

use crate::colour::Colour;
use crate::draw::draw;
use crate::overlay::{Keypoint, Mark, Overlay, OverlayBox};
use crate::picture::Picture;
use crate::speed::{certain_speed, is_moving_thing};
use stillpoint_detection::{Motion, MotionWeights, Object, ObjectState};
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::{FrameReport, FrameState, MOVER, Outcome, Reasons};

/// Which objects are drawn, and whether they have names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Labels {
    /// Every object with its name, including tentative and static ones.
    All,
    /// Confirmed objects of classes that move by themselves, and others seen moving, with names.
    #[default]
    Movers,
    /// Like `Movers`, without names.
    None,
}

/// Style of the drawing.
#[derive(Clone, Debug, Default)]
pub struct Style {
    /// No lines under the image, which keeps its size.
    pub bare: bool,
    /// Which objects are drawn, and whether they have names.
    pub labels: Labels,
    /// Motion weights of the classes.
    pub weights: MotionWeights,
}

impl Style {
    /// Whether an object may move by itself, or is moving.
    fn mover(&self, object: &Object) -> bool {
        self.weights.get(object.class) >= MOVER || is_moving_thing(object)
    }

    /// Whether it is drawn. Unconfirmed objects may be false alarms, and hidden ones are not in the image.
    fn shown(&self, object: &Object) -> bool {
        let seen = matches!(object.state, ObjectState::Confirmed | ObjectState::Coasting);
        self.labels == Labels::All || (seen && self.mover(object))
    }

    fn labelled(&self, object: &Object) -> bool {
        match self.labels {
            Labels::All => true,
            Labels::Movers => self.mover(object),
            Labels::None => false,
        }
    }
}

/// A frame with the system's results. Boxes of likelier movers are drawn on top.
#[must_use]
pub fn picture(frame: &RgbdFrame, report: &FrameReport, style: &Style) -> Picture {
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
    let shown = |object: &&Object| style.shown(object);
    let mut objects: Vec<&Object> = report.objects.iter().filter(shown).collect();
    let weight = |object: &Object| style.weights.get(object.class);
    objects.sort_by(|a, b| weight(a).total_cmp(&weight(b)));
    let boxes = objects.into_iter().map(|object| overlay_box(object, style));
    let boxes: Vec<OverlayBox> = boxes.collect();
    let mask = (!report.segments.labels.is_empty()).then(|| report.segments.mask(frame));
    let (caption, badge) = (caption(report), badge(report.state()));
    draw(
        frame,
        &Overlay {
            keypoints: &keypoints,
            boxes: &boxes,
            region: mask.as_ref(),
            badge: (!style.bare).then_some((&badge.0, badge.1)),
            caption: if style.bare { "" } else { &caption },
            legend: !style.bare,
        },
    )
}

/// The colour of the most informative reason.
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

/// Name, and speed if the rigid test shows motion and the speed exceeds its standard deviation.
fn label(object: &Object) -> String {
    let doubt = match object.state {
        ObjectState::Tentative => "?",
        ObjectState::Confirmed => "",
        ObjectState::Coasting | ObjectState::Hidden => " predicted",
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

/// The frame's state, in the word of `frames.csv`.
fn badge(state: FrameState) -> (String, Colour) {
    let colour = match state {
        FrameState::Tracked => Colour::STATIC,
        FrameState::Lost => Colour::SEMANTIC,
        FrameState::Begun
        | FrameState::Relocalised
        | FrameState::Undecided
        | FrameState::Carried => Colour::of_number(0),
    };
    (state.name().to_uppercase(), colour)
}

/// A short state line beside the badge.
fn caption(report: &FrameReport) -> String {
    let c = &report.counts;
    let mut parts = vec![format!("frame {}", report.frame)];
    parts.extend(report.loss());
    match report.outcome {
        Outcome::Lost { .. } | Outcome::Initialised => {}
        Outcome::Carried { .. } => parts.push("direction by the gyroscope".to_owned()),
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
    use crate::speed::tests::object;

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
            // A person walks past it.
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
        let mut chair = object("chair", Motion::Unknown, 0.8);
        assert_eq!(overlay_box(&chair, &style(Labels::All)).label, "chair 4");
        chair.state = ObjectState::Coasting;
        let predicted = overlay_box(&chair, &style(Labels::All));
        assert!(predicted.coasting && predicted.label == "chair 4 predicted");
    }

    #[test]
    fn only_confirmed_movers_are_drawn_by_default() {
        let style = |labels| Style {
            labels,
            ..Style::default()
        };
        for (class, state, drawn) in [
            ("person", ObjectState::Confirmed, true),
            ("person", ObjectState::Coasting, true),
            ("person", ObjectState::Tentative, false),
            ("person", ObjectState::Hidden, false),
            ("chair", ObjectState::Confirmed, false),
        ] {
            let mut object = object(class, Motion::Unknown, 0.0);
            object.state = state;
            assert_eq!(style(Labels::Movers).shown(&object), drawn, "{object:?}");
            assert_eq!(style(Labels::None).shown(&object), drawn, "{object:?}");
            assert!(style(Labels::All).shown(&object));
        }
        let carried = object("chair", Motion::Moving, 1.6);
        assert!(style(Labels::Movers).shown(&carried));
    }

    #[test]
    fn state_banners_use_the_words_of_frames_csv() {
        let page = include_str!("report/page/data.js");
        let words = FrameState::ALL.map(|state| format!("\"{}\"", state.name()));
        let expected = format!("const STATES = [{}];", words.join(", "));
        assert!(page.contains(&expected), "{expected}");
        for state in FrameState::ALL {
            assert_eq!(badge(state).0.to_lowercase(), state.name());
        }
    }

    #[test]
    fn colour_shows_the_strongest_reason() {
        let all = Reasons::AGE | Reasons::RIGID | Reasons::OBJECT;
        assert_eq!(colour_of(all), Colour::SEMANTIC);
        assert_eq!(colour_of(Reasons::AGE | Reasons::RIGID), Colour::RIGID);
        assert_eq!(colour_of(Reasons::AGE), Colour::HISTORY);
    }
}

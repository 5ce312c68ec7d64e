//! Contents of images: marks, boxes, labels, regions, captions, legend; drawing never fails.

use proptest::prelude::*;
use std::sync::Arc;
use stillpoint_detection::{BoundingBox, ClassId, Motion, Object, ObjectId, ObjectState};
use stillpoint_geometry::{Mat6, Vec3};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint_view::{
    Colour, Mark, Overlay, OverlayBox, Picture, certain_speed, draw, side_by_side,
};

const GREY: u8 = 120;

fn frame(width: usize, height: usize) -> RgbdFrame {
    let n = width * height;
    RgbdFrame {
        id: FrameId(0),
        stamp: 0.0,
        depth_stamp: 0.0,
        gray: GrayImage::from_vec(width, height, vec![GREY; n]).unwrap(),
        colour: None,
        depth: DepthImage::from_vec(width, height, vec![0.0; n]).unwrap(),
    }
}

fn object(bounds: [f64; 4], label: &str, coasting: bool) -> OverlayBox {
    let [x0, y0, x1, y1] = bounds;
    OverlayBox {
        bounds: BoundingBox { x0, y0, x1, y1 },
        label: label.to_owned(),
        colour: Colour::of_number(1),
        coasting,
        quiet: false,
    }
}

/// Number of pixels of a colour in the given columns and rows.
fn count(
    picture: &Picture,
    colour: Colour,
    x: std::ops::Range<usize>,
    y: std::ops::Range<usize>,
) -> usize {
    y.flat_map(|y| x.clone().map(move |x| (x, y)))
        .filter(|&(x, y)| picture.at(x, y) == Some(colour))
        .count()
}

/// Number of pixels within 60 of a colour in each channel, to allow for smooth edges.
fn count_near(
    picture: &Picture,
    colour: Colour,
    x: std::ops::Range<usize>,
    y: std::ops::Range<usize>,
) -> usize {
    y.flat_map(|y| x.clone().map(move |x| (x, y)))
        .filter_map(|(x, y)| picture.at(x, y))
        .filter(|c| {
            c.0.abs_diff(colour.0) < 60
                && c.1.abs_diff(colour.1) < 60
                && c.2.abs_diff(colour.2) < 60
        })
        .count()
}

#[test]
fn marks_are_drawn_in_their_colours() {
    let reasons = [Colour::SEMANTIC, Colour::EPIPOLAR, Colour::DEPTH];
    let mut keypoints = vec![(20.3, 30.4, Mark::Static), (40.5, 30.0, Mark::Unused)];
    for (i, colour) in reasons.iter().enumerate() {
        keypoints.push((60.0 + 20.0 * i as f32, 30.0, Mark::Dynamic(*colour)));
    }
    let overlay = Overlay {
        keypoints: &keypoints,
        ..Overlay::default()
    };
    let picture = draw(&frame(640, 480), &overlay);
    assert_eq!((picture.width(), picture.height()), (640, 480));
    assert_eq!(picture.at(20, 30), Some(Colour::STATIC));
    assert_eq!(picture.at(40, 30), Some(Colour::UNUSED));
    for (i, colour) in reasons.iter().enumerate() {
        let x = 60 + 20 * i;
        assert_eq!(picture.at(x, 30), Some(*colour));
        // The ring, apart from the disc inside.
        assert_eq!(count_near(&picture, *colour, x + 4..x + 5, 30..31), 1);
        assert_ne!(picture.at(x + 7, 30), Some(*colour));
    }
    let none = |x: usize, y: usize| picture.at(x, y) == Some(Colour(GREY, GREY, GREY));
    assert!(none(300, 300) && none(20, 40) && none(30, 30));
}

#[test]
fn rejected_feature_is_not_hidden_by_a_static_one() {
    let keypoints = [
        (50.0, 50.0, Mark::Dynamic(Colour::SEMANTIC)),
        (50.0, 50.0, Mark::Static),
        (50.0, 50.0, Mark::Unused),
    ];
    let overlay = Overlay {
        keypoints: &keypoints,
        ..Overlay::default()
    };
    let picture = draw(&frame(640, 480), &overlay);
    assert_eq!(picture.at(50, 50), Some(Colour::SEMANTIC));
}

#[test]
fn boxes_have_frames_and_labels() {
    let colour = Colour::of_number(1);
    let boxes = [object(
        [100.0, 100.0, 300.0, 400.0],
        "person 3 0.8 m/s",
        false,
    )];
    let overlay = Overlay {
        boxes: &boxes,
        ..Overlay::default()
    };
    let picture = draw(&frame(640, 480), &overlay);
    for (x, y) in [(101, 250), (299, 250), (250, 101), (200, 399)] {
        assert_eq!(picture.at(x, y), Some(colour), "{x} {y}");
    }
    assert_eq!(picture.at(200, 250), Some(Colour(GREY, GREY, GREY)));
    // The label is above the box: text on a background of the box's colour, capitals at least 12 px high, so that it is legible at half
    // size.
    let ink = if count(&picture, Colour::WHITE, 100..300, 70..100) > 0 {
        Colour::WHITE
    } else {
        Colour::BLACK
    };
    let rows: Vec<usize> = (0..100)
        .filter(|&y| count(&picture, ink, 100..300, y..y + 1) > 0)
        .collect();
    assert!((12..=20).contains(&rows.len()), "{rows:?}");
    assert!(rows[0] > 74, "{rows:?}");
    let ground = count(&picture, colour, 100..300, 74..100);
    assert!(ground > 1000, "{ground} px");

    // A coasting box lacks half of its frame, with no other difference.
    let boxes = [object([100.0, 100.0, 300.0, 400.0], "", true)];
    let dashed = draw(
        &frame(640, 480),
        &Overlay {
            boxes: &boxes,
            ..Overlay::default()
        },
    );
    let full = count(&picture, colour, 100..102, 110..400);
    let part = count(&dashed, colour, 100..102, 110..400);
    assert!(part * 3 > full && part * 3 < 2 * full, "{part} of {full}");
}

#[test]
fn quiet_box_is_thin_and_pale() {
    let boxes = [OverlayBox {
        quiet: true,
        ..object([100.0, 100.0, 300.0, 400.0], "", false)
    }];
    let overlay = Overlay {
        boxes: &boxes,
        ..Overlay::default()
    };
    let picture = draw(&frame(640, 480), &overlay);
    assert_eq!(count(&picture, boxes[0].colour, 0..640, 0..480), 0);
    let grey = Some(Colour(GREY, GREY, GREY));
    let line: Vec<_> = (95..106).map(|x| picture.at(x, 250)).collect();
    let line: Vec<_> = line.into_iter().filter(|c| *c != grey).flatten().collect();
    // A pale line is translucent.
    assert_eq!(line.len(), 1);
    assert!(line[0].0 > GREY && line[0].0 < Colour::THING.0);
}

#[test]
fn labels_do_not_overlap() {
    let bounds = [200.0, 200.0, 320.0, 420.0];
    let boxes = [1, 2, 3].map(|n| OverlayBox {
        colour: Colour::of_number(n),
        ..object(bounds, "person 7", false)
    });
    let of = |boxes: &[OverlayBox]| {
        let overlay = Overlay {
            boxes,
            ..Overlay::default()
        };
        draw(&frame(640, 480), &overlay)
    };
    let together = of(&boxes);
    for b in &boxes {
        let alone = of(&[OverlayBox {
            label: String::new(),
            ..b.clone()
        }]);
        let frame = count(&alone, b.colour, 0..640, 0..480);
        let plate = count(&of(std::slice::from_ref(b)), b.colour, 0..640, 0..480) - frame;
        let found = count(&together, b.colour, 0..640, 0..480);
        assert!(found * 10 > plate * 9, "{found} of {plate} px");
    }
}

#[test]
fn labels_stay_inside_the_picture() {
    let colour = Colour::of_number(1);
    for bounds in [
        [-50.0, -50.0, 60.0, 60.0],
        [600.0, 2.0, 900.0, 900.0],
        [500.0, 470.0, 639.0, 479.0],
    ] {
        let with = |label| {
            let boxes = [object(bounds, label, false)];
            let overlay = Overlay {
                boxes: &boxes,
                ..Overlay::default()
            };
            draw(&frame(640, 480), &overlay)
        };
        let count = |p: &Picture| count(p, colour, 0..640, 0..480);
        let label = count(&with("person 3 0.8 m/s")) - count(&with(""));
        assert!(label > 1000, "{bounds:?}: {label} px");
    }
}

#[test]
fn caption_adds_a_line_below() {
    let overlay = Overlay {
        badge: Some(("TRACKED", Colour::STATIC)),
        caption: "frame 12, 185 inliers",
        ..Overlay::default()
    };
    let picture = draw(&frame(320, 240), &overlay);
    assert!(picture.height() > 240 + 7);
    let rows = 240..picture.height();
    assert!(count_near(&picture, Colour::WHITE, 0..320, rows.clone()) > 150);
    assert!(count(&picture, Colour::STATIC, 0..320, rows) > 300);
    assert_eq!(count(&picture, Colour::WHITE, 0..320, 0..240), 0);
}

#[test]
fn legend_adds_equal_height_to_every_picture() {
    let of = |caption, legend| {
        let overlay = Overlay {
            caption,
            legend,
            ..Overlay::default()
        };
        draw(&frame(640, 480), &overlay)
    };
    let (none, caption, both) = (of("", false), of("a", false), of("a", true));
    assert_eq!(none.height(), 480);
    assert!(both.height() > caption.height() + 10);
    assert_eq!(both.height(), of("something longer", true).height());
    let legend = caption.height()..both.height();
    for colour in [Colour::STATIC, Colour::SEMANTIC, Colour::RIGID] {
        assert!(
            count(&both, colour, 0..640, legend.clone()) > 3,
            "{colour:?}"
        );
    }
    assert!(count(&both, Colour::WHITE, 0..640, legend) > 200);
}

#[test]
fn speed_is_certain_only_above_its_standard_deviation() {
    let object = |velocity: [f64; 3], sigmas: [f64; 3]| {
        let mut covariance = Mat6::identity();
        for i in 0..3 {
            covariance[(3 + i, 3 + i)] = sigmas[i] * sigmas[i];
        }
        Object {
            id: ObjectId(3),
            class: ClassId(0),
            score: 0.9,
            state: ObjectState::Confirmed,
            bounds: BoundingBox::default(),
            bounds_sigma: [0.0; 2],
            depth_range: None,
            position: Some(Vec3::zeros()),
            velocity: Some(Vec3::from(velocity)),
            covariance: Some(covariance),
            size: None,
            last_seen: 0.0,
            motion: Motion::Moving,
        }
    };
    let walker = object([0.6, 0.0, 0.8], [0.1, 0.1, 0.5]);
    assert!(certain_speed(&walker, 1.0).is_some_and(|v| (v - 1.0).abs() < 1e-12));
    // Along its direction the standard deviation is 0.4 m/s.
    assert!(certain_speed(&walker, 2.4).is_some());
    assert!(certain_speed(&walker, 2.6).is_none());
    // A chair.
    assert!(certain_speed(&object([0.8, 0.0, 0.0], [0.9; 3]), 1.0).is_none());
    assert!(certain_speed(&object([0.0; 3], [0.0; 3]), 1.0).is_none());
    assert!(certain_speed(&object([f64::NAN; 3], [0.1; 3]), 1.0).is_none());
    assert!(certain_speed(&object([1.0; 3], [f64::NAN; 3]), 1.0).is_none());
    let unknown = Object {
        velocity: None,
        ..walker
    };
    assert!(certain_speed(&unknown, 1.0).is_none());
}

#[test]
fn colour_image_is_drawn_if_available() {
    let mut frame = frame(8, 8);
    let pixels = [10, 200, 30].repeat(64);
    frame.colour = Some(Arc::new(ColourImage::from_vec(8, 8, pixels).unwrap()));
    let picture = draw(&frame, &Overlay::default());
    assert_eq!(picture.at(3, 3), Some(Colour(10, 200, 30)));
}

#[test]
fn pictures_are_placed_side_by_side_under_titles() {
    let left = Picture::new(320, 200, Colour::STATIC);
    let right = Picture::new(320, 240, Colour::RIGID);
    let both = side_by_side(&left, &right, ["filter off", "filter on"]);
    assert!(both.width() > 640 && both.height() > 240 + 7);
    let top = both.height() - 240;
    assert_eq!(both.at(0, top), Some(Colour::STATIC));
    assert_eq!(both.at(0, top + 200), Some(Colour::WHITE));
    assert_eq!(
        both.at(both.width() - 1, both.height() - 1),
        Some(Colour::RIGID)
    );
    for columns in [0..320, both.width() - 320..both.width()] {
        assert!(count_near(&both, Colour::BLACK, columns, 0..top) > 80);
    }
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        -50.0..150.0,
        -1e12..1e12,
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(f64::MAX)
    ]
}

proptest! {
    #[test]
    fn drawing_never_fails(
        (width, height) in (0usize..90, 0usize..70),
        points in proptest::collection::vec((anything(), anything()), 0..8),
        boxes in proptest::collection::vec((proptest::array::uniform4(anything()), ".{0,30}", any::<bool>()), 0..4),
        (columns, rows) in (0usize..110, 0usize..90),
        values in proptest::collection::vec(any::<u8>(), 1..40),
        caption in ".{0,40}",
    ) {
        let keypoints: Vec<_> = points
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let mark = [Mark::Static, Mark::Unused, Mark::Dynamic(Colour::RIGID)][i % 3];
                (p.0 as f32, p.1 as f32, mark)
            })
            .collect();
        let values = values.iter().copied().cycle().take(columns * rows);
        let mask = GrayImage::from_vec(columns, rows, values.collect()).unwrap();
        let boxes: Vec<_> = boxes.iter().map(|(b, label, coasting)| object(*b, label, *coasting)).collect();
        let overlay = Overlay {
            keypoints: &keypoints,
            boxes: &boxes,
            region: Some(&mask),
            badge: (caption.len() > 20).then_some((&caption, Colour::STATIC)),
            caption: &caption,
            legend: caption.len() % 2 == 0,
        };
        let picture = draw(&frame(width, height), &overlay);
        prop_assert_eq!(picture.width(), width);
        prop_assert!(picture.height() >= height);
        prop_assert_eq!(picture.data().len(), 3 * picture.width() * picture.height());
        let both = side_by_side(&picture, &picture.halved(), [&caption, ""]);
        prop_assert!(both.width() >= width);
    }
}

//! Properties of splices, and a kidnapped camera from a real recording.

use crate::scripted::{PERIOD, SIZE, Script, script};
use proptest::prelude::*;
use stillpoint_datasets::{Clip, Dataset, FrameOptions, OpenOptions, Part, Splice, StampedPose};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::{FrameId, FrameSource, GrayImage, RgbdFrame, SourceError};

/// A part to play: a recording with skip and take, or black frames.
#[derive(Clone, Debug)]
enum Plan {
    Frames(Script, usize, Option<usize>),
    Black(usize),
}

impl Plan {
    fn part(&self) -> Part {
        match self {
            Self::Black(n) => Part::Black(*n),
            Self::Frames(script, skip, take) => {
                let clip = Clip::new(script.source()).skip(*skip);
                let clip = match take {
                    Some(n) => clip.take(*n),
                    None => clip,
                };
                Part::Frames(clip.with_truth(script.truth()))
            }
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Black(n) => *n,
            Self::Frames(script, skip, take) => take.unwrap_or(script.frames.len() - skip),
        }
    }
}

fn splice(plans: &[Plan]) -> Splice {
    Splice::new(plans.iter().map(Plan::part).collect(), PERIOD).unwrap()
}

fn clip() -> impl Strategy<Value = Plan> {
    (
        script(),
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        any::<bool>(),
    )
        .prop_map(|(mut script, skip, take, all)| {
            let skip = skip.index(script.frames.len());
            script.frames[skip].1 = true;
            let left = script.frames.len() - skip;
            let take = (!all).then(|| 1 + take.index(left));
            Plan::Frames(script, skip, take)
        })
}

fn plans() -> impl Strategy<Value = Vec<Plan>> {
    let more = prop_oneof![clip(), (0..5_usize).prop_map(Plan::Black)];
    (clip(), prop::collection::vec(more, 0..5)).prop_map(|(first, mut rest)| {
        rest.insert(0, first);
        rest
    })
}

type Items = Vec<Result<RgbdFrame, SourceError>>;

fn play(splice: &mut Splice) -> Items {
    std::iter::from_fn(|| splice.next_frame()).collect()
}

proptest! {
    #[test]
    fn every_planned_frame_comes_in_order(plans in plans()) {
        let mut splice = splice(&plans);
        let total: usize = plans.iter().map(Plan::len).sum();
        let mut id = 0;
        for (number, plan) in plans.iter().enumerate() {
            for k in 0..plan.len() {
                prop_assert_eq!(splice.remaining(), Some(total - id));
                let item = splice.next_frame().unwrap();
                let origin = splice.origin(FrameId(id as u32));
                match plan {
                    Plan::Frames(script, skip, _) if script.frames[skip + k].1 => {
                        let (frame, own) = (item.unwrap(), script.frame(skip + k));
                        prop_assert_eq!(frame.id, FrameId(id as u32));
                        prop_assert_eq!(&frame.gray, &own.gray);
                        prop_assert_eq!(&frame.depth, &own.depth);
                        prop_assert_eq!(&frame.colour, &own.colour);
                        let lag = frame.depth_stamp - frame.stamp;
                        prop_assert!((lag - (own.depth_stamp - own.stamp)).abs() < 1e-6);
                        let origin = origin.unwrap();
                        prop_assert_eq!((origin.part, origin.id), (number, own.id));
                        prop_assert_eq!(origin.stamp.to_bits(), own.stamp.to_bits());
                    }
                    Plan::Frames(..) => {
                        let error = item.unwrap_err();
                        prop_assert!(error.recoverable);
                        prop_assert_eq!(error.message, format!("part {number}: unreadable"));
                        prop_assert_eq!(origin, None);
                    }
                    Plan::Black(_) => {
                        let frame = item.unwrap();
                        prop_assert_eq!(frame.id, FrameId(id as u32));
                        prop_assert_eq!(origin, None);
                        prop_assert_eq!(&frame.gray, &GrayImage::new(SIZE[0], SIZE[1]));
                        let depth = frame.depth;
                        prop_assert_eq!([depth.width(), depth.height()], SIZE);
                        prop_assert!(depth.data().iter().all(|z| *z == 0.0));
                        prop_assert!(frame.colour.is_none_or(|c| c.data() == [0; 36]));
                    }
                }
                id += 1;
            }
        }
        prop_assert_eq!(splice.remaining(), Some(0));
        prop_assert!(splice.next_frame().is_none());
    }

    #[test]
    fn splice_stamps_keep_source_steps_and_join_by_a_period(plans in plans()) {
        let mut splice = splice(&plans);
        let frames: Vec<RgbdFrame> = play(&mut splice).into_iter().flatten().collect();
        prop_assert_eq!(frames[0].stamp, 0.0);
        for pair in frames.windows(2) {
            let step = pair[1].stamp - pair[0].stamp;
            let [a, b] = [&pair[0], &pair[1]].map(|f| splice.origin(f.id));
            let expected = match (a, b) {
                (Some(a), Some(b)) if a.part == b.part => b.stamp - a.stamp,
                _ => PERIOD,
            };
            prop_assert!(step > 0.0 && (step - expected).abs() < 1e-6, "{step} for {expected}");
        }
    }

    #[test]
    fn splice_ground_truth_follows_the_new_stamps(plans in plans()) {
        let mut splice = splice(&plans);
        prop_assert!(splice.ground_truth().is_empty());
        let frames: Vec<RgbdFrame> = play(&mut splice).into_iter().flatten().collect();
        let truth = splice.ground_truth();
        prop_assert!(truth.windows(2).all(|w| w[0].stamp < w[1].stamp));
        for frame in &frames {
            // Frame and truth have equal stamps, so that equal poses stay equal to the last bit.
            let found = truth.iter().find(|p| p.stamp == frame.stamp).map(|p| p.world_from_camera);
            let expected = splice.origin(frame.id).map(|origin| match &plans[origin.part] {
                Plan::Frames(script, ..) => script.pose(origin.id.0 as usize),
                Plan::Black(_) => unreachable!("black frames have no origin"),
            });
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn splice_is_deterministic(plans in plans()) {
        let (mut a, mut b) = (splice(&plans), splice(&plans));
        let (one, two) = (play(&mut a), play(&mut b));
        prop_assert_eq!(format!("{one:?}"), format!("{two:?}"));
        prop_assert_eq!(a.ground_truth(), b.ground_truth());
    }
}

fn end_of(parts: Vec<Part>) -> SourceError {
    let mut splice = Splice::new(parts, PERIOD).unwrap();
    let error = play(&mut splice).pop().unwrap().unwrap_err();
    assert!(!error.recoverable);
    assert_eq!(splice.remaining(), Some(0));
    assert!(splice.next_frame().is_none());
    error
}

#[test]
fn failing_splice_part_ends_the_stream_with_an_error() {
    let five = || Clip::new(Script::regular(1, 5).source());
    let check = |parts, expected: &str| assert_eq!(end_of(parts).message, expected);
    check(
        vec![Part::Frames(five()), Part::Frames(five().skip(2).take(4))],
        "part 1: expected at least 6 frames in the source, found 5; skip or take fewer",
    );
    check(
        vec![Part::Frames(five().skip(5))],
        "part 0: expected at least 6 frames in the source, found 5; skip or take fewer",
    );
    check(
        vec![Part::Frames(five().skip(9).take(1))],
        "part 0: expected at least 10 frames in the source, found 5; skip or take fewer",
    );
    let mut wide = Script::regular(2, 2);
    wide.size = [8, 3];
    check(
        vec![
            Part::Frames(five()),
            Part::Black(1),
            Part::Frames(Clip::new(wide.source())),
        ],
        "part 2, frame 0: expected 4 x 3 px as before, found 8 x 3 px; join recordings of one camera",
    );
    let mut back = Script::regular(3, 3);
    back.frames[2].0 = 0.01;
    check(
        vec![Part::Frames(Clip::new(back.source()))],
        "part 0, frame 2: expected a stamp after 0.033333, found 0.010000; repair the recording",
    );
    back.frames[0].0 = f64::NAN;
    check(
        vec![Part::Frames(Clip::new(back.source()))],
        "part 0, frame 0: expected a finite stamp, found NaN; repair the recording",
    );
    let mut broken = Script::regular(4, 1);
    broken.frames[0].1 = false;
    check(
        vec![Part::Frames(Clip::new(broken.source())), Part::Black(1)],
        "part 1: expected a readable frame before the black ones, found none; check the first part",
    );
}

#[test]
fn invalid_splices_are_refused() {
    let five = || Clip::new(Script::regular(1, 5).source());
    let check = |parts, period, expected: &str| {
        let error = Splice::new(parts, period).err().unwrap();
        assert_eq!(error.to_string(), expected);
    };
    let first = "expected frames of a source at first, found ";
    check(vec![], PERIOD, &format!("{first}no parts"));
    let black = vec![Part::Black(3), Part::Frames(five())];
    check(
        black,
        PERIOD,
        &format!("{first}black frames, whose size nothing tells"),
    );
    check(
        vec![Part::Frames(five()), Part::Frames(five().take(0))],
        PERIOD,
        "expected at least one frame to take in part 1, found 0",
    );
    for (period, found) in [
        (0.0, "0"),
        (-1.0, "-1"),
        (f64::NAN, "NaN"),
        (f64::INFINITY, "inf"),
    ] {
        let expected = format!("expected a positive period in seconds, found {found}");
        check(vec![Part::Frames(five())], period, &expected);
    }
}

#[test]
fn ground_truth_is_cut_to_the_frames_and_stays_between() {
    let script = Script::regular(5, 10);
    // Three poses per frame, from a second before the recording to a second after it.
    let dense: Vec<StampedPose> = (-90..120)
        .map(|k| StampedPose {
            stamp: f64::from(k) * PERIOD / 3.0,
            world_from_camera: Se3::new(Default::default(), Vec3::new(f64::from(k), 0.0, 0.0)),
        })
        .collect();
    let clip = |skip| {
        Clip::new(script.source())
            .skip(skip)
            .take(4)
            .with_truth(dense.clone())
    };
    let parts = vec![Part::Frames(clip(6)), Part::Frames(clip(0))];
    let mut splice = Splice::new(parts, PERIOD).unwrap();
    assert_eq!(play(&mut splice).len(), 8);
    let at: Vec<f64> = splice
        .ground_truth()
        .iter()
        .map(|p| p.world_from_camera.translation.x)
        .collect();
    // Frames 6 to 9 are poses 18 to 27; a third of a period before and after is within the margin.
    let expected: Vec<f64> = (17..=28).chain(-1..=10).map(f64::from).collect();
    assert_eq!(at, expected);
    assert!(
        splice
            .ground_truth()
            .windows(2)
            .all(|w| w[0].stamp < w[1].stamp)
    );
}

/// The second half of a real recording, a second of darkness, then the first half: a kidnapped camera.
#[test]
fn swapped_halves_of_a_real_recording_are_spliced() {
    let Some(path) = stillpoint_testdata::recording("fr1_xyz") else {
        return;
    };
    let dataset = Dataset::open(&path, &OpenOptions::default()).unwrap();
    let truth = dataset.ground_truth().unwrap().unwrap();
    let half = |start| {
        let options = FrameOptions {
            start,
            ..FrameOptions::default()
        };
        let frames = dataset.frames(&options).unwrap();
        Part::Frames(Clip::new(frames).take(20).with_truth(truth.clone()))
    };
    let parts = vec![half(150), Part::Black(30), half(0)];
    let mut splice = Splice::new(parts, PERIOD).unwrap();
    let frames: Vec<RgbdFrame> = play(&mut splice).into_iter().map(Result::unwrap).collect();
    assert_eq!(frames.len(), 70);
    let new = splice.ground_truth();
    for (k, frame) in frames.iter().enumerate() {
        let near = |poses: &[StampedPose], stamp: f64| {
            let by = |p: &&StampedPose| ((p.stamp - stamp).abs() * 1e9) as u64;
            let p = poses.iter().min_by_key(by).unwrap();
            (p.stamp - stamp, p.world_from_camera)
        };
        let (off, pose) = near(&new, frame.stamp);
        let black = (20..50).contains(&k);
        assert_eq!(splice.origin(frame.id).is_none(), black);
        if black {
            assert!(frame.gray.data().iter().all(|v| *v == 0));
            continue;
        }
        let entry = &dataset.entries()[if k < 20 { 150 + k } else { k - 50 }];
        let (own_off, own) = near(&truth, entry.stamp);
        assert_eq!(splice.origin(frame.id).unwrap().stamp, entry.stamp);
        assert_eq!(pose, own, "frame {k}");
        assert!(
            (off - own_off).abs() < 1e-6 && off.abs() < 0.01,
            "frame {k}: {off} s"
        );
        assert!(frame.depth.data().iter().any(|z| *z > 0.0));
    }
}

//! Laws of disturbances.
#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod scripted;

use proptest::prelude::*;
use scripted::{Script, script};
use stillpoint_datasets::{Disturbance, Disturbed};
use stillpoint_imaging::FrameSource;

proptest! {
    #[test]
    fn disturbances_touch_their_frames_alone(
        script in script(),
        start in 0..10_u32,
        count in 1..5_u32,
        gain in 0.0..4.0_f64,
    ) {
        let ids = start..start + count;
        for what in [Disturbance::Black, Disturbance::Covered, Disturbance::Exposure(gain)] {
            let mut source = Disturbed::new(script.source(), vec![(ids.clone(), what)]).unwrap();
            prop_assert_eq!(source.remaining(), Some(script.frames.len()));
            let mut plain = script.source();
            while let Some(item) = source.next_frame() {
                let (Ok(frame), Ok(own)) = (item, plain.next_frame().unwrap()) else { continue };
                prop_assert_eq!((frame.id, frame.stamp, frame.depth_stamp), (own.id, own.stamp, own.depth_stamp));
                prop_assert_eq!(frame.colour.is_some(), own.colour.is_some());
                if let Some(colour) = &frame.colour {
                    prop_assert_eq!(&colour.to_gray(), &frame.gray);
                }
                if !ids.contains(&frame.id.0) {
                    prop_assert_eq!((frame.gray, frame.depth), (own.gray, own.depth));
                    continue;
                }
                let blind = !matches!(what, Disturbance::Exposure(_));
                let no_depth = frame.depth.data().iter().all(|z| *z == 0.0);
                prop_assert_eq!(no_depth, blind);
                for (now, was) in frame.gray.data().iter().zip(own.gray.data()) {
                    let fits = match what {
                        Disturbance::Black => *now == 0,
                        Disturbance::Covered => (2..=6).contains(now),
                        Disturbance::Exposure(g) => {
                            (f64::from(*now) - (g * f64::from(*was)).min(255.0)).abs() <= 0.5
                        }
                    };
                    prop_assert!(fits, "{now} of {was} by {what:?}");
                }
            }
            prop_assert!(plain.next_frame().is_none());
        }
    }
}

#[test]
fn impossible_disturbances_are_refused() {
    let check = |ids: std::ops::Range<u32>, what, expected: &str| {
        let error = Disturbed::new(Script::regular(1, 3).source(), vec![(ids, what)]).err();
        assert_eq!(error.unwrap().to_string(), expected);
    };
    check(
        4..4,
        Disturbance::Black,
        "expected a range of frame ids, found 4 to before 4",
    );
    let factor = "expected a factor of exposure of 0 or more, found ";
    check(0..1, Disturbance::Exposure(-0.5), &format!("{factor}-0.5"));
    check(
        0..1,
        Disturbance::Exposure(f64::NAN),
        &format!("{factor}NaN"),
    );
}

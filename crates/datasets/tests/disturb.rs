//! Properties of disturbances.

use crate::scripted::{SIZE, Script, script};
use proptest::prelude::*;
use stillpoint_datasets::{Disturbance, Disturbed};
use stillpoint_imaging::FrameSource;

proptest! {
    #[test]
    fn disturbances_change_only_their_frames(
        script in script(),
        start in 0..10_u32,
        count in 1..5_u32,
        gain in 0.0..4.0_f64,
    ) {
        let ids = start..start + count;
        let all = [
            Disturbance::Black, Disturbance::Covered, Disturbance::Exposure(gain), Disturbance::Saturated,
            Disturbance::Blurred(2), Disturbance::NoDepth, Disturbance::HalfDepth,
        ];
        for what in all {
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
                let blind = matches!(what, Disturbance::Black | Disturbance::Covered | Disturbance::NoDepth);
                let half = what == Disturbance::HalfDepth;
                let w = frame.depth.width();
                for (i, (z, was)) in frame.depth.data().iter().zip(own.depth.data()).enumerate() {
                    let gone = blind || half && i % w >= w / 2;
                    prop_assert_eq!(*z, if gone { 0.0 } else { *was });
                }
                for (now, was) in frame.gray.data().iter().zip(own.gray.data()) {
                    let fits = match what {
                        Disturbance::Black => *now == 0,
                        Disturbance::Covered => (2..=6).contains(now),
                        // A uniform image is its own mean.
                        Disturbance::Blurred(_) | Disturbance::NoDepth | Disturbance::HalfDepth => now == was,
                        Disturbance::Saturated => *now == 255,
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

#[test]
fn blurred_pixel_is_the_mean_of_its_neighbourhood() {
    let [w, h] = SIZE;
    let level = |i: usize| ((i * 37) % 200) as u8;
    struct One(Option<stillpoint_imaging::RgbdFrame>);
    impl FrameSource for One {
        fn next_frame(
            &mut self,
        ) -> Option<Result<stillpoint_imaging::RgbdFrame, stillpoint_imaging::SourceError>>
        {
            self.0.take().map(Ok)
        }
    }
    for radius in [0, 1, 2, 9] {
        let mut frame = Script::regular(1, 1).frame(0);
        frame.colour = None;
        for (i, v) in frame.gray.data_mut().iter_mut().enumerate() {
            *v = level(i);
        }
        let when = vec![(0..1, Disturbance::Blurred(radius))];
        let mut source = Disturbed::new(One(Some(frame)), when).unwrap();
        let blurred = source.next_frame().unwrap().unwrap().gray;
        for (i, found) in blurred.data().iter().enumerate() {
            let near =
                |j: &usize| (j % w).abs_diff(i % w) <= radius && (j / w).abs_diff(i / w) <= radius;
            let around: Vec<f64> = (0..w * h).filter(near).map(|j| level(j).into()).collect();
            let mean = around.iter().sum::<f64>() / around.len() as f64;
            assert!((f64::from(*found) - mean).abs() <= 0.5, "{radius}, {i}");
        }
    }
}

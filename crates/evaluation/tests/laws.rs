//! Properties that hold for any trajectory.

use proptest::prelude::*;
use stillpoint_evaluation::{
    Delta, EvalOptions, EvaluationError, Score, TimedPose, drift, evaluate, score,
};
use stillpoint_geometry::{Se3, Vec3, so3};

fn vec3(limit: f64) -> impl Strategy<Value = Vec3> {
    proptest::array::uniform3(-limit..limit).prop_map(Vec3::from)
}

fn pose() -> impl Strategy<Value = Se3> {
    (vec3(1.5), vec3(3.0)).prop_map(|(w, t)| Se3::new(so3::exp(&w), t))
}

fn trajectory(poses: &[Se3]) -> Vec<TimedPose> {
    poses
        .iter()
        .enumerate()
        .map(|(i, p)| TimedPose {
            stamp: i as f64 * 0.1,
            world_from_camera: *p,
        })
        .collect()
}

fn map(poses: &[TimedPose], f: impl Fn(&Se3) -> Se3) -> Vec<TimedPose> {
    poses
        .iter()
        .map(|p| TimedPose {
            stamp: p.stamp,
            world_from_camera: f(&p.world_from_camera),
        })
        .collect()
}

fn options(with_scale: bool) -> EvalOptions {
    EvalOptions {
        with_scale,
        delta: Delta::Frames(2),
        ..EvalOptions::default()
    }
}

proptest! {
    #[test]
    fn rigidly_moved_copy_has_no_error(poses in proptest::collection::vec(pose(), 5..30), a in pose()) {
        let truth = trajectory(&poses);
        let e = evaluate(&truth, &map(&truth, |p| a * *p), &options(false)).unwrap();
        prop_assert!(e.ate.statistics.max < 1e-9);
        let rpe = e.rpe.unwrap();
        prop_assert!(rpe.translation.max < 1e-9 && rpe.rotation_deg.max < 1e-5);
    }

    #[test]
    fn errors_do_not_depend_on_the_frames_of_reference(
        poses in proptest::collection::vec((pose(), vec3(0.05), vec3(0.05)), 5..30), a in pose(), b in pose()
    ) {
        let truth = trajectory(&poses.iter().map(|p| p.0).collect::<Vec<_>>());
        let estimate = trajectory(&poses.iter().map(|p| p.0 * Se3::new(so3::exp(&p.1), p.2)).collect::<Vec<_>>());
        for delta in [Delta::Frames(2), Delta::Seconds(0.2)] {
            let o = EvalOptions { delta, ..options(false) };
            let one = evaluate(&truth, &estimate, &o).unwrap();
            let two = evaluate(&map(&truth, |p| b * *p), &map(&estimate, |p| a * *p), &o).unwrap();
            prop_assert!((one.ate.statistics.rmse - two.ate.statistics.rmse).abs() < 1e-8);
            let (one, two) = (one.rpe.unwrap(), two.rpe.unwrap());
            prop_assert_eq!(one.pairs, two.pairs);
            prop_assert!((one.translation.rmse - two.translation.rmse).abs() < 1e-9);
            prop_assert!((one.rotation_deg.rmse - two.rotation_deg.rmse).abs() < 1e-6);
            prop_assert!(one.translation.rmse > 0.0);
        }
    }

    #[test]
    fn scale_is_found_and_removed(poses in proptest::collection::vec(pose(), 5..30), s in 0.2..5.0f64) {
        let truth = trajectory(&poses);
        let scaled = map(&truth, |p| Se3::new(p.rotation, p.translation * s));
        let e = evaluate(&truth, &scaled, &options(true)).unwrap();
        prop_assert!((e.ate.alignment.scale * s - 1.0).abs() < 1e-9);
        prop_assert!(e.ate.statistics.max < 1e-8 && e.rpe.unwrap().translation.max < 1e-8);
        // Without scale the error remains, unless there is none.
        let rigid = evaluate(&truth, &scaled, &options(false)).unwrap();
        prop_assert!(rigid.ate.statistics.rmse + 1e-12 >= e.ate.statistics.rmse);
    }

    #[test]
    fn alignment_is_optimal(
        poses in proptest::collection::vec((pose(), vec3(0.1)), 5..20), trial in (vec3(0.01), vec3(0.01))
    ) {
        let truth = trajectory(&poses.iter().map(|p| p.0).collect::<Vec<_>>());
        let estimate = map(&truth, |p| *p);
        let noisy: Vec<TimedPose> = estimate.iter().zip(&poses).map(|(e, p)| TimedPose {
            stamp: e.stamp,
            world_from_camera: Se3::new(e.world_from_camera.rotation, e.world_from_camera.translation + p.1),
        }).collect();
        let ate = evaluate(&truth, &noisy, &options(false)).unwrap().ate;
        let other = Se3::new(so3::exp(&trial.0), trial.1);
        let square: f64 = ate.pairs.iter().map(|p| (other.transform(&p.estimate) - p.reference).norm_squared()).sum();
        let rmse = (square / ate.pairs.len() as f64).sqrt();
        prop_assert!(ate.statistics.rmse <= rmse + 1e-12);
    }
}

fn line(n: usize) -> Vec<TimedPose> {
    let at = |i| Vec3::new(i as f64, (i * i % 7) as f64, 0.0);
    trajectory(
        &(0..n)
            .map(|i| Se3::new(so3::exp(&Vec3::zeros()), at(i)))
            .collect::<Vec<_>>(),
    )
}

fn later(poses: &[TimedPose], dt: f64) -> Vec<TimedPose> {
    poses
        .iter()
        .map(|p| TimedPose {
            stamp: p.stamp + dt,
            ..*p
        })
        .collect()
}

#[test]
fn gaps_give_no_pairs() {
    let truth = line(60);
    let mut estimate = truth.clone();
    estimate.drain(20..40);
    let o = EvalOptions {
        delta: Delta::Seconds(1.0),
        ..EvalOptions::default()
    };
    let rpe = evaluate(&truth, &estimate, &o).unwrap().rpe.unwrap();
    // 10 pairs before the gap, one more that ends within a frame of it on either side, 9 after it without the last pose.
    assert!((19..=21).contains(&rpe.pairs), "{}", rpe.pairs);
    let long = EvalOptions {
        delta: Delta::Seconds(100.0),
        ..o
    };
    assert_eq!(evaluate(&truth, &estimate, &long).unwrap().rpe, None);
}

#[test]
fn evaluation_errors_report_the_cause() {
    let truth = line(10);
    let o = EvalOptions::default();
    let message = |r: &[TimedPose], e: &[TimedPose]| evaluate(r, e, &o).unwrap_err().to_string();
    let text = message(&truth, &later(&truth, 100.0));
    assert!(
        text.contains("0.000 to 0.900") && text.contains("100.000 to 100.900"),
        "{text}"
    );
    assert!(message(&truth, &truth[..2]).contains("only 2 poses"));
    assert!(message(&truth, &[]).contains("estimate holds no pose"));
    assert!(message(&[], &truth).contains("ground truth holds no pose"));
    let mut broken = truth.clone();
    broken[4].stamp = broken[3].stamp;
    assert_eq!(
        evaluate(&truth, &broken, &o),
        Err(EvaluationError::Broken {
            which: "estimate",
            index: 4
        })
    );
    let stuck = map(&truth, |_| Se3::identity());
    assert_eq!(
        evaluate(&truth, &stuck, &o),
        Err(EvaluationError::FixedEstimate)
    );
}

#[test]
fn fixed_camera_is_scored_by_drift() {
    let still = map(&line(5), |_| Se3::identity());
    let at = |x: f64, i: usize| TimedPose {
        stamp: i as f64 * 0.1,
        world_from_camera: Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(x, 0.0, 0.0)),
    };
    let estimate: Vec<TimedPose> = [5.0, 5.0, 5.3, 5.0, 5.4]
        .into_iter()
        .enumerate()
        .map(|(i, x)| at(x, i))
        .collect();
    let o = EvalOptions::default();
    assert!(matches!(
        evaluate(&still, &estimate, &o),
        Err(EvaluationError::FixedReference { .. })
    ));
    let Score::Fixed(d) = score(&still, &estimate, &o).unwrap() else {
        panic!("expected the drift");
    };
    assert_eq!(d, drift(&estimate).unwrap());
    // Squares 0.09 and 0.16 over five poses.
    assert!((d.drift.rmse - 0.05f64.sqrt()).abs() < 1e-12);
    assert!((d.drift.max - 0.4).abs() < 1e-12 && d.rotation_deg.max == 0.0);
    assert!(d.spread.rmse < d.drift.rmse);
    assert!(matches!(
        score(&line(5), &line(5), &o),
        Ok(Score::Moving(_))
    ));
}

#[test]
fn deltas_round_trip_through_text() {
    for text in ["1s", "0.5s", "30f"] {
        assert_eq!(text.parse::<Delta>().unwrap().to_string(), text);
    }
    for text in ["", "s", "1", "0f", "-1s", "nans", "1.5f", "1m"] {
        let e = text.parse::<Delta>().unwrap_err();
        assert!(e.contains("1s or 30f"), "{e}");
    }
}

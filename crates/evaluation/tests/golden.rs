//! Results of evo 1.x for the trajectories beside this file (association within 0.02 s, alignment, RPE over all pairs 30 poses apart), and
//! of the TUM script's definition for a fixed delta of 1 s. The ground truth has irregular stamps; the estimate is scaled, rotated, noisy,
//! has a gap, and poses outside of the ground truth.
#![allow(clippy::excessive_precision)] // Numbers as the reference printed them.

use stillpoint_evaluation::{Delta, EvalOptions, Evaluation, Statistics, TimedPose, evaluate};
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Se3, Vec3};

fn read(text: &str) -> Vec<TimedPose> {
    let rows = text.lines().filter(|l| !l.starts_with('#'));
    rows.map(|line| {
        let v: Vec<f64> = line
            .split_whitespace()
            .map(|w| w.parse().unwrap())
            .collect();
        let q = UnitQuaternion::new_normalize(Quaternion::new(v[7], v[4], v[5], v[6]));
        TimedPose {
            stamp: v[0],
            world_from_camera: Se3::new(q, Vec3::new(v[1], v[2], v[3])),
        }
    })
    .collect()
}

fn run(with_scale: bool, delta: Delta) -> Evaluation {
    let options = EvalOptions {
        with_scale,
        delta,
        ..EvalOptions::default()
    };
    evaluate(
        &read(include_str!("golden/reference.txt")),
        &read(include_str!("golden/estimate.txt")),
        &options,
    )
    .unwrap()
}

fn check(s: &Statistics, [rmse, sd, mean, median, max]: [f64; 5]) {
    for (found, expected) in [
        (s.rmse, rmse),
        (s.sd, sd),
        (s.mean, mean),
        (s.median, median),
        (s.max, max),
    ] {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn agrees_with_evo_se3() {
    let e = run(false, Delta::Frames(30));
    assert_eq!(
        (e.pairs, e.reference_poses, e.estimate_poses),
        (167, 600, 170)
    );
    check(
        &e.ate.statistics,
        [
            0.04213217223997754,
            0.015536178395433654,
            0.039163083363346084,
            0.03818586983350944,
            0.08405466061321862,
        ],
    );
    let rpe = e.rpe.unwrap();
    assert_eq!(rpe.pairs, 137);
    check(
        &rpe.translation,
        [
            0.05924643991328563,
            0.025005825069775098,
            0.05371079365433331,
            0.052018221803602556,
            0.1497309135817045,
        ],
    );
    check(
        &rpe.rotation_deg,
        [
            1.5112091569530142,
            0.5279703530028935,
            1.4159803750082978,
            1.3990067941209987,
            2.941895037266149,
        ],
    );
}

#[test]
fn agrees_with_evo_sim3() {
    let e = run(true, Delta::Frames(30));
    assert!((e.ate.alignment.scale - 0.9670903229128367).abs() < 1e-12);
    check(
        &e.ate.statistics,
        [
            0.032451005143392435,
            0.012872353640161385,
            0.02978876040689007,
            0.027879954580980103,
            0.06546351079404118,
        ],
    );
    check(
        &e.rpe.unwrap().translation,
        [
            0.04671105600384051,
            0.018561057965919673,
            0.042865019306885827,
            0.03949424612035376,
            0.12586615788479468,
        ],
    );
}

#[test]
fn agrees_with_the_tum_script_over_seconds() {
    let rpe = run(false, Delta::Seconds(1.0)).rpe.unwrap();
    assert_eq!(rpe.pairs, 104);
    check(
        &rpe.translation,
        [
            0.05590812712365363,
            0.0205221081995069,
            0.05200540119566762,
            0.05166877703434562,
            0.12086858482880004,
        ],
    );
    check(
        &rpe.rotation_deg,
        [
            1.4950419104842718,
            0.5953367783181343,
            1.3713950687112915,
            1.3376347412940015,
            3.378737060080094,
        ],
    );
}

//! Properties of the covariances.
#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::*;
use crate::synthetic::{World, blank_keyframe};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_geometry::{Vec3, Vec6, so3};
use stillpoint_map::{Correction, KeyframeId, LoopEdge, Map};

fn scatter(variance: f64, count: u32) -> Scatter {
    Scatter { variance, count }
}

fn is_sound(covariance: &Mat6) -> bool {
    (covariance - covariance.transpose()).amax() <= 1e-12 * covariance.amax()
        && covariance.cholesky().is_some()
}

fn information() -> impl Strategy<Value = Mat6> {
    prop::collection::vec(-1.0..1.0_f64, 36).prop_map(|v| {
        let root = Mat6::from_row_slice(&v);
        (root * root.transpose() + Mat6::identity() * 0.1) * 1e5
    })
}

fn twists() -> impl Strategy<Value = Se3> {
    prop::array::uniform6(-1.0..1.0_f64).prop_map(|t| Se3::exp(&Vec6::from(t)))
}

proptest! {
    #[test]
    fn more_scatter_never_reduces_the_covariance(information in information(), s in 0.0..2.0_f64, more in 0.0..2.0_f64, n in 30..2000_u32) {
        let of = |variance: f64| covariance_in_map(&information, Some(&scatter(variance, n))).unwrap();
        let (less, more) = (of(s), of(s + more));
        prop_assert!(is_sound(&less) && is_sound(&more));
        for i in 0..6 {
            prop_assert!(more[(i, i)] >= less[(i, i)]);
        }
    }

    /// Errors shared by all matches do not average out; independent ones do.
    #[test]
    fn shared_errors_do_not_average_out(information in information(), n in 30..1000_u32) {
        let of = |times: u32, s: f64| {
            let information = information * f64::from(times);
            covariance_in_map(&information, Some(&scatter(s, n * times))).unwrap()
        };
        let alone = of(4, 0.6 * KEYPOINT)[(0, 0)] / of(1, 0.6 * KEYPOINT)[(0, 0)];
        prop_assert!((alone - 0.25).abs() < 1e-9, "{alone}");
        let shared = of(4, 2.35 * KEYPOINT)[(0, 0)] / of(1, 2.35 * KEYPOINT)[(0, 0)];
        prop_assert!((0.9..=1.0).contains(&shared), "{shared}");
    }

    #[test]
    fn motion_covariance_grows_with_duration(information in information(), motion in twists(), dt in 0.0..5.0_f64, more in 0.0..5.0_f64) {
        let one = pose_covariance(&information).unwrap();
        let of = |seconds: f64| covariance_of_motion(&one, &one, &motion, seconds);
        prop_assert_eq!(of(0.0), Mat6::zeros());
        let (short, long) = (of(dt + 0.01), of(dt + 0.01 + more));
        prop_assert!(is_sound(&short));
        let both = moved(&one, &motion.inverse()) + one;
        for i in 0..6 {
            prop_assert!(short[(i, i)] <= long[(i, i)] && long[(i, i)] <= both[(i, i)]);
        }
    }
}

#[test]
fn without_scatter_covariance_is_inverse_information() {
    let information = Mat6::from_diagonal(&Vec6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0));
    let told = covariance_in_map(&information, None);
    assert_eq!(told, pose_covariance(&information));
    assert!(covariance_in_map(&Mat6::zeros(), None).is_none());
}

/// 1 mm and 1 mrad.
fn small() -> Mat6 {
    Mat6::identity() * 1e-6
}

/// A row of keyframes 1 m apart without common landmarks.
fn row(count: u32) -> Map {
    let mut map = Map::new(5, 1.45);
    for id in 0..count {
        let pose = Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(f64::from(id), 0.0, 0.0));
        let parent = id.checked_sub(1).map(KeyframeId);
        let data = Arc::new(blank_keyframe(f64::from(id)));
        assert!(map.insert_keyframe(KeyframeId(id), data, pose, parent));
    }
    map
}

fn own(count: u32) -> BTreeMap<KeyframeId, Mat6> {
    (1..count).map(|id| (KeyframeId(id), small())).collect()
}

/// Variance perpendicular to the row at a keyframe, m^2.
fn across(covariance: &MapCovariance, map: &Map, id: u32) -> f64 {
    let id = KeyframeId(id);
    let pose = map.view().world_from_keyframe(id).unwrap();
    let covariance = covariance.at(map.view(), id, &pose);
    assert!(is_sound(&(covariance + small())));
    covariance[(1, 1)]
}

#[test]
fn map_covariance_grows_along_a_chain_of_keyframes() {
    let map = row(8);
    let whole = MapCovariance::of(own(8), map.view());
    let at = |id| across(&whole, &map, id);
    // The first keyframe and those overlapping with it are exact.
    assert_eq!([at(0), at(1)], [0.0, 0.0]);
    for id in 2..8 {
        assert!(at(id) > at(id - 1), "{id}");
    }
    // A rotation error early in the row displaces distant keyframes.
    assert!(at(7) - at(6) < at(6) && at(7) > 6.0 * 1e-6);
    // Incremental updates give the same result.
    let mut growing = MapCovariance::default();
    for id in 1..8 {
        growing.note(KeyframeId(id), small());
        growing.follow(row(id + 1).view());
    }
    for id in 0..8 {
        assert_eq!(across(&growing, &map, id), at(id));
    }
}

#[test]
fn turning_within_the_field_of_view_adds_no_covariance() {
    let at = |turn: f64| {
        let mut world = World::new();
        for id in 0..8_u32 {
            let pose = Se3::new(
                so3::exp(&Vec3::new(0.0, turn * f64::from(id), 0.0)),
                Vec3::zeros(),
            );
            world.add(id, id.checked_sub(1), pose, 0..40);
        }
        let whole = MapCovariance::of(own(8), world.map.view());
        across(&whole, &world.map, 7)
    };
    // The synthetic camera's field of view is 65 degrees, more than 7 steps of 8 degrees.
    assert_eq!(at(0.14), 0.0);
    assert!(at(0.3) > at(0.2) && at(0.2) > 0.0);
}

#[test]
fn loop_edge_reduces_the_covariance_of_its_end() {
    let mut map = row(8);
    let mut covariance = MapCovariance::default();
    for id in 1..8 {
        covariance.note(KeyframeId(id), small());
    }
    covariance.follow(map.view());
    let before = [4, 7].map(|id| across(&covariance, &map, id));
    map.apply(&Correction {
        measured: Some(Box::new(LoopEdge {
            old: KeyframeId(0),
            new: KeyframeId(7),
            old_from_new: Se3::identity(),
            information: Mat6::identity() * 1e6,
            inliers: 40,
        })),
        ..Correction::default()
    });
    covariance.follow(map.view());
    let after = [4, 7].map(|id| across(&covariance, &map, id));
    // The end is now one view from the beginning; the middle has not improved.
    assert_eq!(after[1], 0.0);
    assert!(
        after[0] <= before[0] && before[1] > before[0],
        "{before:?} {after:?}"
    );
}

#[test]
fn loaded_map_has_zero_covariance() {
    let map = row(8);
    let mut covariance = MapCovariance::default();
    covariance.follow(map.view());
    assert_eq!(across(&covariance, &map, 7), 0.0);
    assert_eq!(
        across(&MapCovariance::of(BTreeMap::new(), map.view()), &map, 7),
        0.0
    );
}

#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::*;
use crate::config::Config;
use crate::synthetic::{Feature, at, data, see};
use stillpoint_map::SubmapId;

/// Scale factor between levels.
const SCALE: f64 = 1.2;

fn keyframe(id: u32, world_from_camera: Se3, features: &[Feature]) -> Keyframe {
    Keyframe {
        id: KeyframeId(id),
        data: data(features),
        world_from_camera,
        matches: vec![None; features.len()],
        covisible: Vec::new(),
        parent: None,
        submap: SubmapId(0),
    }
}

fn flat(point: Vec3, look: usize, camera: &Se3, level: u8) -> Feature {
    Feature {
        depth: 0.0,
        level,
        ..see(&point, look, camera)
    }
}

/// The point triangulated from two cameras, observed on these levels.
fn made_of(point: Vec3, cameras: [Se3; 2], levels: [u8; 2]) -> Option<Vec3> {
    let [a, b] = [0, 1].map(|k| {
        let feature = flat(point, 0, &cameras[k], levels[k]);
        keyframe(k as u32, cameras[k], &[feature])
    });
    let made = triangulate_pair(&a, &b, SCALE);
    assert!(made.len() < 2);
    made.first().map(|m| m.2)
}

#[test]
fn triangulation_recovers_the_point() {
    let point = Vec3::new(0.3, -0.2, 2.0);
    let made = made_of(point, [at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.0)], [0, 0]).unwrap();
    assert!((made - point).norm() < 1e-3, "{made:?}");
}

#[test]
fn small_parallax_or_baseline_gives_no_point() {
    let cameras = |baseline| [at(0.0, 0.0, 0.0), at(baseline, 0.0, 0.0)];
    // 0.2 m aside: 5.7 deg at 2 m, 0.6 deg at 20 m.
    let near = Vec3::new(0.1, 0.1, 2.0);
    assert!(made_of(near, cameras(0.2), [0, 0]).is_some());
    assert!(made_of(10.0 * near, cameras(0.2), [0, 0]).is_none());
    // With a small baseline relative to median depth triangulation is skipped, however near the point.
    assert!(made_of(0.1 * near, cameras(0.02), [0, 0]).is_some());
    assert!(made_of(0.1 * near, cameras(0.009), [0, 0]).is_none());
}

/// A point behind both cameras lies on both rays but contradicts both pixels.
#[test]
fn diverging_rays_give_no_point() {
    let cameras = [at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.0)];
    let point = Vec3::new(0.1, 0.1, 2.0);
    let made = |px: f32| {
        let mut features = [0, 1].map(|k| flat(point, 7, &cameras[k], 0));
        features[1].pixel[0] += px;
        let [a, b] = [0, 1].map(|k| keyframe(k as u32, cameras[k], &features[k..=k]));
        triangulate_pair(&a, &b, SCALE).len()
    };
    // 50 px of disparity at 2 m: 100 px more to the right the rays diverge as much.
    assert_eq!([made(0.0), made(100.0)], [1, 0]);
}

/// At equal distances both keyframes see a patch on one level, within the tolerance.
#[test]
fn inconsistent_pyramid_levels_reject_a_match() {
    let point = Vec3::new(0.1, 0.1, 2.0);
    let aside = [at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.0)];
    for (levels, fine) in [
        ([0, 0], true),
        ([0, 3], true),
        ([3, 0], true),
        ([0, 4], false),
        ([4, 0], false),
        ([2, 6], false),
    ] {
        let made = made_of(point, aside, levels);
        assert_eq!(made.is_some(), fine, "levels {levels:?}");
    }
    // At half the distance it is twice as large, four levels coarser.
    let towards = [at(0.4, 0.0, 1.0), at(0.0, 0.0, 0.0)];
    assert!(made_of(point, towards, [4, 0]).is_some());
    assert!(made_of(point, towards, [0, 0]).is_none());
    assert!(made_of(point, towards, [0, 4]).is_none());
}

#[test]
fn descriptor_and_epipolar_gates_reject_matches() {
    let cameras = [at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.0)];
    let point = Vec3::new(0.1, 0.1, 2.0);
    let seen = |k: usize| flat(point, 7, &cameras[k], 0);
    let made = |a: Feature, b: Feature| {
        let (a, b) = (keyframe(0, cameras[0], &[a]), keyframe(1, cameras[1], &[b]));
        triangulate_pair(&a, &b, SCALE).len()
    };
    let lower = |px: f32| Feature {
        pixel: [seen(1).pixel[0], seen(1).pixel[1] + px],
        ..seen(1)
    };
    // The 95 % gate across the epipolar line is 1.96 px.
    assert_eq!(made(seen(0), lower(1.8)), 1);
    assert_eq!(made(seen(0), lower(2.2)), 0);
    let noisy = |noise| Feature { noise, ..seen(1) };
    assert_eq!(made(seen(0), noisy(STRICT_DISTANCE)), 1);
    assert_eq!(made(seen(0), noisy(STRICT_DISTANCE + 1)), 0);
    // Features with depth are not triangulated, nor are those that are not mappable.
    let deep = Feature {
        depth: 2.0,
        ..seen(1)
    };
    let passing = Feature {
        mappable: false,
        ..seen(1)
    };
    assert_eq!([made(seen(0), deep), made(seen(0), passing)], [0, 0]);
}

#[test]
fn feature_is_matched_once_with_the_nearest_descriptor() {
    let cameras = [at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.0)];
    // Two points behind each other on one epipolar line of the second keyframe.
    let points = [Vec3::new(0.1, 0.1, 2.0), Vec3::new(0.12, 0.12, 2.4)];
    let a = [0, 1].map(|i| Feature {
        noise: [12, 3][i],
        ..flat(points[i], 5, &cameras[0], 0)
    });
    let b = keyframe(1, cameras[1], &[flat(points[1], 5, &cameras[1], 0)]);
    for order in [[0, 1], [1, 0]] {
        let a = keyframe(0, cameras[0], &order.map(|i| a[i]));
        let made = triangulate_pair(&a, &b, SCALE);
        assert_eq!(made.len(), 1);
        assert_eq!(order[made[0].0 as usize], 1, "{order:?}");
    }
}

/// A mapper with keyframe 0 at the origin and keyframe 1 `baseline` aside. They share one point with depth and see two
/// more without.
fn mapper(points: [Vec3; 2], baseline: f64) -> Mapper {
    let mut mapper = Mapper::new(&Config::default());
    for id in 0..2_u32 {
        let camera = at(baseline * f64::from(id), 0.0, 0.0);
        let mut features = vec![see(&Vec3::new(-0.5, -0.3, 2.0), 9, &camera)];
        features.extend((0..2).map(|i| flat(points[i], i, &camera, 0)));
        let parent = id.checked_sub(1).map(KeyframeId);
        let id = KeyframeId(id);
        let inserted = mapper
            .map
            .insert_keyframe(id, data(&features), camera, parent);
        assert!(inserted);
        mapper.order.push(id);
        if parent.is_none() {
            assert_eq!(mapper.create_from_depth(id), 1);
        }
    }
    let shared = mapper.young[0];
    assert!(mapper.map.add_observation(shared, KeyframeId(1), 0));
    mapper.map.refresh_covisibility(KeyframeId(1), 1);
    mapper
}

#[test]
fn triangulated_landmarks_have_two_observers_and_are_young() {
    let points = [Vec3::new(0.3, 0.2, 2.0), Vec3::new(-0.2, -0.1, 2.5)];
    let mut mapper = mapper(points, 0.2);
    assert_eq!(mapper.triangulate(KeyframeId(1)), 2);
    assert_eq!(mapper.map.check(), Ok(()));
    let view = mapper.map.view();
    for id in &mapper.young[1..] {
        let l = view.landmark(*id).unwrap();
        assert_eq!((l.observers, l.depth_observers), (2, 0));
        let position = view.landmark_position(*id).unwrap();
        let off = points.iter().map(|p| (p - position).norm());
        assert!(off.fold(f64::MAX, f64::min) < 1e-3, "{position:?}");
    }
    assert_eq!((mapper.young.len(), view.landmark_count()), (3, 3));
    // A second pass creates nothing.
    assert_eq!(mapper.triangulate(KeyframeId(1)), 0);
}

#[test]
fn unmatched_features_with_depth_become_landmarks() {
    let camera = at(0.5, 0.0, -1.0);
    let mut features: Vec<Feature> = (0..5)
        .map(|i| see(&Vec3::new(0.2 * i as f64, 0.1, 6.0 - i as f64), i, &camera))
        .collect();
    features[1].depth = 0.0;
    features[2].mappable = false;
    let mut mapper = Mapper::new(&Config::default());
    let id = KeyframeId(0);
    let inserted = mapper
        .map
        .insert_keyframe(id, data(&features), camera, None);
    assert!(inserted);
    let known = NewLandmark {
        position: Vec3::new(0.6, 0.1, 3.0),
        observation: (id, 3),
    };
    let known = mapper.map.insert_landmark(&known).unwrap();
    assert_eq!(mapper.create_from_depth(id), 2);
    let view = mapper.map.view();
    let matches = &view.keyframe(id).unwrap().matches;
    assert_eq!(matches[3], Some(known));
    assert!(matches[1].is_none() && matches[2].is_none());
    for (i, z) in [(0, 6.0), (4, 2.0)] {
        let position = view.landmark_position(matches[i].unwrap()).unwrap();
        let expected = Vec3::new(0.2 * i as f64, 0.1, z);
        assert!((position - expected).norm() < 1e-5, "{position:?}");
    }
    // Nearest first, so that young landmarks are ordered by depth.
    assert_eq!(mapper.young, [matches[4].unwrap(), matches[0].unwrap()]);
}

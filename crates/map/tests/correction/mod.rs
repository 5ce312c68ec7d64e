//! Corrections of a map that has changed since.

mod cases;
mod laws;
mod submaps;

use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};
use stillpoint_map::{
    Correction, KeyframeData, KeyframeId, LandmarkCorrection, LandmarkId, Map, MapView,
    NewLandmark, PoseCorrection,
};

const FEATURES: usize = 8;

fn data(id: u32) -> Arc<KeyframeData> {
    let positions: Vec<[f32; 2]> = (0..FEATURES)
        .map(|i| [20.0 * i as f32 + 30.0, 50.0])
        .collect();
    let levels = [0; FEATURES];
    let keypoint = |p: &[f32; 2]| Keypoint {
        x: p[0],
        y: p[1],
        level: 0,
        angle: 0.0,
        response: 1.0,
        edge: Edge::default(),
    };
    Arc::new(KeyframeData {
        stamp: f64::from(id),
        camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
        keypoints: positions.iter().map(keypoint).collect(),
        sigma_px: vec![1.0; FEATURES],
        depths: vec![2.0; FEATURES],
        depth_sigmas: vec![0.01; FEATURES],
        descriptors: (0..FEATURES as u64)
            .map(|i| Descriptor([i, u64::from(id), 0, 0]))
            .collect::<Vec<_>>()
            .into(),
        mappable: vec![true; FEATURES],
        grid: FeatureGrid::build(&positions, &levels, [0.0, 0.0, 640.0, 480.0]),
        positions,
    })
}

fn pose(seed: u32) -> Se3 {
    let s = f64::from(seed);
    Se3::exp(&Vec6::new(
        0.1 * s,
        -0.05 * s,
        0.02 * s,
        0.01 * s,
        0.02,
        -0.03 * s,
    ))
}

/// A chain of keyframes, each the parent of the next, with `landmarks` each, the first also observed by the next
/// keyframe.
fn chain(keyframes: u32, landmarks: u32) -> Map {
    let mut map = Map::new(8, 1.2);
    for k in 0..keyframes {
        extend(&mut map, k, k.checked_sub(1), landmarks);
    }
    map
}

fn extend(map: &mut Map, k: u32, parent: Option<u32>, landmarks: u32) {
    let parent = parent.map(KeyframeId);
    assert!(map.insert_keyframe(KeyframeId(k), data(k), pose(k), parent));
    for f in 0..landmarks {
        let position = pose(k).transform(&Vec3::new(0.1 * f64::from(f), 0.2, 2.0));
        let new = NewLandmark {
            position,
            observation: (KeyframeId(k), f),
        };
        map.insert_landmark(&new).unwrap();
    }
    if let Some(p) = parent {
        let first = map.view().keyframe(p).and_then(|p| p.matches[0]);
        if let Some(l) = first {
            map.add_observation(l, KeyframeId(k), FEATURES as u32 - 1);
        }
    }
}

/// A correction that moves each live keyframe of a view by its own small motion.
fn correction(view: &MapView, shifts: &[u32]) -> Correction {
    let poses = view.keyframes().zip(shifts.iter().cycle());
    Correction {
        base_version: view.version(),
        poses: poses
            .map(|(k, s)| PoseCorrection {
                keyframe: k.id,
                before: k.world_from_camera,
                after: pose(*s) * k.world_from_camera,
            })
            .collect(),
        ..Correction::default()
    }
}

fn at(map: &Map, k: u32) -> Se3 {
    map.view().world_from_keyframe(KeyframeId(k)).unwrap()
}

fn distance(a: &Se3, b: &Se3) -> f64 {
    (a.inverse() * *b).log().norm()
}

fn landmark_moves(view: &MapView, by: f64) -> Vec<LandmarkCorrection> {
    let of = |(id, l): (LandmarkId, &stillpoint_map::Landmark)| LandmarkCorrection {
        landmark: id,
        anchor: l.anchor,
        before: l.position_in_anchor,
        after: l.position_in_anchor + Vec3::new(by, 0.0, -by),
    };
    view.landmarks().map(of).collect()
}

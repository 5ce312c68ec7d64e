//! Remeasures keyframes when the estimate of the readout time improves.
//!
//! The first keyframes of a map are taken before the readout time is known: at 100 degrees per second their outer rows
//! are then displaced by 10 px, and later frames are matched to that. The mapper stores the velocity and readout used
//! for each keyframe, and corrects its features when the newest readout differs.

use super::Mapper;
use crate::messages::Exposure;
use crate::shutter::{Shutter, TYPICAL_DEPTH};
use crate::timing::Timing;
use stillpoint_geometry::{Camera, Vec2, Vec6};
use stillpoint_map::{KeyframeData, KeyframeId};

/// Minimum displacement of the outer rows to remeasure a keyframe, px. Chosen: half of the error of a keypoint of the
/// finest level (equation 1 of docs/algorithm.md).
const WORTHWHILE_PX: f64 = 0.5;

impl Mapper {
    /// Remeasures all keyframes for which the readout `readout` (s) makes a difference; returns their number.
    pub(super) fn measure_again(&mut self, readout: f64) -> u32 {
        let _span = tracing::info_span!("remeasure").entered();
        let view = self.map.view();
        self.exposures.retain(|id, _| view.keyframe(*id).is_some());
        let is_due = |(id, exposure): (&KeyframeId, &Exposure)| {
            let data = &view.keyframe(*id)?.data;
            let velocity = exposure.velocity?;
            let shutter = shutter(&data.camera, readout - exposure.readout);
            (shutter.reach_px(&velocity).abs() >= WORTHWHILE_PX).then_some((*id, velocity))
        };
        let due: Vec<(KeyframeId, Vec6)> = self.exposures.iter().filter_map(is_due).collect();
        for (id, velocity) in &due {
            let Some(exposure) = self.exposures.get_mut(id) else {
                continue;
            };
            let before = std::mem::replace(&mut exposure.readout, readout);
            if let Some(k) = self.map.view().keyframe(*id) {
                let data = measured_again(&k.data, velocity, before, readout);
                self.map.remeasure(*id, data);
            }
        }
        due.len() as u32
    }
}

fn shutter(camera: &Camera, readout: f64) -> Shutter<'_> {
    let timing = Timing {
        readout,
        ..Timing::default()
    };
    Shutter::new(camera, &timing)
}

/// Converts features measured with readout `before` (s) to readout `now`.
fn measured_again(data: &KeyframeData, velocity: &Vec6, before: f64, now: f64) -> KeyframeData {
    let camera = &data.camera;
    let (old, new) = (shutter(camera, before), shutter(camera, now));
    let mut again = data.clone();
    for (i, k) in data.keypoints.iter().enumerate() {
        let raw = Vec2::new(f64::from(k.x), f64::from(k.y));
        let at_stamp = camera.backproject(data.position(i), data.depth(i).unwrap_or(TYPICAL_DEPTH));
        let z = old.depth_exposed(&at_stamp, raw.y, velocity);
        let there = new.at_stamp(camera.undistort(raw), raw.y, z, Some(velocity));
        let position = camera.project(&there);
        again.positions[i] = [position.x as f32, position.y as f32];
        if data.depths[i] > 0.0 {
            again.depths[i] = there.z as f32;
        }
    }
    let levels: Vec<u8> = data.keypoints.iter().map(|k| k.level).collect();
    let bounds = KeyframeData::grid_bounds(camera);
    again.grid.rebuild(&again.positions, &levels, bounds);
    again
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::*;
    use crate::config::Config;
    use crate::messages::{MapperMsg, NewKeyframe};
    use std::sync::Arc;
    use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
    use stillpoint_geometry::{BrownConrady, Se3, Vec3};
    use stillpoint_map::LandmarkId;

    const READOUT: f64 = 0.02;

    fn camera() -> Camera {
        Camera {
            distortion: BrownConrady {
                k1: 0.1,
                k2: -0.2,
                ..BrownConrady::default()
            },
            ..Camera::pinhole(640, 480, [520.0, 520.0, 319.5, 239.5])
        }
    }

    /// 120 degrees per second, about all axes.
    fn velocity() -> Vec6 {
        Vec6::new(0.1, -0.2, 0.1, 0.8, 1.8, -0.6)
    }

    fn points() -> Vec<Vec3> {
        let point = |i: u32| {
            let (x, y) = (f64::from(i % 8), f64::from(i / 8));
            Vec3::new(0.2 * x - 0.7, 0.2 * y - 0.5, 1.5 + 0.2 * ((x * y) % 4.0))
        };
        (0..48).map(point).collect()
    }

    /// Data of a moving camera at the origin with rolling-shutter readout `readout`, measured assuming `measured_with`.
    /// Every sixth point has no depth.
    fn seen(readout: f64, measured_with: f64) -> KeyframeData {
        let camera = camera();
        let (real, known) = (shutter(&camera, readout), shutter(&camera, measured_with));
        let exposed = |p: &Vec3| real.exposed(p, Some(&velocity()));
        let raw: Vec<Vec2> = points().iter().map(exposed).collect();
        let n = raw.len();
        let measured: Vec<(Vec3, bool)> = (0..n)
            .map(|i| {
                let (p, has_depth) = (points()[i], i % 6 != 0);
                let z = real.depth_exposed(&p, raw[i].y, &velocity());
                let z = if has_depth { z } else { TYPICAL_DEPTH };
                let undistorted = camera.undistort(raw[i]);
                (
                    known.at_stamp(undistorted, raw[i].y, z, Some(&velocity())),
                    has_depth,
                )
            })
            .collect();
        let pixel = |(p, _): &(Vec3, bool)| {
            let p = camera.project(p);
            [p.x as f32, p.y as f32]
        };
        let positions: Vec<[f32; 2]> = measured.iter().map(pixel).collect();
        let keypoint = |p: &Vec2| Keypoint {
            x: p.x as f32,
            y: p.y as f32,
            level: 0,
            angle: 0.0,
            response: 1.0,
            edge: Edge::default(),
        };
        let bounds = KeyframeData::grid_bounds(&camera);
        KeyframeData {
            stamp: 0.0,
            camera,
            keypoints: raw.iter().map(keypoint).collect(),
            sigma_px: vec![1.0; n],
            depths: measured
                .iter()
                .map(|(p, d)| if *d { p.z as f32 } else { 0.0 })
                .collect(),
            depth_sigmas: vec![0.01; n],
            descriptors: Arc::new(vec![Descriptor([7; 4]); n]),
            mappable: vec![true; n],
            grid: FeatureGrid::build(&positions, &vec![0; n], bounds),
            positions,
        }
    }

    fn keyframe(id: u32, readout: f64, velocity: Option<Vec6>) -> MapperMsg {
        MapperMsg::Keyframe(Box::new(NewKeyframe {
            id: KeyframeId(id),
            data: Arc::new(seen(READOUT, readout)),
            reference: (id > 0).then_some(KeyframeId(0)),
            reference_from_camera: Se3::identity(),
            matches: vec![None; points().len()],
            statistics: Vec::new(),
            exposure: Exposure { velocity, readout },
        }))
    }

    fn farthest(a: &KeyframeData, b: &KeyframeData) -> f64 {
        let apart = |i| (a.position(i) - b.position(i)).norm();
        (0..a.len()).map(apart).fold(0.0, f64::max)
    }

    #[test]
    fn remeasuring_equals_measuring_with_the_known_readout() {
        let (before, known) = (seen(READOUT, 0.0), seen(READOUT, READOUT));
        assert!(farthest(&before, &known) > 5.0);
        let again = measured_again(&before, &velocity(), 0.0, READOUT);
        assert!(farthest(&again, &known) < 0.05);
        for (a, b) in again.depths.iter().zip(&known.depths) {
            assert!((a - b).abs() < 1e-3 && (*a > 0.0) == (*b > 0.0));
        }
        let half = measured_again(&again, &velocity(), READOUT, 0.5 * READOUT);
        let back = measured_again(&half, &velocity(), 0.5 * READOUT, 0.0);
        assert!(farthest(&back, &before) < 0.05);
    }

    /// Control: without a known velocity nothing is corrected.
    #[test]
    fn first_keyframe_is_remeasured_with_the_learned_readout() {
        let off = |velocity| {
            let mut mapper = Mapper::new(&Config::default());
            mapper.step(keyframe(0, 0.0, velocity));
            mapper.step(keyframe(1, READOUT, velocity));
            let view = mapper.map().view();
            let data = &view.keyframe(KeyframeId(0)).unwrap().data;
            let landmark = |(i, p): (usize, &Vec3)| {
                let id = view.keyframe(KeyframeId(0))?.matches[i]?;
                Some((view.landmark_position(id)? - p).norm())
            };
            let all = points();
            let placed: Vec<f64> = all.iter().enumerate().filter_map(landmark).collect();
            assert!(placed.len() >= 30, "{}", placed.len());
            (
                farthest(data, &seen(READOUT, READOUT)),
                placed.into_iter().fold(0.0, f64::max),
            )
        };
        let (pixels, metres) = off(Some(velocity()));
        assert!(pixels < 0.05 && metres < 2e-3, "{pixels} px, {metres} m");
        let (pixels, metres) = off(None);
        assert!(pixels > 5.0 && metres > 0.01, "{pixels} px, {metres} m");
    }

    #[test]
    fn small_changes_and_missing_keyframes_are_skipped() {
        let mut mapper = Mapper::new(&Config::default());
        mapper.step(keyframe(0, 0.019, Some(velocity())));
        let before = Arc::clone(&mapper.map().view().keyframe(KeyframeId(0)).unwrap().data);
        assert_eq!(mapper.measure_again(0.0195), 0);
        let after = &mapper.map().view().keyframe(KeyframeId(0)).unwrap().data;
        assert!(Arc::ptr_eq(&before, after));
        assert_eq!(mapper.measure_again(0.021), 1);
        assert_eq!(mapper.measure_again(0.021), 0);
        mapper.exposures.insert(KeyframeId(7), Exposure::default());
        mapper.measure_again(0.021);
        assert_eq!(mapper.exposures.len(), 1);
    }

    #[test]
    fn remeasuring_refuses_a_different_feature_set() {
        let mut mapper = Mapper::new(&Config::default());
        mapper.step(keyframe(0, READOUT, Some(velocity())));
        let position = |m: &Mapper| m.map().view().landmark_position(LandmarkId::new(0));
        let before = position(&mapper);
        let mut fewer = seen(READOUT, 0.0);
        fewer.positions.pop();
        fewer.keypoints.pop();
        assert!(!mapper.map.remeasure(KeyframeId(0), fewer));
        assert!(!mapper.map.remeasure(KeyframeId(9), seen(READOUT, 0.0)));
        assert_eq!(position(&mapper), before);
    }
}

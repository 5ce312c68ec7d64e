#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::Notes;
use super::*;
use crate::config::Config;
use crate::synthetic::{blocks, wall, wall_camera};
use std::sync::Arc;
use stillpoint_geometry::{Vec3, so3};
use stillpoint_imaging::{FrameId, Simd};

/// A tracker with a pose at the origin in the first frame, and the data of the second.
pub(in super::super) fn second_frame(
    first: RgbdFrame,
    second: RgbdFrame,
    config: &Config,
) -> (Tracker, Arc<KeyframeData>) {
    let mut tracker = Tracker::new(config, wall_camera(), Simd::detect());
    tracker.track(&Arc::new(first));
    assert!(tracker.state.tracked().is_some(), "it begins a map");
    tracker.pace.next(&second);
    tracker.front_end.clock.take(&second);
    let data = tracker.observe(&second, &mut Notes::default());
    (tracker, data)
}

/// Deviation of pairs, px, from a shift by this many px sideways, for features in these columns.
fn off(data: &KeyframeData, pairs: &[Option<FlowPair>], shift: f64, columns: [f32; 2]) -> Vec<f64> {
    let of = |(k, pair): (&stillpoint_features::Keypoint, &Option<FlowPair>)| {
        let pair = pair
            .as_ref()
            .filter(|_| (columns[0]..columns[1]).contains(&k.x))?;
        Some((pair.before - pair.now - Vec2::new(shift, 0.0)).norm())
    };
    data.keypoints.iter().zip(pairs).filter_map(of).collect()
}

fn share(of: &[f64], is: impl Fn(f64) -> bool) -> f64 {
    of.iter().filter(|e| is(**e)).count() as f64 / of.len().max(1) as f64
}

#[test]
fn flow_finds_features_at_their_last_positions() {
    let shown = |id, shift| wall(id, move |x, y| blocks(1, x + shift, y));
    let (mut tracker, data) = second_frame(shown(0, 0), shown(1, 3), &Config::default());
    let (pairs, rest) = tracker.flow(&data, &Se3::identity());
    assert!(rest.is_empty(), "all of the wall has depth");
    let errors = off(&data, &pairs, 3.0, [10.0, 300.0]);
    assert!(errors.len() > 300, "{}", errors.len());
    assert!(share(&errors, |e| e < 0.3) > 0.97, "{errors:?}");
}

#[test]
fn no_previous_frame_gives_no_flow() {
    let shown = |id| wall(id, |x, y| blocks(1, x, y));
    let (mut tracker, data) = second_frame(shown(0), shown(1), &Config::default());
    tracker.state.lose(FrameId(1));
    let (pairs, rest) = tracker.flow(&data, &Se3::identity());
    assert!(pairs.is_empty() && rest.is_empty());
}

/// A camera that rotates by 1 rad/s with a readout of 20 ms: over the image height columns lean by 0.02 rad of 260 px.
#[test]
fn rolling_shutter_is_removed_from_flow_pairs() {
    let shown = |id| wall(id, |x, y| blocks(1, x, y));
    let lean = |readout: f64| {
        let mut config = Config::default();
        config.sensor.readout = readout;
        let (mut tracker, data) = second_frame(shown(0), shown(1), &config);
        let (mut pairs, _) = tracker.flow(&data, &Se3::identity());
        let mut turned = Se3::identity();
        turned.rotation = so3::exp(&Vec3::new(0.0, 1.0 / 30.0, 0.0));
        let motion = tracker.motion_to(&turned);
        tracker.bring_to_stamps(&data, &mut pairs, &motion);
        let seen = data.keypoints.iter().zip(&pairs);
        let aside = |rows: std::ops::Range<f32>| {
            let near = seen.clone().filter_map(|(k, pair)| {
                let central = (k.x - 160.0).abs() < 30.0 && rows.contains(&k.y);
                let pair = pair.as_ref().filter(|_| central)?;
                Some((pair.now.x - f64::from(k.x), f64::from(k.y)))
            });
            let near: Vec<(f64, f64)> = near.collect();
            let count = near.len() as f64;
            assert!(count > 2.0);
            let sum = near.iter().fold((0.0, 0.0), |s, n| (s.0 + n.0, s.1 + n.1));
            (sum.0 / count, sum.1 / count)
        };
        let (top, bottom) = (aside(0.0..60.0), aside(180.0..240.0));
        (bottom.0 - top.0) / (bottom.1 - top.1)
    };
    assert!(lean(0.0).abs() < 1e-6);
    let expected = 0.02 * 260.0 / 240.0;
    assert!(
        (lean(0.02).abs() - expected).abs() < 0.1 * expected,
        "{}",
        lean(0.02)
    );
}

/// An acceleration puts all features far from their predictions; all are found although most are only searched nearby.
#[test]
fn jolt_loses_no_features() {
    let shown = |id, shift| wall(id, move |x, y| blocks(1, x + shift, y));
    let (mut tracker, data) = second_frame(shown(0, 0), shown(1, 12), &Config::default());
    let (pairs, _) = tracker.flow(&data, &Se3::identity());
    let errors = off(&data, &pairs, 12.0, [30.0, 280.0]);
    assert!(errors.len() > 250, "{}", errors.len());
    assert!(share(&errors, |e| e < 0.3) > 0.95, "{errors:?}");
}

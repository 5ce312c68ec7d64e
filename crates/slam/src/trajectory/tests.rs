use super::*;
use crate::anchored_pose::AnchoredPose;
use std::sync::Arc;
use stillpoint_map::Map;

fn at(x: f64, turned: f64) -> Se3 {
    Se3 {
        rotation: so3::exp(&Vec3::new(0.0, turned, 0.0)),
        translation: Vec3::new(x, 0.0, 0.0),
    }
}

fn add(map: &mut Map, id: u32, parent: Option<u32>, pose: Se3) {
    let data = crate::synthetic::blank_keyframe(f64::from(id));
    let parent = parent.map(KeyframeId);
    assert!(map.insert_keyframe(KeyframeId(id), Arc::new(data), pose, parent));
}

/// A frame at `id` seconds, measured at `x` from a keyframe.
fn entry(id: u32, is_keyframe: bool, reference: u32, x: f64) -> TrajectoryEntry {
    TrajectoryEntry {
        carried: false,
        frame: FrameId(id),
        stamp: f64::from(id),
        pose: AnchoredPose {
            keyframe: is_keyframe.then_some(KeyframeId(id)),
            reference: KeyframeId(reference),
            reference_from_camera: at(x, 0.0),
            online_world_from_camera: at(x, 0.0),
        },
        inliers: 100,
    }
}

fn resolved(entries: &[TrajectoryEntry], map: &Map) -> Vec<[f64; 2]> {
    let mut trajectory = Trajectory::default();
    trajectory.extend(entries.iter().copied());
    let poses = trajectory.resolve(map.view());
    let found = poses.map(|(_, p)| [p.translation.x, so3::log(&p.rotation).y]);
    found.collect()
}

#[track_caller]
fn check(found: &[[f64; 2]], expected: &[[f64; 2]]) {
    let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    let same = found.len() == expected.len();
    assert!(
        same && found.iter().zip(expected).all(|p| off(p) < 1e-4),
        "{found:?} where {expected:?} was expected"
    );
}

#[test]
fn keyframe_correction_is_spread_over_earlier_frames() {
    let mut map = Map::new(5, 1.45);
    add(&mut map, 0, None, at(0.0, 0.0));
    // Measured at 0.4, refined to 0.44 and rotated by 0.2.
    add(&mut map, 4, Some(0), at(0.44, 0.2));
    let frames = [
        entry(0, true, 0, 0.0),
        entry(1, false, 0, 0.1),
        entry(2, false, 0, 0.2),
        entry(3, false, 0, 0.3),
        entry(4, true, 0, 0.4),
        entry(5, false, 0, 0.5),
    ];
    let spread = [
        [0.0, 0.0],
        [0.11, 0.05],
        [0.22, 0.1],
        [0.33, 0.15],
        [0.44, 0.2],
    ];
    // Frames after the last keyframe are unchanged.
    check(
        &resolved(&frames, &map),
        &[&spread[..], &[[0.5, 0.0]]].concat(),
    );
}

#[test]
fn corrections_below_the_noise_are_not_spread() {
    let frames = [
        entry(0, true, 0, 0.0),
        entry(1, false, 0, 0.1),
        entry(2, true, 0, 0.2),
    ];
    // A correction equal to the noise is applied half, a much smaller one not, a much larger one fully. The middle
    // frame gets half of that.
    for (off, spread) in [(0.0014, 0.5), (0.0001, 0.005), (0.05, 0.9992)] {
        let mut map = Map::new(5, 1.45);
        add(&mut map, 0, None, at(0.0, 0.0));
        add(&mut map, 2, Some(0), at(0.2 + off, 0.0));
        let found = resolved(&frames, &map)[1][0] - 0.1;
        assert!(
            (found / (0.5 * off) - spread).abs() < 0.001,
            "{off}: {found}"
        );
    }
}

#[test]
fn frames_with_another_reference_are_not_corrected() {
    let mut map = Map::new(5, 1.45);
    add(&mut map, 0, None, at(0.0, 0.0));
    add(&mut map, 2, Some(0), at(0.26, 0.0));
    add(&mut map, 4, Some(2), at(0.5, 0.0));
    let frames = [
        entry(0, true, 0, 0.0),
        entry(1, false, 0, 0.1),
        entry(2, true, 0, 0.2),
        // Measured from the first keyframe, while the next one was measured from the second.
        entry(3, false, 0, 0.3),
        entry(4, true, 2, 0.2),
    ];
    let expected = [[0.0, 0.0], [0.13, 0.0], [0.26, 0.0], [0.3, 0.0], [0.5, 0.0]];
    check(&resolved(&frames, &map), &expected);
    // If both are measured from the first, corrections at either end count: 0.06 and 0.1.
    let frames = [
        entry(0, true, 0, 0.0),
        entry(2, true, 0, 0.2),
        entry(3, false, 0, 0.3),
        entry(4, true, 0, 0.4),
    ];
    let expected = [[0.0, 0.0], [0.26, 0.0], [0.38, 0.0], [0.5, 0.0]];
    check(&resolved(&frames, &map), &expected);
}

/// Frames at 30 Hz that jitter by a centimetre.
fn jittered(count: u32) -> Vec<TrajectoryEntry> {
    let frame = |k: u32| TrajectoryEntry {
        stamp: f64::from(k) / 30.0,
        ..entry(k, false, 0, if k.is_multiple_of(2) { 0.01 } else { -0.01 })
    };
    (0..count).map(frame).collect()
}

/// Change of each pose by smoothing, m.
fn smoothed_by(entries: &[TrajectoryEntry]) -> Vec<f64> {
    let mut map = Map::new(5, 1.45);
    add(&mut map, 0, None, at(0.0, 0.0));
    let mut trajectory = Trajectory::default();
    trajectory.extend(entries.iter().copied());
    let plain = trajectory.resolve(map.view());
    let both = plain.zip(trajectory.smoothed(map.view()));
    both.map(|(a, b)| (a.1.translation - b.1.translation).norm())
        .collect()
}

#[test]
fn consecutive_frames_are_smoothed_except_carried_ones() {
    let mut entries = jittered(41);
    assert!(smoothed_by(&entries).iter().all(|m| *m > 0.005));
    entries[20].carried = true;
    let by = smoothed_by(&entries);
    assert_eq!(by[20], 0.0);
    assert!(by[..20].iter().chain(&by[21..]).all(|m| *m > 0.005));
}

#[test]
fn gap_splits_smoothing_and_short_runs_are_unchanged() {
    let mut entries = jittered(28);
    for late in &mut entries[20..] {
        late.stamp += 0.3;
    }
    let by = smoothed_by(&entries);
    assert!(by[..20].iter().all(|m| *m > 0.005), "{by:?}");
    assert!(by[20..].iter().all(|m| *m == 0.0), "{by:?}");
}

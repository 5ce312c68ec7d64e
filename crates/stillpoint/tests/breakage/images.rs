//! Images with little or no content, and missing depth.

use super::world::{Session, assert_kept, config, losses, room, until_pose};
use stillpoint_datasets::Disturbance;
use stillpoint_imaging::{DepthImage, RgbdFrame};
use stillpoint_slam::{LostReason, Outcome};

/// Tracks 40 frames, then `frames` disturbed ones, then 30 more. Returns the loss reasons of the disturbed frames, and
/// the number of later frames without a pose.
fn through(what: Disturbance, frames: usize) -> (Vec<LostReason>, usize) {
    let mut session = Session::new(room(), config());
    session.feed(room().play(0..40));
    let before = session.view();
    let bad = session.feed(room().disturbed(40..40 + frames, what));
    // Frames without a pose add nothing to the map.
    let keyframes = session.view().keyframe_count() - before.keyframe_count();
    let made = bad.iter().filter(|r| r.is_keyframe).count();
    assert!(keyframes <= made, "{what:?}");
    let after = session.feed(room().play(40 + frames..70 + frames));
    let lost = losses(&bad);
    println!(
        "{what:?}: {} of {frames} frames lost, pose after {}",
        lost.len(),
        until_pose(&after),
    );
    session.hold(&format!("{what:?}"), room(), &bad);
    session.hold(&format!("after {what:?}"), room(), &after);
    let since = after[0].outcome;
    if lost.len() == frames {
        assert!(
            matches!(since, Outcome::Relocalised { since, .. } if since.0 == 40)
                || until_pose(&after) > 0,
            "{what:?}: {since:?}"
        );
    }
    assert_kept(&before, &session.view());
    (lost, losses(&after).len())
}

#[test]
fn black_white_and_covered_frames_are_lost_and_no_others() {
    for what in [
        Disturbance::Black,
        Disturbance::Covered,
        Disturbance::Saturated,
    ] {
        let (lost, after) = through(what, 8);
        assert_eq!(lost, [LostReason::FewFeatures; 8], "{what:?}");
        assert!(after <= 1, "{what:?}: {after}");
    }
}

#[test]
fn tracking_survives_blur_and_exposure_jumps() {
    // (disturbance, maximum lost frames during and after it)
    for (what, lost, after) in [
        (Disturbance::Blurred(2), 0, 0),
        (Disturbance::Blurred(12), 8, 1),
        (Disturbance::Exposure(0.4), 2, 1),
        (Disturbance::Exposure(2.0), 2, 1),
    ] {
        let found = through(what, 8);
        assert!(
            found.0.len() <= lost && found.1 <= after,
            "{what:?}: {found:?}"
        );
    }
}

#[test]
fn three_seconds_without_depth_are_tracked_by_the_map() {
    let mut session = Session::new(room(), config());
    session.feed(room().play(0..20));
    let before = session.view();
    let blind = session.feed(room().disturbed(20..110, Disturbance::NoDepth));
    let after = session.feed(room().play(110..130));
    assert!(losses(&blind).is_empty() && losses(&after).is_empty());
    session.hold("three seconds without depth", room(), &blind);
    session.hold("after three seconds without depth", room(), &after);
    assert!(blind.iter().all(|r| r.counts.with_depth == 0));
    assert_kept(&before, &session.view());
}

#[test]
fn map_starts_once_depth_is_available() {
    let mut session = Session::new(room(), config());
    let blind = session.feed(room().disturbed(0..10, Disturbance::NoDepth));
    assert_eq!(losses(&blind), [LostReason::FewDepths; 10]);
    assert_eq!(session.view().keyframe_count(), 0);
    let after = session.feed(room().play(10..20));
    assert_eq!(after[0].outcome, Outcome::Initialised);
    assert!(losses(&after).is_empty());
}

#[test]
fn half_of_the_depth_suffices() {
    let mut session = Session::new(room(), config());
    let reports = session.feed(room().disturbed(0..100, Disturbance::HalfDepth));
    assert!(losses(&reports).is_empty());
    session.hold("half of the depth", room(), &reports);
}

/// Invalid depths.
#[test]
fn invalid_depths_are_ignored() {
    let nonsense = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -1.0,
        f32::MAX,
        1e-30,
    ];
    let spoil = |frame: &mut RgbdFrame| {
        let (w, h) = (frame.depth.width(), frame.depth.height());
        let mut data = frame.depth.data().to_vec();
        for (i, z) in data.iter_mut().enumerate() {
            // Alternating columns of 8 px, so that both kinds form whole cells.
            if (i % w / 8).is_multiple_of(2) {
                *z = nonsense[i % nonsense.len()];
            }
        }
        frame.depth = DepthImage::from_vec(w, h, data).unwrap();
    };
    let mut frames = room().play(0..60);
    frames.iter_mut().for_each(spoil);
    let mut session = Session::new(room(), config());
    let reports = session.feed(frames);
    assert!(losses(&reports).is_empty());
    session.hold("depths that are no numbers", room(), &reports);
}

//! A camera that is covered, moved and uncovered.

use super::world::{Session, assert_kept, config, losses, until_pose, walk};
use stillpoint_datasets::Disturbance;
use stillpoint_map::SubmapId;
use stillpoint_slam::Outcome;

#[test]
fn uncovered_camera_relocalises_or_begins_a_submap() {
    let mut config = config();
    config.tracking.new_submap_seconds = 0.33;
    let covered = || {
        let mut session = Session::new(walk(), config.clone());
        session.feed(walk().play(0..40));
        let dark = session.feed(walk().disturbed(40..75, Disturbance::Covered));
        assert_eq!(losses(&dark).len(), 35);
        session
    };
    // At its position half a second before.
    let mut session = covered();
    let before = session.view();
    let found = session.go_on(walk().play(25..40), 0.0);
    assert!(matches!(found[0].outcome, Outcome::Relocalised { since, .. } if since.0 == 40));
    session.hold("covered and found where it was", walk(), &found);
    assert_kept(&before, &session.view());

    // In an unknown place.
    let mut session = covered();
    let before = session.view();
    let elsewhere = session.go_on(walk().play(75..115), 0.0);
    let lost = losses(&elsewhere).len();
    println!(
        "a submap is begun after {lost} frames, pose after {}",
        until_pose(&elsewhere)
    );
    assert!((1..=12).contains(&lost), "{lost}");
    assert_eq!(elsewhere[lost].outcome, Outcome::Initialised);
    let submap = SubmapId(75 + lost as u32);
    assert!(elsewhere[lost..].iter().all(|r| r.submap == Some(submap)));
    assert_eq!(session.view().submaps().len(), 2);
    assert_kept(&before, &session.view());
}

//! Objects are anchored to keyframes, and follow their corrections.

use crate::things::{desk, listed, told, view};
use std::sync::Arc;
use stillpoint_dense::{Thing, ThingMap, Things, ThingsConfig};
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_map::{Correction, Map, MapView, PoseCorrection};
use stillpoint_slam::Subscriber;

/// The map of the run with keyframe `k` of `n` moved by `moves(k / (n - 1))`, and the map after a correction that reverts this.
fn astray(moves: &dyn Fn(f64) -> Se3) -> [Arc<MapView>; 2] {
    let right = view();
    let last = (right.keyframes().count() - 1) as f64;
    let mut map = Map::new(5, 1.45);
    let mut correction = Correction::default();
    for (i, k) in right.keyframes().enumerate() {
        let before = moves(i as f64 / last) * k.world_from_camera;
        map.insert_keyframe(k.id, Arc::clone(&k.data), before, k.parent);
        correction.poses.push(PoseCorrection {
            keyframe: k.id,
            before,
            after: k.world_from_camera,
        });
    }
    let wrong = map.publish();
    correction.base_version = wrong.version();
    let applied = map.apply(&correction);
    assert!(applied.poses >= 2, "{applied:?}");
    [wrong, map.publish()]
}

fn things() -> Things {
    let mut things = Things::new(&ThingsConfig::default(), desk().simulator.camera());
    things.receive_all(&told(&|_, _| ()));
    things
}

/// For each screen and keyboard of the first list, the distance to the nearest one of its class in the second.
fn apart(first: &[Thing], second: &[Thing], expected: &Se3) -> Vec<f64> {
    let of = |class: &'static str| {
        let all = listed(second, class);
        listed(first, class).into_iter().map(move |t| {
            let at = expected.transform(&t.bounds.centre);
            let apart = all.iter().map(|o| (o.bounds.centre - at).norm());
            apart.fold(f64::INFINITY, f64::min)
        })
    };
    let apart: Vec<f64> = ["tv", "keyboard"].into_iter().flat_map(of).collect();
    assert!(apart.len() >= 2, "{first:?}");
    apart
}

/// After a loop closure everything collected before moves rigidly.
#[test]
fn things_follow_a_rigid_correction() {
    let turn = Se3::new(so3::exp(&(0.3 * Vec3::y())), Vec3::new(0.8, 0.0, 0.5));
    let [wrong, right] = astray(&|_| turn);
    let gathered = things();
    let before = gathered.at(&wrong);
    // Stored objects move like collected ones.
    let kept = ThingMap::from_bytes(&before.to_bytes()).unwrap();
    let was = before.list(&wrong);
    for after in [gathered.at(&right).list(&right), kept.list(&right)] {
        let moved = apart(&was, &after, &turn.inverse());
        assert!(moved.iter().all(|d| *d < 0.05), "{moved:?}");
        // Control: without the correction they are elsewhere.
        let unmoved = apart(&was, &after, &Se3::identity());
        assert!(unmoved.iter().all(|d| *d > 0.3), "{unmoved:?}");
    }
    assert_eq!(kept.list(&wrong), was);
}

/// Poses drift apart, and a pose graph corrects them: objects are then where they would be without drift.
#[test]
fn things_follow_a_drift_correction() {
    let drift = |share: f64| {
        let turn = so3::exp(&(0.15 * share * Vec3::y()));
        Se3::new(turn, share * Vec3::new(0.6, 0.0, 0.3))
    };
    let [wrong, right] = astray(&drift);
    let gathered = things();
    let never = gathered.at(&view()).list(&view());
    let after = gathered.at(&right).list(&right);
    let same = apart(&never, &after, &Se3::identity());
    assert!(same.iter().all(|d| *d < 1e-6), "{same:?}");
    // Control: with the drift they are off, or are not merged.
    let off = apart(&never, &gathered.at(&wrong).list(&wrong), &Se3::identity());
    assert!(off.iter().any(|d| *d > 0.1), "{off:?}");
}

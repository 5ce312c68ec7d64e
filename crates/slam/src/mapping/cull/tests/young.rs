//! Confirmation and culling of new landmarks.

use super::super::*;
use crate::config::Config;
use crate::synthetic::{at, data, see_points};
use stillpoint_geometry::Se3;
use stillpoint_map::LandmarkId;

const COUNT: usize = 6;

/// A mapper with one keyframe and its landmarks from depth.
fn mapper() -> (Mapper, Vec<LandmarkId>) {
    let mut mapper = Mapper::new(&Config::default());
    let seen = data(&see_points(0..COUNT, &Se3::identity()));
    let id = KeyframeId(0);
    assert!(mapper.map.insert_keyframe(id, seen, Se3::identity(), None));
    mapper.order.push(id);
    assert_eq!(mapper.create_from_depth(id), COUNT as u32);
    let mut made = mapper.young.clone();
    made.sort_unstable();
    (mapper, made)
}

/// Adds a keyframe at 0.1 m per id that observes only the landmarks `seen`.
fn come(mapper: &mut Mapper, id: u32, seen: &[LandmarkId]) {
    let camera = at(0.1 * f64::from(id), 0.0, 0.0);
    let parent = Some(KeyframeId(0));
    let id = KeyframeId(id);
    let data = data(&see_points(0..COUNT, &camera));
    assert!(mapper.map.insert_keyframe(id, data, camera, parent));
    mapper.order.push(id);
    for (feature, landmark) in (0..).zip(seen) {
        assert!(mapper.map.add_observation(*landmark, id, feature));
    }
}

fn live(mapper: &Mapper, landmarks: &[LandmarkId]) -> Vec<bool> {
    let is_live = |id: &LandmarkId| mapper.map.view().landmark(*id).is_some();
    landmarks.iter().map(is_live).collect()
}

#[test]
fn young_landmark_found_in_under_a_quarter_is_culled() {
    let (mut mapper, made) = mapper();
    // (frames that should see it, frames in which it was found)
    let seen = [(1, 1), (4, 1), (5, 1), (100, 24), (100, 25), (30, 0)];
    for (id, (visible, found)) in made.iter().zip(seen) {
        let l = mapper.map.landmark_mut(*id).unwrap();
        (l.visible, l.found) = (visible, found);
    }
    assert_eq!(mapper.cull_landmarks(KeyframeId(0)), 3);
    assert_eq!(
        live(&mapper, &made),
        [true, true, false, false, true, false]
    );
    assert_eq!(mapper.map.check(), Ok(()));
}

#[test]
fn young_landmark_with_one_observer_is_culled_after_two() {
    let (mut mapper, made) = mapper();
    come(&mut mapper, 3, &made[..2]);
    assert_eq!(mapper.cull_landmarks(KeyframeId(3)), 0);
    // Ids are frame numbers; age counts keyframes.
    come(&mut mapper, 20, &[]);
    assert_eq!(mapper.cull_landmarks(KeyframeId(20)), COUNT as u32 - 2);
    assert_eq!(
        live(&mapper, &made),
        [true, true, false, false, false, false]
    );
}

#[test]
fn landmark_without_depth_needs_one_more_observer() {
    let (mut mapper, made) = mapper();
    for id in &made {
        mapper.map.landmark_mut(*id).unwrap().depth_observers = 0;
    }
    come(&mut mapper, 1, &made);
    come(&mut mapper, 2, &made[..2]);
    for id in &made {
        mapper.map.landmark_mut(*id).unwrap().depth_observers = 0;
    }
    assert_eq!(mapper.cull_landmarks(KeyframeId(2)), COUNT as u32 - 2);
    assert_eq!(live(&mapper, &made)[..3], [true, true, false]);
}

#[test]
fn landmark_is_established_after_three_keyframes() {
    let (mut mapper, made) = mapper();
    for id in 1..4 {
        come(&mut mapper, id, &made);
        assert_eq!(mapper.cull_landmarks(KeyframeId(id)), 0);
    }
    assert!(mapper.young.is_empty());
    for id in &made {
        mapper.map.landmark_mut(*id).unwrap().visible = 1000;
    }
    assert_eq!(mapper.cull_landmarks(KeyframeId(3)), 0);
    assert!(live(&mapper, &made).iter().all(|l| *l));
}

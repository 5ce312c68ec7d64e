//! Properties of bodies and their motion.

use super::skeleton::{SIDES, length};
use super::*;
use crate::catalogue::CROWD_AHEAD;
use crate::path::Path;
use crate::scene::{Builder, Scene};
use proptest::prelude::*;
use std::sync::OnceLock;
use stillpoint_geometry::{Se3, Vec3};

const CASTS: [Cast; 6] = [
    Cast::Walking,
    Cast::Sitting,
    Cast::Carrying,
    Cast::Fetching,
    Cast::Coated,
    Cast::Crowd,
];

/// Number of people in the crowds of four seeds.
const CROWD: usize = 8;

fn people(cast: Cast, seed: u64) -> Vec<Person> {
    let b = &mut Builder::new(seed);
    cast.enter(b, seed);
    std::mem::take(&mut b.people)
}

/// The people of all casts with some seeds; built once, as painting their clothes takes long.
fn everyone() -> &'static [Person] {
    static EVERYONE: OnceLock<Vec<Person>> = OnceLock::new();
    EVERYONE.get_or_init(|| {
        let of = |cast| (0..4).flat_map(move |seed| people(cast, seed));
        CASTS.into_iter().flat_map(of).collect()
    })
}

fn skeleton(person: &Person, t: f64) -> Skeleton {
    Skeleton::new(&person.gait.posture(t))
}

fn between(a: &Se3, b: &Se3) -> f64 {
    (a.translation - b.translation).norm()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Bones keep their lengths and stay connected.
    #[test]
    fn bones_keep_their_lengths(t in -1.0..14.0_f64) {
        for person in everyone() {
            let (s, k) = (skeleton(person, t), person.gait.size);
            let mut pairs = vec![(between(&s.hips, &s.chest), length::WAIST)];
            pairs.push((between(&s.chest, &s.head), length::NECK));
            for (side, sign) in SIDES.into_iter().enumerate() {
                let ([upper, fore, hand], [thigh, shank, foot]) = (s.arms[side], s.legs[side]);
                pairs.extend([
                    (between(&upper, &fore), length::UPPER_ARM),
                    (between(&fore, &hand), length::FOREARM),
                    (between(&thigh, &shank), length::THIGH),
                    (between(&shank, &foot), length::SHANK),
                    (between(&s.hips, &thigh), length::HIP),
                ]);
                let shoulder = s.chest.inverse().transform(&upper.translation);
                prop_assert!((shoulder.y - sign * k * length::SHOULDER).abs() < 1e-9);
                // Knees bend one way only.
                let axis = s.hips.rotation * Vec3::y();
                let bend = (thigh.translation - shank.translation)
                    .cross(&(shank.translation - foot.translation));
                prop_assert!(bend.dot(&axis) > -1e-3, "a knee bends forward at {t}");
            }
            for (found, expected) in pairs {
                prop_assert!((found - k * expected).abs() < 1e-9, "{found} for {expected} at {t}");
            }
        }
    }

    /// Motion is smooth: no point of a body is faster than a swinging foot, and no speed jumps.
    #[test]
    fn bodies_move_smoothly(t in 0.0..10.0_f64) {
        let h = 1e-3;
        for person in everyone() {
            let corners = [-h, 0.0, h].map(|d| person.corners(t + d));
            for (i, at) in corners[1].iter().enumerate() {
                let (back, forth) = (at - corners[0][i], corners[2][i] - at);
                prop_assert!(forth.norm() / h < 5.5, "{} m/s at {t}", forth.norm() / h);
                let change = (forth - back).norm() / (h * h);
                prop_assert!(change < 90.0, "{change} m/s^2 at {t}");
            }
        }
    }

    /// A person always stands on a resting heel or toe, and no foot is below the floor.
    #[test]
    fn feet_stay_on_the_floor_and_do_not_slide(t in 0.0..10.0_f64) {
        for person in everyone() {
            let k = person.gait.size;
            let soles = |t: f64| {
                let legs = skeleton(person, t).legs;
                legs.map(|[_, _, foot]| [length::TOE, -length::HEEL]
                    .map(|x| foot.transform(&(Vec3::new(x, 0.0, -length::ANKLE) * k))))
            };
            let (now, next) = (soles(t), soles(t + 1e-3));
            let mut resting = false;
            for (a, b) in now.iter().flatten().zip(next.iter().flatten()) {
                prop_assert!(a.z > -0.004, "{} m under the floor at {t}", a.z);
                resting |= a.z < 0.004 && (b - a).norm() < 3e-5;
            }
            prop_assert!(resting, "both feet slide or fly at {t}: {now:?}");
        }
    }

    #[test]
    fn bodies_stay_in_the_room_and_out_of_the_desk(t in 0.0..12.0_f64) {
        for (k, person) in everyone().iter().enumerate() {
            // The crowd comes last; its desk stands farther back, like those of the preceding casts with a fetched chair or a coat.
            let desk = if k + CROWD + 8 < everyone().len() { -0.8..0.2 } else { -0.2..0.8 };
            for p in person.corners(t) {
                prop_assert!(p.x.abs() < 2.95 && p.y.abs() < 2.45, "{p} at {t}");
                prop_assert!((-0.02..2.0).contains(&p.z), "{p} at {t}");
            }
            // Trunk and legs avoid the desk's top; hands may reach over it.
            let s = skeleton(person, t);
            let legs = s.legs.iter().flatten().map(|pose| pose.translation);
            for p in legs.chain([s.hips.translation, s.chest.translation]) {
                let inside = p.x.abs() < 1.0 && desk.contains(&p.y);
                prop_assert!(!inside || p.z < 0.7, "{p} in the desk at {t}");
            }
        }
    }
}

#[test]
fn people_do_not_walk_through_each_other_or_the_camera() {
    let farther = |by: [f64; 4]| {
        [
            Path::xyz(3).farther(by[0]),
            Path::rpy(3).farther(by[1]),
            Path::halfsphere(3).farther(by[2]),
            Path::still(3).farther(by[3]),
        ]
    };
    for cast in CASTS {
        let paths = match cast {
            Cast::Crowd | Cast::Coated | Cast::Fetching => [
                Path::xyz(3).farther(1.0),
                Path::rpy(3).farther(0.9),
                Path::halfsphere_at(3, 2.2)
                    .farther(0.9)
                    .starting_at(CROWD_AHEAD),
                Path::still(3).farther(0.9),
            ],
            _ => farther([0.7, 0.6, 1.1, 0.66]),
        };
        let people = people(cast, 3);
        for k in 0..200 {
            let t = 0.05 * f64::from(k);
            let hips: Vec<Vec3> = people
                .iter()
                .map(|p| skeleton(p, t).hips.translation)
                .collect();
            for (i, a) in hips.iter().enumerate() {
                for b in &hips[..i] {
                    assert!((a - b).xy().norm() > 0.5, "{a} and {b} at {t}");
                }
                for path in &paths {
                    let eye = path.world_from_camera(t).translation;
                    let far = (a - eye).xy().norm();
                    assert!(cast == Cast::Sitting || far > 0.38, "{far} m at {t}");
                }
            }
        }
    }
}

#[test]
fn bodies_have_human_height() {
    for person in everyone().iter().filter(|p| p.load.is_empty()) {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for p in person.corners(0.0) {
            (low, high) = (low.min(p.z), high.max(p.z));
        }
        let sits = person.gait.route.at(0.0).sitting > 0.5;
        let expected = if sits { 1.2..1.5 } else { 1.62..1.86 };
        assert!(expected.contains(&(high - low)), "{} m", high - low);
    }
}

/// Control: a person in a crowd turns round.
#[test]
fn people_in_coats_turn_their_back_to_the_camera() {
    let turned = |cast| {
        let off = |p: &Person, k: i32| {
            let doing = p.gait.route.at(0.1 * f64::from(k));
            1.0 - libm::sin(doing.yaw)
        };
        let people = people(cast, 3);
        let all = people.iter().flat_map(|p| (0..100).map(move |k| off(p, k)));
        all.fold(0.0, f64::max)
    };
    assert!(turned(Cast::Coated) < 0.01 && turned(Cast::Crowd) > 0.5);
    let coated = &people(Cast::Coated, 3)[0];
    assert!(coated.from_behind && coated.gait.route.speed(0.3) > 0.3);
}

#[test]
fn walking_scene_includes_walking_stopping_and_sitting() {
    let people = people(Cast::Walking, 0);
    let at = |f: &dyn Fn(&Person, f64) -> bool| {
        people
            .iter()
            .any(|p| (0..100).any(|k| f(p, 0.1 * f64::from(k))))
    };
    assert!(at(&|p, t| p.gait.route.speed(t) > 0.75));
    assert!(at(&|p, t| t > 2.0 && p.gait.route.speed(t) < 0.02));
    assert!(at(&|p, t| p.gait.route.at(t).sitting < 0.01));
    assert!(at(&|p, t| p.gait.route.at(t).sitting > 0.99));
    assert!(people.iter().all(|p| p.gait.route.speed(0.5) < 1.5));
}

/// The wrists stay beside the carried box.
#[test]
fn carried_box_stays_in_the_hands() {
    let people = people(Cast::Carrying, 0);
    let person = &people[0];
    for k in 0..100 {
        let t = 0.1 * f64::from(k);
        let pose = person.gait.load_pose(t).unwrap();
        for [_, _, hand] in skeleton(person, t).arms {
            let wrist = pose.inverse().transform(&hand.translation);
            assert!(
                wrist.norm() < 0.32,
                "{} m from the box at {t}",
                wrist.norm()
            );
        }
    }
    let classes = people[0].movers(0.0).map(|m| m.class);
    assert!(classes.eq(["person", "box"]));
    // Positions match velocities.
    let at = |t| -> Vec<_> { people[0].movers(t).filter_map(|m| m.motion).collect() };
    for (n, now) in at(2.0).into_iter().enumerate() {
        let (before, after) = (at(1.98)[n], at(2.02)[n]);
        for i in 0..3 {
            let change = (after.position[i] - before.position[i]) / 0.04;
            assert!((change - now.velocity[i]).abs() < 0.05, "{now:?}");
        }
    }
}

/// Meshes are closed: from any direction their front faces and back faces have the same outline.
#[test]
fn person_meshes_are_closed_and_face_outward() {
    let scene = Scene::office_with_people(0, Cast::Sitting);
    let faces = scene.moving(3.0, &mut All);
    assert!(faces.len() > 1000);
    let mut surfaces: std::collections::BTreeMap<u16, (Vec3, f64)> = Default::default();
    for face in &faces {
        let [a, b, c] = [face.vertices[0], face.vertices[1], face.vertices[2]];
        let area = (b - a).cross(&(c - a)) * 0.5;
        assert!(area.normalize().dot(&face.normal) > 0.999_999);
        let sum = surfaces.entry(face.surface).or_default();
        sum.0 += area;
        // Six times the volume, by the divergence theorem: positive if faces point outward.
        sum.1 += a.dot(&b.cross(&c));
        for (k, axis) in face.axes.iter().enumerate() {
            assert!(axis.iter().all(|v| v.is_finite()) && face.offsets[k].is_finite());
            assert!(axis.dot(&face.normal).abs() < 1e-6 * axis.norm().max(1.0));
        }
        assert!(face.light.iter().all(|l| l.is_finite()));
    }
    for (surface, (area, volume)) in surfaces {
        assert!(area.norm() < 1e-9, "surface {surface} is open");
        assert!(volume > 1e-5, "surface {surface} is inside out");
    }
}

//! Speed of people with swinging arms: a box's sides follow the arms, the middle of the surface does not.

use super::feed::{feed_items, tracker};
use super::world::{RATE, Walker, World, person, turned};
use stillpoint_detection::BoundingBox;
use stillpoint_geometry::{Se3, Vec3};

/// Walking speed across the view, m/s.
const SPEED: f64 = 0.5;

/// Median speed error over three seconds, m/s, of a person who alternately stretches out both arms by a share of the
/// box width, once per second.
fn speed_error(arms: f64, path: fn(f64) -> Se3) -> f64 {
    let walker = Walker::new(|t| Vec3::new(-0.75 + SPEED * t, 0.1, 2.6));
    let world = World::new(vec![walker], path);
    let mut tracker = tracker(&world);
    let mut errors = Vec::new();
    for frame in 0..90 {
        let t = frame as f64 / RATE;
        let b = world.truth(0, t).unwrap().0;
        let out = arms * b.width() * libm::sin(std::f64::consts::TAU * t);
        let with_arms = BoundingBox {
            x0: b.x0 - out.max(0.0),
            x1: b.x1 - out.min(0.0),
            ..b
        };
        let objects = feed_items(&mut tracker, &world, frame, vec![person(with_arms)]);
        let velocity = objects.first().and_then(|o| o.velocity);
        errors.extend(velocity.map(|v| (v.norm() - SPEED).abs()));
    }
    assert!(errors.len() > 80);
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

fn still(_: f64) -> Se3 {
    Se3::default()
}

fn rolling(t: f64) -> Se3 {
    turned(0.0, 0.0, 0.5 * libm::sin(2.0 * t), Vec3::zeros())
}

/// By the sides alone the error is 0.35 m/s for both cameras.
#[test]
fn swinging_arms_do_not_bias_the_speed() {
    for (path, most) in [(still as fn(f64) -> Se3, 0.15), (rolling, 0.27)] {
        let (without, with) = (speed_error(0.0, path), speed_error(0.5, path));
        println!("{without:.3} {with:.3}");
        assert!(
            without < 0.08 && with < most,
            "{with}, {without} with arms at rest"
        );
    }
}

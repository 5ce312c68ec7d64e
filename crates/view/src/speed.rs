//! Significant object speeds.

use stillpoint_detection::{Motion, MotionWeights, Object};
use stillpoint_slam::MOVER;

/// Number of standard deviations that an inanimate object's speed must exceed to count as moving: of a static object with
/// isotropic errors, 95 % of the speeds are lower (chi-square distribution with three degrees of freedom).
const FOR_THINGS: f64 = 2.8;

/// Whether an inanimate object moves by both the rigid test and its speed. The rigid test alone is not enough: features of a person who
/// passes by lie in the object's box too.
pub(crate) fn is_moving_thing(object: &Object) -> bool {
    object.motion == Motion::Moving && certain_speed(object, FOR_THINGS).is_some()
}

/// The motion that pages show: an object of a class that does not move by itself moves only if its speed confirms it.
pub(crate) fn shown_motion(object: &Object, weights: &MotionWeights) -> Motion {
    match object.motion {
        Motion::Moving if weights.get(object.class) < MOVER && !is_moving_thing(object) => {
            Motion::Unknown
        }
        motion => motion,
    }
}

/// The speed of an object (m/s), if it exceeds this many standard deviations along the direction of motion; `None` if the object may be
/// static.
#[must_use]
pub fn certain_speed(object: &Object, sigmas: f64) -> Option<f64> {
    let (velocity, covariance) = (object.velocity?, object.covariance?);
    let speed = velocity.norm();
    if !(speed > 0.0 && speed.is_finite()) {
        return None;
    }
    let direction = velocity / speed;
    let of_velocity = covariance.fixed_view::<3, 3>(3, 3);
    let variance = direction.dot(&(of_velocity * direction));
    // A NaN variance gives no speed.
    (variance >= 0.0 && speed > sigmas * variance.sqrt()).then_some(speed)
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::*;
    use stillpoint_detection::{BoundingBox, ClassId, ObjectId, ObjectState};
    use stillpoint_geometry::{Mat6, Vec3};

    /// A confirmed object whose velocity (m/s) has standard deviations of 0.5 m/s.
    pub(crate) fn object(class: &str, motion: Motion, speed: f64) -> Object {
        Object {
            id: ObjectId(4),
            class: ClassId::from_name(class).unwrap(),
            score: 0.9,
            state: ObjectState::Confirmed,
            bounds: BoundingBox::default(),
            bounds_sigma: [0.0; 2],
            depth_range: None,
            position: Some(Vec3::zeros()),
            velocity: Some(Vec3::new(speed, 0.0, 0.0)),
            covariance: Some(Mat6::identity() * 0.25),
            size: None,
            last_seen: 0.0,
            motion,
        }
    }

    #[test]
    fn monitor_behind_a_walking_person_is_not_shown_as_moving() {
        for (class, motion, speed, shown) in [
            ("tv", Motion::Moving, 0.1, Motion::Unknown),
            ("chair", Motion::Moving, 1.6, Motion::Moving),
            ("chair", Motion::Parked, 1.6, Motion::Parked),
            ("person", Motion::Moving, 0.1, Motion::Moving),
            ("dog", Motion::Moving, 0.1, Motion::Moving),
        ] {
            let found = shown_motion(&object(class, motion, speed), &MotionWeights::default());
            assert_eq!(found, shown, "{class} {motion:?} {speed}");
        }
    }
}

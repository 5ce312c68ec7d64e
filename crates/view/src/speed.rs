//! Significant object speeds.

use stillpoint_detection::Object;

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

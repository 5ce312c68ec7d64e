//! How fast an object is, where that is known.

use stillpoint_detection::Object;

/// The speed of an object (m/s), where it is above so many of its own standard deviations along the direction of motion; none
/// for what may as well stand still.
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
    // A variance that is no number certifies nothing.
    (variance >= 0.0 && speed > sigmas * variance.sqrt()).then_some(speed)
}

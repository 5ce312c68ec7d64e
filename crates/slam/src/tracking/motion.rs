//! Where the camera is expected to be: constant velocity, in time rather than in frames.

use stillpoint_geometry::{Se3, Vec6};

/// The camera's velocity as a twist per second of `camera_later_from_camera_earlier`; none while it is not known.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ConstantVelocity(Option<Vec6>);

impl ConstantVelocity {
    /// The velocity between two poses of one map view, `dt` seconds apart.
    pub(super) fn between(last_from_world: &Se3, now_from_world: &Se3, dt: f64) -> Self {
        let twist = || (*now_from_world * last_from_world.inverse()).log() / dt;
        Self((dt > 1e-6).then(twist))
    }

    /// The velocity, when it is known.
    pub(super) fn velocity(&self) -> Option<&Vec6> {
        self.0.as_ref()
    }

    /// The expected pose `dt` seconds after `last_from_world`.
    pub(super) fn predict(&self, last_from_world: &Se3, dt: f64) -> Se3 {
        // After a long gap a constant velocity is a wild guess: half a second of it is the most that is believed.
        match &self.0 {
            Some(v) => Se3::exp(&(v * dt.clamp(0.0, 0.5))) * *last_from_world,
            None => *last_from_world,
        }
    }
}

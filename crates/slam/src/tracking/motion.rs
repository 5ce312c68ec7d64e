//! Where the camera is expected to be: constant velocity, in time rather than in frames.

use stillpoint_geometry::{Se3, Vec6};

/// The camera's velocity as a twist per second of `camera_later_from_camera_earlier`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    velocity: Option<Vec6>,
}

impl Motion {
    /// Learns the velocity from two poses of one map view, `dt` seconds apart.
    pub(super) fn learn(&mut self, last_from_world: &Se3, now_from_world: &Se3, dt: f64) {
        self.velocity = velocity(last_from_world, now_from_world, dt);
    }

    /// Forgets the velocity: after a loss nothing is known of it.
    pub(super) fn forget(&mut self) {
        self.velocity = None;
    }

    /// The velocity, when it is known.
    pub(super) fn velocity(&self) -> Option<&Vec6> {
        self.velocity.as_ref()
    }

    /// The expected pose `dt` seconds after `last_from_world`.
    pub(super) fn predict(&self, last_from_world: &Se3, dt: f64) -> Se3 {
        // After a long gap a constant velocity is a wild guess: half a second of it is the most that is believed.
        match &self.velocity {
            Some(v) => Se3::exp(&(v * dt.clamp(0.0, 0.5))) * *last_from_world,
            None => *last_from_world,
        }
    }
}

/// Twist per second between two poses `dt` seconds apart.
pub(super) fn velocity(last_from_world: &Se3, now_from_world: &Se3, dt: f64) -> Option<Vec6> {
    (dt > 1e-6).then(|| (*now_from_world * last_from_world.inverse()).log() / dt)
}

//! Tracking of detected objects.
//!
//! Predicts position and motion of every object for any pose and stamp, bridges missed and late detections, and decides
//! whether an object is static. The decision on rejected features is elsewhere. Modules: filters with depth (`spatial`)
//! and without (`planar`), measurements (`measurement`, `depth`), assignment (`associate`, `expected`, `fit`,
//! `occlusion`, `profile`), life cycle (`track`, `tracker`, `sight`, `duplicates`, `lost`).

mod associate;
mod common;
mod config;
mod depth;
mod duplicates;
mod expected;
mod fit;
mod kalman;
mod kind;
mod lost;
mod measurement;
mod occlusion;
mod place;
mod planar;
mod profile;
mod rigidity;
mod sight;
mod spatial;
mod surface;
mod track;
mod tracker;
mod vertical;
mod view;
mod votes;

pub use config::ObjectsConfig;
pub use rigidity::Motion;
pub use tracker::{MOST_DETECTIONS, ObjectTracker};

use crate::{BoundingBox, ClassId};
use stillpoint_geometry::{Mat6, Se3, Vec3};

/// Number of an object, never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectId(pub u32);

/// Certainty of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectState {
    /// Detected too rarely, or just found more than a step from its predicted position: may be a false alarm, but is
    /// masked.
    Tentative,
    /// Detected at least three times, and in the newest detections.
    Confirmed,
    /// Detected at least three times, but not in the newest detections.
    Coasting,
    /// Detected at least three times, but not in the newest detections; and their frame shows something else at its
    /// position, mostly nearer, or its position is mostly outside the image.
    Hidden,
}

/// An object at a stamp, seen from a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Id.
    pub id: ObjectId,
    /// Class.
    pub class: ClassId,
    /// Score of its last detection, 0 to 1.
    pub score: f32,
    /// Certainty.
    pub state: ObjectState,
    /// Predicted box in the raw image, px, clipped to the image; empty when outside the view.
    pub bounds: BoundingBox,
    /// Standard deviation of the box's vertical and horizontal sides, px. Zero behind the camera.
    pub bounds_sigma: [f64; 2],
    /// Nearest and farthest depth (camera z, m) of its surface, widened by the standard deviation of its predicted depth; `None` without depth or
    /// behind the camera.
    pub depth_range: Option<[f64; 2]>,
    /// Middle of its visible surface in the world, m; `None` while it has no depth. Unless tentative, it moves no
    /// faster than a run between updates.
    pub position: Option<Vec3>,
    /// Velocity in the world, m/s; `None` with the position.
    pub velocity: Option<Vec3>,
    /// Covariance of position and velocity (m^2, m^2/s, m^2/s^2), in this order; `None` with the position.
    pub covariance: Option<Mat6>,
    /// Width and height, m; `None` with the position.
    pub size: Option<[f64; 2]>,
    /// Stamp of its last detection, s.
    pub last_seen: f64,
    /// Motion state.
    pub motion: Motion,
}

/// Position and motion of an object, relative to a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectInCamera {
    /// Middle of its visible surface in camera coordinates, m.
    pub position: Vec3,
    /// Its velocity in the world, in the axes of the camera, m/s; the camera's velocity is not subtracted.
    pub velocity: Vec3,
    /// Covariance of position and velocity (m^2, m^2/s, m^2/s^2), in this order, in the axes of the camera, without the
    /// uncertainty of the camera's pose.
    pub covariance: Mat6,
}

impl Object {
    /// The object relative to a camera with this pose in the world; `None` while it has no depth.
    #[must_use]
    pub fn seen_from(&self, world_from_camera: &Se3) -> Option<ObjectInCamera> {
        let (position, velocity) = (self.position?, self.velocity?);
        let camera_from_world = world_from_camera.inverse();
        let r = camera_from_world.rotation_matrix();
        let mut turn = Mat6::zeros();
        turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        Some(ObjectInCamera {
            position: camera_from_world.transform(&position),
            velocity: r * velocity,
            covariance: turn * self.covariance? * turn.transpose(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Vec6;

    #[test]
    fn object_is_transformed_into_the_camera_frame() {
        let object = Object {
            id: ObjectId(1),
            class: ClassId::PERSON,
            score: 0.9,
            state: ObjectState::Confirmed,
            bounds: BoundingBox::default(),
            bounds_sigma: [0.0; 2],
            depth_range: None,
            position: Some(Vec3::new(1.0, 2.0, 3.0)),
            velocity: Some(Vec3::new(0.0, 0.0, 0.5)),
            covariance: Some(Mat6::from_diagonal(&Vec6::new(
                0.01, 0.04, 0.09, 0.16, 0.25, 0.36,
            ))),
            size: None,
            last_seen: 0.0,
            motion: Motion::default(),
        };
        // A camera at (1, 0, 0) that looks along the world's x axis: its z is the world's x, its x the world's -z.
        let half_pi = std::f64::consts::FRAC_PI_2;
        let mut pose = Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, half_pi, 0.0));
        pose.translation = Vec3::new(1.0, 0.0, 0.0);
        let seen = object.seen_from(&pose).unwrap();
        assert!((seen.position - Vec3::new(-3.0, 2.0, 0.0)).norm() < 1e-12);
        assert!((seen.velocity - Vec3::new(-0.5, 0.0, 0.0)).norm() < 1e-12);
        let expected = Vec6::new(0.09, 0.04, 0.01, 0.36, 0.25, 0.16);
        assert!((seen.covariance - Mat6::from_diagonal(&expected)).norm() < 1e-12);
        let unseen = Object {
            position: None,
            velocity: None,
            covariance: None,
            ..object
        };
        assert_eq!(unseen.seen_from(&pose), None);
    }
}

//! Objects: what a detector sees, followed through time.
//!
//! Answers: where every object is in the image of any pose and stamp, how it moves, and whether it has been standing still. Bridges what the detector
//! misses or answers late. Does not decide which features are rejected. One module each for the filter with depth (`spatial`), the one without (`planar`),
//! what a detection measures (`measurement`, `depth`), the assignment (`associate`, `expected`, `fit`, `occlusion`, `profile`), the life of an object (`track`, `tracker`, `sight`, `duplicates`, `lost`).

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

/// Number of an object; never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectId(pub u32);

/// How sure it is that an object is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectState {
    /// Seen too little to be sure, or just found more than a step from where it was taken to be: may be a false alarm, masks all the same.
    Tentative,
    /// Seen at least three times, and in the newest detections.
    Confirmed,
    /// Seen at least three times, but not in the newest detections.
    Coasting,
    /// Seen at least three times, but not in the newest detections; and what their frame shows in its place is something else, mostly nearer, or its place is
    /// mostly outside the image.
    Hidden,
}

/// An object at a stamp, seen from a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Which one.
    pub id: ObjectId,
    /// What it is.
    pub class: ClassId,
    /// Score of its last detection, 0 to 1.
    pub score: f32,
    /// How sure it is.
    pub state: ObjectState,
    /// Where it is expected in the raw image, px, cut to the image; without area when it is outside the view.
    pub bounds: BoundingBox,
    /// Standard deviation of the box's vertical and of its horizontal sides, px: how far the object may reach beyond the box. Zero behind the camera.
    pub bounds_sigma: [f64; 2],
    /// Nearest and farthest depth (camera z, m) of its surface, widened by the standard deviation of its predicted depth; `None` without depth or
    /// behind the camera.
    pub depth_range: Option<[f64; 2]>,
    /// Middle of its visible surface in the world, m; `None` while no depth of it was seen. While the object is more than tentative it moves no faster than a run
    /// from one update to the next.
    pub position: Option<Vec3>,
    /// Velocity in the world, m/s; `None` with the position.
    pub velocity: Option<Vec3>,
    /// Covariance of position and velocity (m^2, m^2/s, m^2/s^2), in this order; `None` with the position.
    pub covariance: Option<Mat6>,
    /// Width and height, m; `None` with the position.
    pub size: Option<[f64; 2]>,
    /// Stamp of its last detection, s.
    pub last_seen: f64,
    /// Whether it moves.
    pub motion: Motion,
}

/// Where an object is and how it moves, seen from a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectInCamera {
    /// Middle of its visible surface in camera coordinates, m.
    pub position: Vec3,
    /// Its velocity in the world, in the axes of the camera, m/s: that of the camera is not taken off.
    pub velocity: Vec3,
    /// Covariance of position and velocity (m^2, m^2/s, m^2/s^2), in this order, in the axes of the camera. That of the camera's pose is
    /// not in it.
    pub covariance: Mat6,
}

impl Object {
    /// The object seen from a camera with this pose in the world; `None` while no depth of the object was seen.
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
    fn an_object_is_the_same_from_the_camera_and_in_the_world() {
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

//! Rotations, rigid motions, camera models, robust kernels, trajectory alignment and assignment, in f64. Independent of
//! images, features and maps.
//!
//! Conventions: camera axes x right, y down, z forward; metres and radians; a pose named `a_from_b` maps coordinates of
//! frame b to frame a; a twist is `[translation; rotation]` and perturbs a pose from the left.

mod alignment;
mod assignment;
mod camera;
mod camera_check;
mod figure;
mod imu;
mod odometry;
pub mod robust;
mod se3;
pub mod so3;

pub use alignment::{Alignment, AlignmentError, align_umeyama};
pub use assignment::assign;
pub use camera::{BrownConrady, Camera};
pub use camera_check::CameraError;
pub use figure::FigureError;
pub use imu::{ImuModel, STANDARD_GRAVITY};
pub use odometry::OdometryModel;
pub use se3::Se3;

pub use nalgebra;
/// Column 2-vector of f64.
pub type Vec2 = nalgebra::Vector2<f64>;
/// Column 3-vector of f64.
pub type Vec3 = nalgebra::Vector3<f64>;
/// Column 6-vector of f64: a twist `[translation; rotation]`.
pub type Vec6 = nalgebra::Vector6<f64>;
/// 3x3 matrix of f64.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// 6x6 matrix of f64.
pub type Mat6 = nalgebra::Matrix6<f64>;

//! What is wrong with an RGB-D stream, from a few seconds of it.
//!
//! Answers: which of the usual mistakes (depth scale, registration, mirrored images, focal length, synchronisation, lens model, stamps,
//! exposure, blur, holes, images that stand still; axes, units and clock of an inertial sensor; mount and clock of odometry) a stream shows, how sure that is, and what to do about it. Takes frames from anywhere and knows no files:
//! [`Doctor::look`] at each frame, then [`Doctor::report`]. One module per kind of symptom; each says what it measured and, where that
//! is not as it should be, gives a [`Finding`].
//!
//! It does not correct anything, and what a scene does not show (a focal length while the camera stands still) it does not judge.

mod depth_scale;
mod doctor;
mod edges;
mod finding;
mod focal;
mod gradient;
mod images;
mod inertial;
mod lens;
mod median;
mod odometry;
mod registration;
mod stamps;
mod standstill;
mod sync;
mod tracks;

pub use doctor::{Doctor, Setup, examine};
pub use finding::{Figure, Finding, Report, Symptom};
pub use inertial::judge_inertial;
pub use odometry::judge_odometry;
pub use stamps::judge_clock;

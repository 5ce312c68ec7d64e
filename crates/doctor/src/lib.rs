//! Diagnoses faults of an RGB-D stream, from a few seconds of it.
//!
//! Answers: which of the usual faults (depth scale, registration, mirrored images, focal length, synchronisation, lens model, stamps,
//! exposure, blur, holes, frozen images; axes, units and clock of an inertial sensor; mount and clock of odometry) a stream has, with which
//! certainty, and the remedy. Takes frames from anywhere and knows no files: call [`Doctor::look`] for each frame, then [`Doctor::report`].
//! One module per kind of symptom; each reports its measurements and, if they are wrong, a [`Finding`].
//!
//! It corrects nothing, and skips checks that a scene does not allow (e.g. of the focal length of a still camera).

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

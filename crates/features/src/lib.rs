//! ORB features, descriptor and projection matching, and optical flow.
//!
//! Independent of cameras, poses and landmarks. Kernels are chosen at run time through [`stillpoint_imaging::Simd`];
//! all give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod brief;
mod config;
mod descriptor;
mod edge;
mod extract;
mod fast;
mod flow;
mod grid;
#[doc(hidden)]
pub mod kernels;
mod matching;
#[cfg(target_arch = "aarch64")]
mod neon;
mod orientation;
mod pattern;
mod spread;
mod subpixel;

pub use config::OrbConfig;
pub use descriptor::Descriptor;
pub use edge::Edge;
pub use extract::{Features, Keypoint, OrbExtractor};
pub use flow::{Flow, FlowConfig, FlowMatch};
pub use grid::FeatureGrid;
pub use matching::{BestTwo, RotationHistogram, Searched, Window, best_two, match_brute_force};

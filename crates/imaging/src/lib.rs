//! Images, pyramids and RGB-D frames. Independent of files (crate `datasets`) and features.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod blur;
mod coarse_depth;
mod frame;
mod image;
mod inertial;
#[doc(hidden)]
pub mod kernels;
#[cfg(target_arch = "aarch64")]
mod neon;
mod odometry;
mod pyramid;
mod resize;
pub mod rvl;
mod samples;
mod simd;
mod standstill;
pub mod workers;

pub use blur::Blur;
pub use coarse_depth::CoarseDepth;
pub use frame::{FrameId, FrameSource, RgbdFrame, SourceError};
pub use image::{ColourImage, DepthImage, GrayImage, SizeError};
pub use inertial::{ImuSample, ImuTrack};
pub use odometry::{OdometrySample, OdometryTrack};
pub use pyramid::Pyramid;
pub use samples::{SampleTrack, Stamped};
pub use simd::Simd;
pub use standstill::{Standstill, Still, StillWatch};
pub use workers::Workers;

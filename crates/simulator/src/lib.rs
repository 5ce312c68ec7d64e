//! Deterministic simulation of rooms with a Kinect-like camera and exact ground truth.
//!
//! Frames are pure functions of configuration, seed and index, bit-identical on every machine. It is independent of SLAM and writes no
//! files.
//!
//! Scenes are convex textured faces (`scene`, `texture`), rasterised with a depth buffer (`raster`, `shade`) from exact poses (`path`) at
//! the stamps of the colour and the depth image, row by row with a rolling shutter (`shutter`), and then degraded as by a real camera
//! (`sensor`, `disparity`). People move through some scenes (`people`); the pixels that they cover are known exactly (`truth`).

mod catalogue;
mod disparity;
mod error;
mod kept;
mod lens;
mod moment;
mod path;
mod people;
mod pixels;
mod random;
mod raster;
mod scene;
mod sensor;
mod shade;
mod shutter;
mod simulator;
mod surfaces;
mod texture;
mod truth;

pub use catalogue::scene_names;
pub use disparity::DepthModel;
pub use error::SimulatorError;
pub use shutter::Shutter;
pub use simulator::{
    SimulatedImu, SimulatedOdometry, Simulator, SimulatorConfig, SimulatorSource, WheelSlip,
};
pub use surfaces::{Surfaces, share_near};
pub use truth::{DetectionNoise, FrameTruth, MoverBox, MoverMotion, ScriptedDetection, ThingBox};

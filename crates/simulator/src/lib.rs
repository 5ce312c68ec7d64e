//! Deterministic rooms with a Kinect-like camera and exact ground truth.
//!
//! Answers: what an RGB-D camera would have recorded on a known path through a known room, for any seed, bit for bit the
//! same on every machine. Frames are pure functions of configuration and index. Knows no SLAM; writes no files.
//!
//! Scenes are convex textured faces (`scene`, `texture`), rasterised with a depth buffer (`raster`, `shade`) from exact poses
//! (`path`) at the stamps of the colour image and of the depth image, row by row where the shutter rolls (`shutter`), and then spoiled as a
//! real camera does (`sensor`, `disparity`).
//! People move through some scenes (`people`); what they cover is known exactly (`truth`).

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

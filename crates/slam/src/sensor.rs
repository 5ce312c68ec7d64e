//! The depth sensor: range, noise and depth of keypoints.

mod reader;

pub(crate) use reader::{DepthPoint, DepthReader, DepthReading, LANES};

use crate::timing::Timing;
use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// Range and noise of the depth sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorConfig {
    /// Minimum depth that is used, m. Range: 0.01 to 10. Structured-light cameras begin at 0.4 m; nearer values are
    /// noise.
    pub min_depth: f64,
    /// Maximum depth that is used, m. Range: 0.1 to 100. Beyond 8 m a Kinect's error exceeds 10 cm.
    pub max_depth: f64,
    /// Points nearer than this constrain the camera's translation best, m: the number tracked and shared decides about
    /// keyframes. Range: 0.1 to 100. 40 baselines of 7.5 cm. Landmarks are made at any depth.
    pub close_depth: f64,
    /// Factor on the sensor's own noise `0.0012 + 0.0019 (z - 0.4)^2` m (Nguyen, Izadi, Lovell, 3DIMPVT 2012). Range:
    /// 0.1 to 100.
    pub noise_scale: f64,
    /// Calibration error as a share of the depth, added to the noise in quadrature. Range: 0 to 0.2. Includes all
    /// errors shared by neighbouring pixels, which do not average out.
    pub calibration_error: f64,
    /// Readout time from the exposure of the colour image's first row to its last, s; 0 for a global shutter. Range: 0
    /// to 0.1. With `self_calibrate` this is the initial estimate.
    pub readout: f64,
    /// Standard deviation of `readout`, s, the prior of `self_calibrate`. Range: 0.00001 to 0.1. Use 0.02 for an
    /// unknown camera: rolling shutters take up to a frame's 33 ms.
    pub readout_sigma: f64,
    /// Age of a depth image at its stamp, s, beyond that of a colour image. Range: -0.1 to 0.1.
    pub depth_delay: f64,
    /// Estimates `readout` while tracking. Range: true or false. Few cameras document it, and with a rolling shutter it
    /// affects accuracy more than anything else.
    pub self_calibrate: bool,
}

impl Default for SensorConfig {
    fn default() -> Self {
        // `close_depth` follows ORB-SLAM2 (Mur-Artal, Tardos 2017), whose settings for the TUM cameras say 40
        // baselines.
        Self {
            min_depth: 0.3,
            max_depth: 8.0,
            close_depth: 3.0,
            noise_scale: 1.0,
            calibration_error: 0.016,
            readout: 0.0,
            readout_sigma: 0.02,
            depth_delay: 0.0,
            self_calibrate: true,
        }
    }
}

impl SensorConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_depth", self.min_depth, 0.01, 10.0);
        c.range("max_depth", self.max_depth, 0.1, 100.0);
        c.range("close_depth", self.close_depth, 0.1, 100.0);
        c.range("noise_scale", self.noise_scale, 0.1, 100.0);
        c.range("calibration_error", self.calibration_error, 0.0, 0.2);
        c.range("readout", self.readout, 0.0, 0.1);
        c.range("readout_sigma", self.readout_sigma, 1e-5, 0.1);
        c.range("depth_delay", self.depth_delay, -0.1, 0.1);
    }
}

impl SensorConfig {
    pub(crate) fn timing(&self) -> Timing {
        Timing {
            readout: self.readout,
            readout_sigma: if self.self_calibrate {
                self.readout_sigma
            } else {
                0.0
            },
            depth_delay: self.depth_delay,
        }
    }
}

/// The depth sensor's own noise, without calibration: `scale (0.0012 + 0.0019 (z - 0.4)^2)` m (Nguyen, Izadi, Lovell,
/// 3DIMPVT 2012). Used wherever two depths are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    scale: f64,
}

/// Minimum noise of a Kinect, m: by Nguyen, Izadi, Lovell (3DIMPVT 2012), as are both constants below.
const LEAST_SIGMA: f64 = 0.0012;
/// Distance of the minimum noise of a Kinect, m (Nguyen, Izadi, Lovell 2012).
const LEAST_AT: f64 = 0.4;
/// Growth of the noise of a Kinect with the square of the distance beyond [`LEAST_AT`], 1/m (Nguyen, Izadi, Lovell
/// 2012).
const SIGMA_GROWTH: f64 = 0.0019;

impl Default for DepthNoise {
    fn default() -> Self {
        Self { scale: 1.0 }
    }
}

impl DepthNoise {
    /// Standard deviation at a depth `z`, m.
    #[must_use]
    pub fn sigma(self, z: f64) -> f64 {
        self.scale * (LEAST_SIGMA + SIGMA_GROWTH * (z - LEAST_AT) * (z - LEAST_AT))
    }

    /// Likewise in single precision, for per-cell use.
    #[must_use]
    #[inline]
    pub fn sigma_f32(self, z: f32) -> f32 {
        let beyond = z - LEAST_AT as f32;
        self.scale as f32 * (LEAST_SIGMA as f32 + SIGMA_GROWTH as f32 * beyond * beyond)
    }
}

impl SensorConfig {
    /// The sensor's own noise.
    #[must_use]
    pub fn noise(&self) -> DepthNoise {
        DepthNoise {
            scale: self.noise_scale,
        }
    }
}

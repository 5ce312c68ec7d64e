//! Makes frames of a driver's raw images, in the same way as of recorded ones.

use crate::calibration;
use crate::decode::{self, Bad, depth::Unit};
use crate::optics::Optics;
use crate::rectify::Rectifier;
use crate::register::Registration;
use crate::setup::{Side, Treatment};
use stillpoint_datasets::CameraModel;
use stillpoint_geometry::{ImuModel, Se3};
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_ros_messages as ros;

/// A colour and a depth camera on one rigid body.
#[derive(Clone, Debug)]
pub struct Pair<'a> {
    /// Name for messages.
    pub name: String,
    /// The colour camera.
    pub colour: ros::CameraInfo<'a>,
    /// The depth camera.
    pub depth: ros::CameraInfo<'a>,
    /// Pose of the depth camera; `None` if depth is registered to the colour camera.
    pub colour_from_depth: Option<Se3>,
    /// Depth values per metre; `None` for millimetres.
    pub depth_scale: Option<f64>,
}

/// Makes frames of raw images: registers depth to colour, and rectifies lenses other than Brown's.
#[derive(Debug)]
pub struct RawFrames {
    treatment: Treatment,
}

impl RawFrames {
    /// For a pair of cameras; builds the lookup tables.
    ///
    /// # Errors
    /// An unusable camera.
    pub fn new(pair: &Pair<'_>) -> Result<Self, String> {
        let of = |info: &ros::CameraInfo<'_>, which: &str| {
            let size = (info.width, info.height);
            let found = calibration::of_images(info, false, "its description", size);
            let refused =
                |bad: Bad| format!("{which}: expected {}, found {}", bad.expected, bad.found);
            found.map(|c| c.optics).map_err(refused)
        };
        let (colour, depth) = (of(&pair.colour, "colour")?, of(&pair.depth, "depth")?);
        let mut unit = Unit::default();
        unit.whole = pair.depth_scale.unwrap_or(unit.whole);
        let model = CameraModel {
            name: pair.name.clone(),
            camera: colour.camera(),
            depth_scale: unit.whole,
            nominal: false,
            imu: None,
            odometry: None,
        };
        let target = Optics::of_camera(&model.camera);
        let registration = pair.colour_from_depth.as_ref();
        Ok(Self {
            treatment: Treatment {
                unit,
                camera: model,
                resampled_from: None,
                rectifier: colour.needs_rectifying().then(|| Rectifier::new(&colour)),
                registration: registration.map(|pose| Registration::new(&depth, &target, pose)),
            },
        })
    }

    /// Sets the inertial sensor.
    #[must_use]
    pub fn with_imu(mut self, imu: Option<ImuModel>) -> Self {
        self.treatment.camera.imu = imu;
        self
    }

    /// The camera of the frames.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        &self.treatment.camera
    }

    /// A frame of two images with these stamps, s.
    ///
    /// # Errors
    /// An unusable image.
    pub fn frame(
        &self,
        id: FrameId,
        stamps: (f64, f64),
        colour: &ros::Image<'_>,
        depth: &ros::Image<'_>,
        keep_colour: bool,
    ) -> Result<RgbdFrame, String> {
        let colour = decode::colour(colour, keep_colour).map_err(|bad| told(Side::Colour, &bad))?;
        let depth =
            decode::depth(depth, self.treatment.unit).map_err(|bad| told(Side::Depth, &bad))?;
        let frame = self.treatment.frame(id, stamps, colour, depth);
        frame.map_err(|(shows, bad)| told(shows, &bad))
    }
}

fn told(shows: Side, bad: &Bad) -> String {
    let which = match shows {
        Side::Colour => "colour",
        Side::Depth => "depth",
    };
    format!(
        "{which} image: expected {}, found {}",
        bad.expected, bad.found
    )
}

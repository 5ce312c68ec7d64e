//! What is done to the images of a recording: its camera, the unit of depth, rectification and registration.

use crate::choose::{Pair, says_registered};
use crate::decode::{Bad, Colour};
use crate::error::{RecordingError, Result};
use crate::file::Entry;
use crate::input::OpenOptions;
use crate::optics::Optics;
use crate::probe::Probe;
use crate::recording::Recording;
use crate::rectify::Rectifier;
use crate::register::Registration;
use std::path::Path;
use stillpoint_datasets::CameraModel;
use stillpoint_imaging::{DepthImage, FrameId, RgbdFrame};

/// One of the two images of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    Colour,
    Depth,
}

/// What is done to images.
#[derive(Debug)]
pub(crate) struct Treatment {
    pub(crate) camera: CameraModel,
    /// Values per metre of depth images.
    pub(crate) depth_scale: f64,
    pub(crate) rectifier: Option<Rectifier>,
    pub(crate) registration: Option<Registration>,
}

impl Treatment {
    /// Sizes of the images of colour and depth as they are taken.
    pub(crate) fn sizes(&self) -> ((usize, usize), (usize, usize)) {
        let camera = &self.camera.camera;
        let colour = (camera.width as usize, camera.height as usize);
        let depth = self.registration.as_ref().map(Registration::depth_size);
        (colour, depth.unwrap_or(colour))
    }

    /// A frame of two images, which were taken at these times (s).
    ///
    /// # Errors
    /// Which of the images has a size that is not its camera's.
    pub(crate) fn frame(
        &self,
        id: FrameId,
        (stamp, depth_stamp): (f64, f64),
        mut colour: Colour,
        mut depth: DepthImage,
    ) -> std::result::Result<RgbdFrame, (Side, Bad)> {
        let camera = &self.camera.camera;
        let expected = (camera.width as usize, camera.height as usize);
        let found = (colour.gray.width(), colour.gray.height());
        if found != expected {
            return Err((Side::Colour, other_size(expected, found)));
        }
        let found = (depth.width(), depth.height());
        if let Some(registration) = &self.registration {
            let wanted = registration.depth_size();
            let registered = registration.register(&depth);
            depth = registered.ok_or_else(|| (Side::Depth, other_size(wanted, found)))?;
        } else if found != expected {
            return Err((Side::Depth, other_size(expected, found)));
        }
        if let Some(rectifier) = &self.rectifier {
            colour = rectifier.colour(colour);
            if self.registration.is_none() {
                depth = rectifier.depth(&depth).unwrap_or(depth);
            }
        }
        Ok(RgbdFrame {
            id,
            stamp,
            depth_stamp,
            gray: colour.gray,
            colour: colour.colour,
            depth,
        })
    }
}

pub(crate) fn other_size(expected: (usize, usize), found: (usize, usize)) -> Bad {
    Bad {
        expected: format!("{} x {} px, the size of the camera", expected.0, expected.1),
        found: format!("{} x {} px", found.0, found.1),
    }
}

/// What decides on what is done to images.
pub(crate) struct Setup<'a> {
    pub(crate) path: &'a Path,
    pub(crate) options: &'a OpenOptions,
    pub(crate) probe: &'a Probe,
    pub(crate) pair: &'a Pair,
    pub(crate) guesses: &'a mut Vec<String>,
    pub(crate) warnings: &'a mut Vec<String>,
}

impl Setup<'_> {
    pub(crate) fn treatment(
        &mut self,
        recording: &mut Recording,
        entries: &[Entry],
    ) -> Result<Treatment> {
        let sizes = crate::source::sizes(recording, self.pair, entries)?;
        self.treatment_of(sizes)
    }

    /// For images of colour and depth of these sizes.
    pub(crate) fn treatment_of(&mut self, sizes: ((u32, u32), (u32, u32))) -> Result<Treatment> {
        let (mut optics, name, nominal) = self.colour_optics()?;
        if (optics.width, optics.height) == (0, 0) {
            (optics.width, optics.height) = sizes.0;
        }
        if (optics.width, optics.height) != sizes.0 {
            let expected = format!(
                "images of {} x {} px, the size of {name}",
                optics.width, optics.height
            );
            return Err(self.camera_error(expected, format!("{} x {} px", sizes.0.0, sizes.0.1)));
        }
        let depth_scale = self.depth_scale();
        let named = self.named()?;
        let model = CameraModel {
            name,
            camera: optics.camera(),
            depth_scale,
            nominal,
            imu: named.as_ref().and_then(|m| m.imu),
            odometry: named.and_then(|m| m.odometry),
        };
        model.camera.check().map_err(|e| {
            self.camera_error(
                format!("a camera with {}", e.expected()),
                format!("{} with {}", model.name, e.found()),
            )
        })?;
        let registration = self.registration(&optics, sizes.1)?;
        // Depth that is registered is registered to the camera without distortion at once.
        let rectifier = optics.needs_rectifying().then(|| Rectifier::new(&optics));
        if rectifier.is_some() {
            self.guesses
                .push("images are rectified: the lens model is not Brown's".to_owned());
        }
        Ok(Treatment {
            camera: model,
            depth_scale,
            rectifier,
            registration,
        })
    }

    fn camera_error(&self, expected: String, found: String) -> RecordingError {
        RecordingError::Camera {
            path: self.path.to_owned(),
            expected,
            found,
            advice: "name a preset or a camera file with --camera".to_owned(),
        }
    }

    /// The camera that the user named: its file says how sensors are mounted.
    fn named(&self) -> Result<Option<CameraModel>> {
        let file = self.options.camera.as_ref().map(CameraModel::choose);
        Ok(file.transpose()?)
    }

    /// The colour camera, its name, and whether it is nominal.
    fn colour_optics(&mut self) -> Result<(Optics, String, bool)> {
        if let Some(choice) = &self.options.camera {
            let model = CameraModel::choose(choice)?;
            let own = &self.pair.colour.info;
            if !model.nominal || own.as_ref().is_none_or(|info| info.k[0] <= 0.0) {
                let optics = Optics::of_camera(&model.camera);
                return Ok((optics, model.name, model.nominal));
            }
            self.guesses.push(format!(
                "the recording has a calibration of its own, which is better than the preset {}",
                model.name
            ));
        }
        let colour = &self.pair.colour;
        let registered = &self.pair.depth;
        // Depth in the colour camera has its matrix.
        let own = colour.info.as_ref().map(|info| (info, &colour.topic));
        let same = self
            .is_registered()
            .then_some(registered.info.as_ref())
            .flatten();
        let Some((info, topic)) = own.or(same.map(|info| (info, &registered.topic))) else {
            let expected = format!("a camera info beside {}", colour.topic);
            return Err(self.camera_error(expected, "none".to_owned()));
        };
        let rectified = is_rectified(&colour.topic);
        let optics = Optics::new(info, rectified);
        let optics = optics.map_err(|found| {
            self.camera_error(format!("a calibrated camera beside {topic}"), found)
        })?;
        let device = self
            .probe
            .device
            .as_ref()
            .map_or(String::new(), |d| format!("{d}: "));
        let name = format!("{device}camera info of {topic}");
        let [fx, fy, cx, cy] = optics.k;
        self.guesses.push(format!(
            "camera: {name} (fx {fx:.1}, fy {fy:.1}, cx {cx:.1}, cy {cy:.1} px)"
        ));
        Ok((optics, name, false))
    }

    fn depth_scale(&mut self) -> f64 {
        if let Some(scale) = self.options.depth_scale {
            return scale;
        }
        if let Some(scale) = self.probe.depth_scale {
            self.guesses.push(format!(
                "depth: {scale} values per metre, as the device says"
            ));
            return scale;
        }
        crate::decode::depth::MILLIMETRES
    }

    fn is_registered(&self) -> bool {
        let (colour, depth) = (&self.pair.colour, &self.pair.depth);
        let same_frame = !colour.frame.is_empty() && colour.frame == depth.frame;
        says_registered(&depth.topic) || same_frame
    }

    /// What brings depth into the colour camera; nothing where it is there already.
    fn registration(
        &mut self,
        optics: &Optics,
        depth_size: (u32, u32),
    ) -> Result<Option<Registration>> {
        let (colour, depth) = (&self.pair.colour, &self.pair.depth);
        let same_size = depth_size == (optics.width, optics.height);
        if self.is_registered() && same_size {
            return Ok(None);
        }
        let pose = self.probe.transforms.find(&colour.frame, &depth.frame);
        let Some((pose, info)) = pose.zip(depth.info.as_ref()) else {
            let missing = if depth.info.is_none() {
                "camera info"
            } else {
                "transform"
            };
            if same_size {
                self.warnings.push(format!(
                    "no {missing} says where {} stands to the colour camera: depth is taken as registered to it",
                    depth.topic
                ));
                return Ok(None);
            }
            let expected = format!(
                "depth of the size of the colour images, or a {missing} by which it can be registered"
            );
            let found = format!("depth images of {} x {} px", depth_size.0, depth_size.1);
            return Err(RecordingError::topics(
                self.path,
                &expected,
                found,
                "record camera infos and /tf_static as well, or registered depth",
            ));
        };
        let source = Optics::new(info, is_rectified(&depth.topic));
        let source = source.map_err(|found| {
            self.camera_error(format!("a calibrated camera beside {}", depth.topic), found)
        })?;
        if (source.width, source.height) != depth_size {
            let expected = format!("depth images of {} x {} px", source.width, source.height);
            return Err(
                self.camera_error(expected, format!("{} x {} px", depth_size.0, depth_size.1))
            );
        }
        // Some devices register by themselves, and say so by describing one camera twice.
        let apart = pose.translation.norm() > 1e-6 || pose.rotation.angle() > 1e-6;
        if !apart && source == *optics {
            self.guesses
                .push("depth is in the colour camera: both are described alike".to_owned());
            return Ok(None);
        }
        self.guesses.push(format!(
            "depth is registered to the colour camera, {:.1} mm beside",
            pose.translation.norm() * 1e3
        ));
        // Into the camera of the frames, which has no distortion where images are rectified.
        let target = Optics::of_camera(&optics.camera());
        Ok(Some(Registration::new(&source, &target, &pose)))
    }
}

/// Whether the images of a topic were undistorted, as image_proc names them.
fn is_rectified(topic: &str) -> bool {
    topic.to_lowercase().contains("rect") && !topic.to_lowercase().contains("image_rect_raw")
        || topic.to_lowercase().contains("undistorted")
}

//! The camera's frames of reference and calibrations, from topics.

use crate::options::Options;
use crate::{inertial, odometry};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use stillpoint::geometry::{ImuModel, OdometryModel, Se3};
use stillpoint::recordings::{
    ImageMessage, Incoming, IncomingTopic, OpenOptions, Transforms, is_calibrated, says_registered,
};
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::Format;

/// Maximum wait for depth registration or sensor mounts; then depth is used as it is or refused.
const PATIENCE: Duration = Duration::from_secs(3);

/// Maximum number of messages of `/tf_static` stored for recordings.
const MOST_CONSTANTS: usize = 1000;

/// Names of the topics of a camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraTopics {
    /// Colour images.
    pub colour: String,
    /// Depth images.
    pub depth: String,
    /// Camera infos of colour images.
    pub colour_info: String,
    /// Camera infos of depth images.
    pub depth_info: String,
    /// Whether colour images are `CompressedImage`.
    pub colour_compressed: bool,
    /// Whether depth images are `CompressedImage`.
    pub depth_compressed: bool,
}

/// State of a camera.
pub struct CameraState {
    topics: CameraTopics,
    colour_info: Option<Vec<u8>>,
    depth_info: Option<Vec<u8>>,
    transforms: Transforms,
    /// Messages of `/tf_static` with new content.
    constants: Vec<Vec<u8>>,
    parents: BTreeMap<String, String>,
    /// The frame of reference of the inertial sensor, after its first message.
    imu_frame: Option<String>,
    /// The frames of reference of the odometry and of its base, after its first message.
    odometry_frames: Option<[String; 2]>,
    /// Arrival of the first pair that could not be converted.
    waiting: Option<Instant>,
}

/// A camera whose images can be converted to frames.
pub struct Ready {
    /// Converts them.
    pub incoming: Incoming,
    /// The frame of reference of colour images.
    pub optical: String,
    /// The inertial sensor, if there is one with a known mount.
    pub imu: Option<ImuModel>,
    /// Reason for a missing inertial sensor that was requested.
    pub without_imu: Option<String>,
    /// The odometry of the camera's base, if its mount is known.
    pub wheels: Option<OdometryModel>,
    /// Reason for missing odometry that was requested.
    pub without_wheels: Option<String>,
}

/// Why images cannot be converted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotReady {
    /// Messages are still missing.
    Waiting(String),
    /// The messages are unusable.
    Refused(String),
}

impl CameraState {
    /// Without any messages.
    #[must_use]
    pub fn new(topics: CameraTopics) -> Self {
        Self {
            topics,
            colour_info: None,
            depth_info: None,
            transforms: Transforms::default(),
            constants: Vec::new(),
            parents: BTreeMap::new(),
            imu_frame: None,
            odometry_frames: None,
            waiting: None,
        }
    }

    /// Processes a camera info; returns whether the calibration changed.
    ///
    /// # Errors
    /// Unreadable messages.
    pub fn take_info(&mut self, is_depth: bool, bytes: Vec<u8>) -> Result<bool, String> {
        let info: ros::CameraInfo<'_> = ros::from_bytes(&bytes, Format::CdrLittleEndian)
            .map_err(|e| format!("camera info: {e}"))?;
        // Drivers that are not ready send zeros.
        if !is_calibrated(&info) {
            return Ok(false);
        }
        let known = if is_depth {
            &mut self.depth_info
        } else {
            &mut self.colour_info
        };
        let before = known.as_deref().and_then(read_info);
        let differs = before.is_some_and(|b| {
            let same = (b.width, b.height) == (info.width, info.height)
                && (&b.distortion_model, &b.d) == (&info.distortion_model, &info.d)
                && (b.k, b.p) == (info.k, info.p)
                && (b.binning_x, b.binning_y, &b.roi)
                    == (info.binning_x, info.binning_y, &info.roi);
            !same
        });
        *known = Some(bytes);
        Ok(differs)
    }

    /// Processes constant transforms.
    ///
    /// # Errors
    /// Unreadable messages.
    pub fn take_transforms(&mut self, bytes: &[u8]) -> Result<(), String> {
        let message: ros::TfMessage<'_> = ros::from_bytes(bytes, Format::CdrLittleEndian)
            .map_err(|e| format!("/tf_static: {e}"))?;
        let plain = |name: &str| name.trim_start_matches('/').to_owned();
        let mut news = false;
        for transform in &message.transforms {
            self.transforms.add(transform);
            let parent = plain(&transform.header.frame_id);
            news |= self
                .parents
                .insert(plain(&transform.child_frame_id), parent.clone())
                != Some(parent);
        }
        if news && self.constants.len() < MOST_CONSTANTS {
            self.constants.push(bytes.to_vec());
        }
        Ok(())
    }

    /// Stored messages of `/tf_static`.
    #[must_use]
    pub fn constants(&self) -> &[Vec<u8>] {
        &self.constants
    }

    /// Whether any transform is known.
    #[must_use]
    pub fn has_transforms(&self) -> bool {
        !self.parents.is_empty()
    }

    /// The root of a frame's tree.
    #[must_use]
    pub fn root_of(&self, frame: &str) -> String {
        let mut at = frame;
        // Bounds the search in cyclic trees.
        for _ in 0..=self.parents.len() {
            match self.parents.get(at) {
                Some(parent) => at = parent,
                None => break,
            }
        }
        at.to_owned()
    }

    /// The camera info messages, with the topics of their images.
    pub fn infos(&self) -> impl Iterator<Item = (&str, &[u8])> {
        let colour = self.colour_info.as_deref();
        let depth = self.depth_info.as_deref();
        let colour = colour.map(|bytes| (self.topics.colour.as_str(), bytes));
        colour
            .into_iter()
            .chain(depth.map(|bytes| (self.topics.depth.as_str(), bytes)))
    }

    /// The converter of such images to frames.
    ///
    /// # Errors
    /// Missing or unusable messages.
    pub fn ready(
        &mut self,
        colour: &ImageMessage<'_>,
        depth: &ImageMessage<'_>,
        options: &Options,
    ) -> Result<Ready, NotReady> {
        let info = self.colour_info.as_deref().and_then(read_info);
        let depth_info = self.depth_info.as_deref().and_then(read_info);
        let (of_colour, of_depth) = (frame(colour), frame(depth));
        let registered = of_colour == of_depth || says_registered(&self.topics.depth);
        if info.is_none() && !(registered && depth_info.is_some()) {
            return Err(NotReady::Waiting(format!(
                "the camera's calibration: no CameraInfo that holds one on {}",
                self.topics.colour_info
            )));
        }
        let missing = if registered {
            None
        } else if depth_info.is_none() {
            Some(format!("no CameraInfo on {}", self.topics.depth_info))
        } else if self.transforms.find(of_colour, of_depth).is_none() {
            Some(format!("no {of_depth} -> {of_colour} on /tf_static"))
        } else {
            None
        };
        let missing = missing.map(|m| format!("what tells where depth stands to colour: {m}"));
        let imu = options.subscribe_imu.then(|| self.imu(of_colour));
        let without_imu = imu.as_ref().and_then(|i| i.as_ref().err()).cloned();
        let wheels = options.subscribe_odometry.then(|| self.wheels(of_colour));
        let without_wheels = wheels.as_ref().and_then(|w| w.as_ref().err()).cloned();
        let waited = self.waiting.get_or_insert_with(Instant::now).elapsed();
        let beside = || without_imu.clone().or_else(|| without_wheels.clone());
        if let Some(missing) = missing.or_else(beside)
            && waited < PATIENCE
        {
            return Err(NotReady::Waiting(missing));
        }
        let topic = |topic, message, info| IncomingTopic {
            topic,
            message,
            info,
        };
        let open = OpenOptions {
            max_dt: options.max_dt,
            depth_scale: options.depth_scale,
            ..OpenOptions::default()
        };
        let incoming = Incoming::new(
            &topic(&self.topics.colour, colour, info.as_ref()),
            &topic(&self.topics.depth, depth, depth_info.as_ref()),
            &self.transforms,
            &open,
        );
        let incoming = incoming.map_err(|e| NotReady::Refused(e.to_string()))?;
        self.waiting = None;
        Ok(Ready {
            incoming,
            optical: of_colour.to_owned(),
            imu: imu.and_then(Result::ok),
            without_imu,
            wheels: wheels.and_then(Result::ok),
            without_wheels,
        })
    }

    /// Notes the frame of reference of the inertial sensor.
    pub fn note_inertial(&mut self, frame: &str) {
        if self.imu_frame.as_deref() != Some(frame) {
            self.imu_frame = Some(frame.to_owned());
        }
    }

    /// The inertial sensor, or a message about a missing transform.
    fn imu(&self, optical: &str) -> Result<ImuModel, String> {
        let what = "what tells where the inertial sensor stands to the camera";
        let Some(frame) = &self.imu_frame else {
            return Err(format!("{what}: no message of it"));
        };
        let model = inertial::mounted(&self.transforms, optical, frame);
        model.ok_or_else(|| format!("{what}: no {frame} -> {optical} on /tf_static"))
    }

    /// Notes the frames of reference of the odometry and of its base.
    pub fn note_odometry(&mut self, frames: &[String; 2]) {
        if self.odometry_frames.as_ref() != Some(frames) {
            self.odometry_frames = Some(frames.clone());
        }
    }

    /// The odometry, or a message about a missing transform.
    fn wheels(&self, optical: &str) -> Result<OdometryModel, String> {
        let what = "what tells where the camera stands on the base of the odometry";
        let Some(frames) = &self.odometry_frames else {
            return Err(format!("{what}: no message of it"));
        };
        let model = odometry::mounted(&self.transforms, optical, frames);
        model.ok_or_else(|| format!("{what}: no {optical} -> {} on /tf_static", frames[1]))
    }

    /// `base_from_optical`, if connected by transforms.
    #[must_use]
    pub fn base_from_optical(&self, base: &str, optical: &str) -> Option<Se3> {
        self.transforms.find(base, optical)
    }
}

fn read_info(bytes: &[u8]) -> Option<ros::CameraInfo<'_>> {
    ros::from_bytes(bytes, Format::CdrLittleEndian).ok()
}

fn frame<'m>(message: &'m ImageMessage<'_>) -> &'m str {
    message.header().frame_id.trim_start_matches('/')
}

#[cfg(test)]
mod tests;

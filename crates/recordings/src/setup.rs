//! Determines the processing of a recording's images: camera, unit of depth, rectification and registration.

use crate::calibration::{self, Calibration};
use crate::choose::Pair;
use crate::decode::depth::Unit;
use crate::decode::{Bad, Colour};
use crate::error::{RecordingError, Result};
use crate::file::Entry;
use crate::input::OpenOptions;
use crate::names::few;
use crate::optics::{Optics, is_calibrated};
use crate::placement::Placed;
use crate::probe::{Probe, Stream};
use crate::recording::Recording;
use crate::rectify::Rectifier;
use crate::register::Registration;
use crate::transforms::frame_name;
use std::path::Path;
use stillpoint_datasets::CameraModel;
use stillpoint_imaging::{DepthImage, FrameId, RgbdFrame};
use stillpoint_ros_messages::CameraInfo;

#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    Colour,
    Depth,
}

#[derive(Debug)]
pub(crate) struct Treatment {
    pub(crate) camera: CameraModel,
    pub(crate) unit: Unit,
    pub(crate) rectifier: Option<Rectifier>,
    pub(crate) registration: Option<Registration>,
    /// Size of depth images that have the colour images' view at another resolution.
    pub(crate) resampled_from: Option<(usize, usize)>,
}

impl Treatment {
    /// Sizes of the input images of colour and depth.
    pub(crate) fn sizes(&self) -> ((usize, usize), (usize, usize)) {
        let camera = &self.camera.camera;
        let colour = (camera.width as usize, camera.height as usize);
        let depth = self.registration.as_ref().map(Registration::depth_size);
        (colour, depth.or(self.resampled_from).unwrap_or(colour))
    }

    /// A frame of two images with these stamps, s.
    ///
    /// # Errors
    /// The image whose size differs from its camera's.
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
        } else if let Some(wanted) = self.resampled_from {
            if found != wanted {
                return Err((Side::Depth, other_size(wanted, found)));
            }
            depth = depth.resampled(expected.0, expected.1).unwrap_or(depth);
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

pub(crate) struct Setup<'a> {
    pub(crate) path: &'a Path,
    pub(crate) options: &'a OpenOptions,
    pub(crate) probe: &'a Probe,
    pub(crate) pair: &'a Pair,
    pub(crate) guesses: &'a mut Vec<String>,
    pub(crate) warnings: &'a mut Vec<String>,
}

impl<'a> Setup<'a> {
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
        let (optics, name, nominal) = self.colour_optics(sizes.0)?;
        let unit = self.unit();
        let named = self.named()?;
        let model = CameraModel {
            name,
            camera: optics.camera(),
            depth_scale: unit.of(&self.pair.depth.encoding),
            nominal,
            imu: named.as_ref().and_then(|m| m.imu),
            odometry: named.and_then(|m| m.odometry),
        };
        let (registration, resampled_from) = match self.placed(&optics, sizes.1)? {
            Placed::Registered => (None, None),
            Placed::Resampled => (None, Some((sizes.1.0 as usize, sizes.1.1 as usize))),
            Placed::Apart(registration) => (Some(*registration), None),
        };
        // Depth is registered directly to the undistorted camera.
        let rectifier = optics.needs_rectifying().then(|| Rectifier::new(&optics));
        if rectifier.is_some() {
            self.guesses
                .push("images are rectified: the lens model is not Brown's".to_owned());
        }
        Ok(Treatment {
            camera: model,
            unit,
            rectifier,
            registration,
            resampled_from,
        })
    }

    fn camera_error(&self, expected: String, found: String) -> RecordingError {
        RecordingError::Camera {
            path: self.path.to_owned(),
            expected,
            found,
            advice:
                "correct it where it comes from, or name a preset or a camera file with --camera"
                    .to_owned(),
        }
    }

    /// The camera given by the user; its file also states the mounting of sensors.
    fn named(&self) -> Result<Option<CameraModel>> {
        let file = self.options.camera.as_ref().map(CameraModel::choose);
        Ok(file.transpose()?)
    }

    /// The colour camera for images of this size, its name, and whether it is nominal.
    fn colour_optics(&mut self, size: (u32, u32)) -> Result<(Optics, String, bool)> {
        if let Some(choice) = &self.options.camera {
            let model = CameraModel::choose(choice)?;
            let own = self.pair.colour.info.as_ref();
            if !model.nominal || !own.is_some_and(is_calibrated) {
                let optics = self.named_optics(&model, size)?;
                return Ok((optics, model.name, model.nominal));
            }
            self.guesses.push(format!(
                "the recording has a calibration of its own, which is better than the preset {}",
                model.name
            ));
        }
        let (info, topic) = self.colour_info(size)?;
        let device = self.probe.device.as_ref();
        let device = device.map_or(String::new(), |d| format!("{d}: "));
        let name = format!("{device}camera info of {topic}");
        let rectified = is_rectified(&self.pair.colour.topic);
        let optics = self.calibrated(&info, rectified, &name, size)?;
        let [fx, fy, cx, cy] = optics.k;
        self.guesses.push(format!(
            "camera: {name} (fx {fx:.1}, fy {fy:.1}, cx {cx:.1}, cy {cy:.1} px)"
        ));
        Ok((optics, name, false))
    }

    fn named_optics(&self, model: &CameraModel, size: (u32, u32)) -> Result<Optics> {
        let mut optics = Optics::of_camera(&model.camera);
        if (optics.width, optics.height) == (0, 0) {
            (optics.width, optics.height) = size;
        }
        if (optics.width, optics.height) != size {
            let name = &model.name;
            let expected = format!(
                "images of {} x {} px, the size of {name}",
                optics.width, optics.height
            );
            return Err(self.camera_error(expected, format!("{} x {} px", size.0, size.1)));
        }
        optics.check().map_err(|bad| {
            let found = format!("{} with {}", model.name, bad.found);
            self.camera_error(format!("a camera with {}", bad.expected), found)
        })?;
        Ok(optics)
    }

    /// The camera of a camera info for images of this size; reports assumptions and contradictions.
    pub(crate) fn calibrated(
        &mut self,
        info: &CameraInfo<'_>,
        rectified: bool,
        name: &str,
        size: (u32, u32),
    ) -> Result<Optics> {
        let found = calibration::of_images(info, rectified, name, size);
        let Calibration {
            optics,
            guesses,
            warnings,
        } = found.map_err(|bad| self.camera_error(bad.expected, bad.found))?;
        self.guesses.extend(guesses);
        self.warnings.extend(warnings);
        Ok(optics)
    }

    /// The camera info of the colour images, and its topic.
    fn colour_info(&mut self, size: (u32, u32)) -> Result<(CameraInfo<'static>, String)> {
        let (colour, depth) = (&self.pair.colour, &self.pair.depth);
        if let Some(topic) = &self.options.info_topic {
            let info = self.probe.infos.get(topic).ok_or_else(|| {
                let expected = "--info-topic to name a topic of camera infos";
                let found = format!("{topic}, and of camera infos {}", self.listed(|_| true));
                RecordingError::topics(self.path, expected, found, "name one of these")
            })?;
            return Ok((info.clone(), topic.clone()));
        }
        // Registered depth has the matrix of the colour camera.
        let streams = [Some(colour), self.is_registered().then_some(depth)];
        let beside = streams.into_iter().flatten();
        let own = beside
            .clone()
            .find(|s| s.info.as_ref().is_some_and(is_calibrated));
        if let Some((stream, info)) = own.and_then(|s| Some((s, s.info.clone()?))) {
            if stream.empty_infos > 0 {
                self.guesses.push(format!(
                    "the first {} camera infos beside {} are empty or cannot be a camera's: the one after them is used",
                    stream.empty_infos, stream.topic
                ));
            }
            return Ok((info, stream.topic.clone()));
        }
        if let Some((topic, info)) = self.info_elsewhere(colour, size)? {
            self.guesses.push(format!(
                "no camera info with a calibration lies beside {}: that of {topic} is used, the only one of its frame and size",
                colour.topic
            ));
            return Ok((info.clone(), topic.clone()));
        }
        // Reports an info without a calibration as the cause.
        let empty = beside
            .clone()
            .find_map(|s| Some((s.info.clone()?, s.topic.clone())));
        empty.ok_or_else(|| {
            let expected = format!("a camera info beside {}", colour.topic);
            let found = format!("camera infos {}", self.listed(|_| true));
            RecordingError::Camera {
                path: self.path.to_owned(),
                expected,
                found,
                advice: "name one with --info-topic, or a preset or a camera file with --camera"
                    .to_owned(),
            }
        })
    }

    /// The only camera info with the frame and size of images that have none beside them.
    pub(crate) fn info_elsewhere(
        &self,
        stream: &Stream,
        size: (u32, u32),
    ) -> Result<Option<(&'a String, &'a CameraInfo<'static>)>> {
        let fits = |info: &CameraInfo<'_>| {
            frame_name(&info.header.frame_id) == stream.frame
                && is_calibrated(info)
                && calibration::fits(info, size)
        };
        let mut all = self.probe.infos.iter().filter(|(_, info)| fits(info));
        let Some(first) = all.next() else {
            return Ok(None);
        };
        let figures = |i: &CameraInfo<'_>| {
            (
                i.k,
                i.p,
                i.d.clone(),
                i.roi.clone(),
                i.binning_x,
                i.binning_y,
            )
        };
        if all.all(|(_, other)| figures(other) == figures(first.1)) {
            return Ok(Some(first));
        }
        Err(RecordingError::topics(
            self.path,
            &format!(
                "a camera info beside {}, or one of its frame \"{}\" and size",
                stream.topic, stream.frame
            ),
            format!("several: {}", self.listed(fits)),
            "name one with --info-topic",
        ))
    }

    fn listed(&self, wanted: impl Fn(&CameraInfo<'_>) -> bool) -> String {
        let all = self.probe.infos.iter().filter(|(_, info)| wanted(info));
        few(
            all.map(|(topic, i)| {
                format!("{topic} ({} x {} px, fx {:.1})", i.width, i.height, i.k[0])
            }),
            "none",
        )
    }

    fn unit(&mut self) -> Unit {
        if let Some(scale) = self.options.depth_scale {
            return Unit {
                whole: scale,
                float: scale,
            };
        }
        let mut unit = Unit::default();
        if let Some(scale) = self.probe.depth_scale {
            self.guesses.push(format!(
                "depth: {scale} values per metre, as the device says"
            ));
            unit.whole = scale;
        }
        unit
    }
}

/// Whether the images of a topic are rectified, by the names of image_proc. RealSense uses such a name for raw ones too.
pub(crate) fn is_rectified(topic: &str) -> bool {
    let topic = topic.to_lowercase();
    let mut words = topic.split(['/', '_', '-']);
    words.any(|w| w == "rect" || w.starts_with("rectif") || w == "undistorted")
        && !topic.contains("image_rect_raw")
}

#[cfg(test)]
mod tests {
    use super::is_rectified;

    #[test]
    fn topic_names_identify_rectified_images() {
        for topic in [
            "/left/image_rect_color",
            "/rgb/image_rect",
            "/cam/rectified/image",
            "/undistorted/image",
        ] {
            assert!(is_rectified(topic), "{topic}");
        }
        for topic in [
            "/camera/depth/image_rect_raw",
            "/direct/image_raw",
            "/rgb/image_raw",
        ] {
            assert!(!is_rectified(topic), "{topic}");
        }
    }
}

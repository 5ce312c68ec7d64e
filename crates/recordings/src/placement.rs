//! Relation of depth images to the colour camera, and how they are registered to it.

use crate::calibration;
use crate::error::{RecordingError, Result};
use crate::names::says_registered;
use crate::optics::{Optics, is_calibrated};
use crate::probe::Stream;
use crate::register::Registration;
use crate::setup::{Setup, is_rectified};
use stillpoint_ros_messages::CameraInfo;

impl Setup<'_> {
    pub(crate) fn is_registered(&self) -> bool {
        let (colour, depth) = (&self.pair.colour, &self.pair.depth);
        let same_frame = !colour.frame.is_empty() && colour.frame == depth.frame;
        says_registered(&depth.topic) || same_frame
    }

    /// Determines how depth is registered to the colour camera.
    pub(crate) fn placed(&mut self, optics: &Optics, depth_size: (u32, u32)) -> Result<Placed> {
        let (colour, depth) = (&self.pair.colour, &self.pair.depth);
        let size = (optics.width, optics.height);
        let same_size = depth_size == size;
        let registered = self.is_registered();
        if registered && same_size {
            return Ok(Placed::Registered);
        }
        // A phone's depth has the view of the colour camera at lower resolution.
        let same_view = have_one_shape(depth_size, size);
        let pose = self.probe.transforms.find(&colour.frame, &depth.frame);
        let own = depth.info.as_ref().filter(|info| is_calibrated(info));
        let elsewhere = || {
            let found = self.info_elsewhere(depth, depth_size).ok().flatten();
            found.map(|(_, info)| info)
        };
        let info = own.or_else(elsewhere).cloned();
        let describes = |info: &CameraInfo<'_>| calibration::fits(info, depth_size);
        if registered && same_view && !info.as_ref().is_some_and(describes) {
            self.guesses.push(in_other_pixels(depth, depth_size, size));
            return Ok(Placed::Resampled);
        }
        let Some((pose, info)) = pose.zip(info) else {
            let missing = if depth.info.is_none() {
                "camera info"
            } else {
                "transform"
            };
            return self.without_description(missing, depth_size, size);
        };
        let topic = depth.topic.clone();
        let name = format!("camera info of {topic}");
        let source = self.calibrated(&info, is_rectified(&topic), &name, depth_size)?;
        // Devices that register internally describe the same camera twice.
        let apart = pose.translation.norm() > 1e-6 || pose.rotation.angle() > 1e-6;
        if !apart && source == *optics {
            self.guesses
                .push("depth is in the colour camera: both are described alike".to_owned());
            return Ok(Placed::Registered);
        }
        self.guesses.push(format!(
            "depth is registered to the colour camera, {:.1} mm beside",
            pose.translation.norm() * 1e3
        ));
        // Into the camera of the frames, which has no distortion where images are rectified.
        let target = Optics::of_camera(&optics.camera());
        let registration = Registration::new(&source, &target, &pose);
        Ok(Placed::Apart(Box::new(registration)))
    }

    /// Without a description, depth with the colour images' aspect ratio is taken to be registered.
    fn without_description(
        &mut self,
        missing: &str,
        depth_size: (u32, u32),
        size: (u32, u32),
    ) -> Result<Placed> {
        let depth = &self.pair.depth;
        if !have_one_shape(depth_size, size) {
            let expected = format!(
                "depth of the colour images' proportions, or a {missing} by which it can be registered"
            );
            let found = format!("depth images of {} x {} px", depth_size.0, depth_size.1);
            return Err(RecordingError::topics(
                self.path,
                &expected,
                found,
                "record camera infos and /tf_static as well, or registered depth",
            ));
        }
        self.warnings.push(format!(
            "no {missing} says where {} stands to the colour camera: depth is taken as registered to it",
            depth.topic
        ));
        if depth_size == size {
            return Ok(Placed::Registered);
        }
        self.guesses.push(in_other_pixels(depth, depth_size, size));
        Ok(Placed::Resampled)
    }
}

fn have_one_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    u64::from(a.0) * u64::from(b.1) == u64::from(a.1) * u64::from(b.0)
}

pub(crate) enum Placed {
    /// Same pixels.
    Registered,
    /// Same view at another resolution.
    Resampled,
    /// A separate camera.
    Apart(Box<Registration>),
}

fn in_other_pixels(depth: &Stream, (w, h): (u32, u32), (width, height): (u32, u32)) -> String {
    format!(
        "{}: its images of {w} x {h} px are taken for the view of the colour images, {width} x {height} px, in other pixels",
        depth.topic
    )
}

//! Decodes the frames of a data set in order.

use crate::camera::CameraModel;
use crate::dataset::{Dataset, Entry};
use crate::decode::Picture;
use crate::error::{DatasetError, Result};
use crate::probe::check_size;
use std::sync::Arc;
use stillpoint_imaging::{
    FrameId, FrameSource, ImuSample, ImuTrack, OdometrySample, OdometryTrack, RgbdFrame,
    SourceError,
};

/// Which frames to read, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameOptions {
    /// Number of frames to skip at the start.
    pub start: usize,
    /// Maximum number of frames to read, unreadable ones included; `None` for all.
    pub max_frames: Option<usize>,
    /// Keep the colour image in the frame.
    pub keep_colour: bool,
}

/// Reads the frames of a data set in order. Frame ids count from 0 at the first frame read; an unreadable frame uses up its id.
#[derive(Debug)]
pub struct DatasetSource {
    entries: Arc<[Entry]>,
    left: std::ops::Range<usize>,
    next_id: u32,
    camera: CameraModel,
    keep_colour: bool,
    strict: bool,
    ended: bool,
    imu: ImuTrack,
    odometry: OdometryTrack,
    /// Stamp of the newest frame read, s.
    newest: Option<f64>,
}

/// Inertial samples are used from this long before the first frame, s.
const BEFORE: f64 = 0.1;
/// Odometry samples are used from this long before the first frame, s; they come ten times a second and more.
const BEFORE_ODOMETRY: f64 = 0.4;

impl DatasetSource {
    pub(crate) fn new(dataset: &Dataset, options: &FrameOptions) -> Result<Self> {
        let all = dataset.entries();
        if options.start >= all.len() {
            return Err(DatasetError::NoFrames {
                path: dataset.path().to_owned(),
                expected: format!("a start below the number of frames, {}", all.len()),
                found: format!("start {}", options.start),
                advice: "start earlier".into(),
            });
        }
        let rest = all.len() - options.start;
        let count = options.max_frames.unwrap_or(rest).min(rest);
        let mut imu = ImuTrack::new(Arc::clone(dataset.inertial()));
        imu.skip_before(all[options.start].stamp - BEFORE);
        let mut odometry = OdometryTrack::new(Arc::clone(dataset.odometry()));
        odometry.skip_before(all[options.start].stamp - BEFORE_ODOMETRY);
        Ok(Self {
            imu,
            odometry,
            newest: None,
            left: options.start..options.start + count,
            entries: dataset.shared_entries(),
            next_id: 0,
            camera: dataset.camera().clone(),
            keep_colour: options.keep_colour,
            strict: dataset.is_strict(),
            ended: false,
        })
    }

    fn read(&self, entry: &Entry, id: u32) -> Result<RgbdFrame> {
        // Sizes first: an image of another size is not decoded.
        let picture = Picture::of_colour(&entry.colour)?;
        check_size(&entry.colour, "colour", &self.camera, picture.size()?)?;
        let (gray, colour) = if self.keep_colour {
            let colour = picture.colour()?;
            (colour.to_gray(), Some(Arc::new(colour)))
        } else {
            (picture.gray()?, None)
        };
        let picture = Picture::of_depth(&entry.depth)?;
        check_size(&entry.depth, "depth", &self.camera, picture.size()?)?;
        let depth = picture.depth(self.camera.depth_scale)?;
        Ok(RgbdFrame {
            id: FrameId(id),
            stamp: entry.stamp,
            depth_stamp: entry.depth_stamp,
            gray,
            colour,
            depth,
        })
    }
}

impl FrameSource for DatasetSource {
    fn next_frame(&mut self) -> Option<std::result::Result<RgbdFrame, SourceError>> {
        if self.ended {
            return None;
        }
        let entries = Arc::clone(&self.entries);
        let entry = &entries[self.left.next()?];
        let id = self.next_id;
        self.next_id += 1;
        self.newest = Some(entry.stamp);
        Some(self.read(entry, id).map_err(|e| {
            self.ended = self.strict;
            SourceError {
                message: format!("frame {id} ({:.6} s): {e}", entry.stamp),
                recoverable: !self.strict,
            }
        }))
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        let imu = &mut self.imu;
        self.newest.map_or_else(Vec::new, |t| imu.take_until(t))
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        let odometry = &mut self.odometry;
        self.newest
            .map_or_else(Vec::new, |t| odometry.take_until(t))
    }

    fn remaining(&self) -> Option<usize> {
        Some(if self.ended { 0 } else { self.left.len() })
    }
}

//! Decodes the frames of a recording in order.

use crate::budget::one_line;
use crate::choose::Pair;
use crate::decode::depth::{Unit, is_float};
use crate::decode::{self, Colour};
use crate::error::{RecordingError, Result};
use crate::file::{Entry, FileRecording};
use crate::inertial::Samples;
use crate::odometry::Stands;
use crate::recording::Recording;
use crate::setup::{Side, Treatment, other_size};
use crate::store::{Slot, seconds};
use std::sync::Arc;
use stillpoint_datasets::{DatasetError, FrameOptions, ScaleDoubt};
use stillpoint_imaging::{
    DepthImage, FrameId, FrameSource, ImuSample, OdometrySample, RgbdFrame, SourceError,
};
use stillpoint_ros_messages as ros;

/// Reads the frames of a recording in order. Frame ids count from 0 at the first frame read; an unreadable frame uses up its id.
#[derive(Debug)]
pub struct RecordingSource {
    recording: Recording,
    entries: Arc<[Entry]>,
    treatment: Arc<Treatment>,
    left: std::ops::Range<usize>,
    next_id: u32,
    keep_colour: bool,
    strict: bool,
    ended: bool,
    /// Inertial and wheel samples, and the stamp of the newest frame, s.
    inertial: Option<Samples>,
    wheels: Option<Stands>,
    newest: Option<f64>,
}

impl RecordingSource {
    pub(crate) fn new(of: &FileRecording, options: &FrameOptions) -> Result<Self> {
        let all = of.entries.len();
        if options.start >= all {
            return Err(RecordingError::Dataset(DatasetError::NoFrames {
                path: of.path.clone(),
                expected: format!("a start below the number of frames, {all}"),
                found: format!("start {}", options.start),
                advice: "start earlier".into(),
            }));
        }
        let rest = all - options.start;
        let count = options.max_frames.unwrap_or(rest).min(rest);
        let first = of.entries[options.start].stamp;
        let sensor = of.inertial.clone();
        Ok(Self {
            inertial: sensor.map(|s| Samples::new(s, first)),
            wheels: of.wheels.as_ref().map(|w| Stands::new(w, first)),
            newest: None,
            recording: of.files.open()?,
            entries: Arc::clone(&of.entries),
            treatment: Arc::clone(&of.treatment),
            left: options.start..options.start + count,
            next_id: 0,
            keep_colour: options.keep_colour,
            strict: of.strict,
            ended: false,
        })
    }

    fn read(&mut self, entry: &Entry, id: u32) -> Result<RgbdFrame> {
        let treatment = Arc::clone(&self.treatment);
        let (seen, deep) = treatment.sizes();
        let read = &mut self.recording;
        let colour = colour(read, &entry.colour, self.keep_colour, Some(seen))?;
        let depth = depth(read, &entry.depth, treatment.unit, Some(deep))?;
        let times = (entry.stamp, entry.depth_stamp);
        treatment
            .frame(FrameId(id), times, colour, depth)
            .map_err(|(shows, bad)| {
                let slot = match shows {
                    Side::Colour => &entry.colour,
                    Side::Depth => &entry.depth,
                };
                image_error(&self.recording, slot, bad)
            })
    }
}

fn image_error(recording: &Recording, slot: &Slot, bad: decode::Bad) -> RecordingError {
    RecordingError::Image {
        path: recording.path.clone(),
        topic: recording.channel(slot).topic.clone(),
        stamp: seconds(slot.logged),
        expected: bad.expected,
        found: bad.found,
    }
}

fn is_compressed(recording: &Recording, slot: &Slot) -> bool {
    recording.channel(slot).type_name == "sensor_msgs/msg/CompressedImage"
}

/// Image size; if known, a compressed image of another size is not decoded.
type Size = Option<(usize, usize)>;

fn check_size(stated: Option<(u32, u32)>, size: Size) -> std::result::Result<(), decode::Bad> {
    let stated = stated.map(|(w, h)| (w as usize, h as usize));
    match stated.zip(size) {
        Some((found, expected)) if found != expected => Err(other_size(expected, found)),
        _ => Ok(()),
    }
}

fn colour(recording: &mut Recording, slot: &Slot, keep: bool, size: Size) -> Result<Colour> {
    let bytes = recording.read(slot)?;
    let decoded = if is_compressed(recording, slot) {
        let m: ros::CompressedImage<'_> = recording.parse(slot, &bytes)?;
        check_size(decode::stated_size(&m.data), size)
            .and_then(|()| decode::compressed_colour(&m.data, keep))
    } else {
        decode::colour(&recording.parse(slot, &bytes)?, keep)
    };
    decoded.map_err(|bad| image_error(recording, slot, bad))
}

fn depth(recording: &mut Recording, slot: &Slot, unit: Unit, size: Size) -> Result<DepthImage> {
    let bytes = recording.read(slot)?;
    let decoded = if is_compressed(recording, slot) {
        let m: ros::CompressedImage<'_> = recording.parse(slot, &bytes)?;
        check_size(decode::depth::stated_size(&m.format, &m.data), size)
            .and_then(|()| decode::compressed_depth(&m.format, &m.data, unit))
    } else {
        decode::depth(&recording.parse(slot, &bytes)?, unit)
    };
    decoded.map_err(|bad| image_error(recording, slot, bad))
}

/// Sizes of colour and depth images, from the first frame that can be decoded.
///
/// # Errors
/// The first error, if none of the tried frames can be decoded.
pub(crate) fn sizes(
    recording: &mut Recording,
    pair: &Pair,
    entries: &[Entry],
) -> Result<((u32, u32), (u32, u32))> {
    const TRIED: usize = 20;
    if pair.colour.size != (0, 0) && pair.depth.size != (0, 0) {
        return Ok((pair.colour.size, pair.depth.size));
    }
    let mut first = None;
    for entry in entries.iter().take(TRIED) {
        let both = colour(recording, &entry.colour, false, None)
            .and_then(|c| Ok((c, depth(recording, &entry.depth, Unit::default(), None)?)));
        match both {
            Ok((c, d)) => {
                let size = |w: usize, h: usize| (w as u32, h as u32);
                let colour = size(c.gray.width(), c.gray.height());
                return Ok((colour, size(d.width(), d.height())));
            }
            Err(e) => first = first.or(Some(e)),
        }
    }
    // The list of entries is not empty, but none could be decoded.
    Err(first.unwrap_or_else(|| {
        RecordingError::topics(&recording.path, "images", "none", "record it again")
    }))
}

/// Checks the depth unit on some images spread over the recording. Unreadable images are reported with their frames.
pub(crate) fn doubt(
    recording: &mut Recording,
    entries: &[Entry],
    unit: Unit,
    encoding: &str,
) -> Option<String> {
    const LOOKED_AT: usize = 3;
    let mut values = Vec::new();
    for k in 0..LOOKED_AT.min(entries.len()) {
        let entry = &entries[k * (entries.len() - 1) / (LOOKED_AT - 1)];
        if let Ok(image) = depth(recording, &entry.depth, unit, None) {
            ScaleDoubt::sample(&image, &mut values);
        }
    }
    scale_doubt(&mut values, unit, encoding)
}

pub(crate) fn scale_doubt(values: &mut [f64], unit: Unit, encoding: &str) -> Option<String> {
    let doubt = ScaleDoubt::of_message(values, unit.of(encoding), is_float(encoding))?;
    Some(doubt.said(&format!("--depth-scale {}", doubt.likely)))
}

impl FrameSource for RecordingSource {
    fn next_frame(&mut self) -> Option<std::result::Result<RgbdFrame, SourceError>> {
        if self.ended {
            return None;
        }
        let entry = self.entries[self.left.next()?];
        let id = self.next_id;
        self.next_id += 1;
        self.newest = Some(entry.stamp);
        Some(self.read(&entry, id).map_err(|e| {
            self.ended = self.strict;
            SourceError {
                message: one_line(&format!("frame {id} ({:.6} s): {e}", entry.stamp)),
                recoverable: !self.strict,
            }
        }))
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        match (&mut self.inertial, self.newest) {
            (Some(samples), Some(stamp)) => samples.take_until(&mut self.recording, stamp),
            _ => Vec::new(),
        }
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        match (&mut self.wheels, self.newest) {
            (Some(stands), Some(stamp)) => stands.take_until(&mut self.recording, stamp),
            _ => Vec::new(),
        }
    }

    fn remaining(&self) -> Option<usize> {
        Some(if self.ended { 0 } else { self.left.len() })
    }
}

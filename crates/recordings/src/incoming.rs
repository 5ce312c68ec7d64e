//! Makes frames of arriving image messages, in the same way as of recorded ones.
//!
//! A node and a recording of its messages make the same decisions (camera, unit of depth, rectification, registration), so that recorded
//! frames equal the tracked frames, bit for bit.

use crate::choose::Pair;
use crate::decode::colour::is_colour;
use crate::decode::depth::{Unit, is_compressed_depth, is_depth};
use crate::decode::{self, Bad, Colour};
use crate::error::Result;
use crate::input::OpenOptions;
use crate::probe::{Probe, Shows, Stream, base, info_topics, owned};
use crate::setup::{Setup, Side, Treatment};
use crate::source::scale_doubt;
use crate::store::seconds;
use crate::transforms::{Transforms, frame_name};
use std::path::Path;
use stillpoint_datasets::{CameraModel, ScaleDoubt};
use stillpoint_imaging::{DepthImage, FrameId, RgbdFrame};
use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, WireError};

/// An image in one of the two message types.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageMessage<'a> {
    /// `sensor_msgs/msg/Image`.
    Raw(ros::Image<'a>),
    /// `sensor_msgs/msg/CompressedImage`, of either image transport.
    Compressed(ros::CompressedImage<'a>),
}

impl<'a> ImageMessage<'a> {
    /// Parses a ROS 2 message.
    ///
    /// # Errors
    /// Invalid bytes.
    pub fn read(bytes: &'a [u8], compressed: bool) -> std::result::Result<Self, WireError> {
        let format = Format::CdrLittleEndian;
        Ok(if compressed {
            Self::Compressed(ros::from_bytes(bytes, format)?)
        } else {
            Self::Raw(ros::from_bytes(bytes, format)?)
        })
    }

    /// The header.
    #[must_use]
    pub fn header(&self) -> &ros::Header<'a> {
        match self {
            Self::Raw(image) => &image.header,
            Self::Compressed(image) => &image.header,
        }
    }

    /// The encoding: `rgb8`, or `rgb8; jpeg compressed bgr8`.
    #[must_use]
    pub fn encoding(&self) -> &str {
        match self {
            Self::Raw(image) => &image.encoding,
            Self::Compressed(image) => &image.format,
        }
    }

    fn colour(&self, keep: bool) -> std::result::Result<Colour, Bad> {
        match self {
            Self::Raw(image) => decode::colour(image, keep),
            Self::Compressed(image) => decode::compressed_colour(&image.data, keep),
        }
    }

    fn depth(&self, unit: Unit) -> std::result::Result<DepthImage, Bad> {
        match self {
            Self::Raw(image) => decode::depth(image, unit),
            Self::Compressed(image) => decode::compressed_depth(&image.format, &image.data, unit),
        }
    }

    /// Whether it shows colour or depth, judged without the topic's name.
    fn shows(&self) -> Shows {
        match self {
            Self::Raw(image) if is_depth(&image.encoding) => Shows::Depth,
            Self::Raw(image) if is_colour(&image.encoding) => Shows::Colour,
            Self::Raw(_) => Shows::Other,
            Self::Compressed(image) if is_compressed_depth(&image.format) => Shows::Depth,
            Self::Compressed(_) => Shows::Colour,
        }
    }
}

/// Seconds of a stamp, converted as in recordings, so that equal stamps give equal numbers.
#[must_use]
pub fn stamp_seconds(stamp: ros::Time) -> f64 {
    seconds(
        stamp
            .sec
            .saturating_mul(1_000_000_000)
            .saturating_add(i64::from(stamp.nanosec)),
    )
}

/// The conventional camera info topic of an image topic: `/camera/color/camera_info` for `/camera/color/image_raw`.
#[must_use]
pub fn camera_info_topic(image_topic: &str) -> String {
    info_topics(base(image_topic)).swap_remove(0)
}

/// An image topic with its first message.
#[derive(Clone, Copy, Debug)]
pub struct IncomingTopic<'a> {
    /// Topic name.
    pub topic: &'a str,
    /// The first message.
    pub message: &'a ImageMessage<'a>,
    /// The camera info, if any.
    pub info: Option<&'a ros::CameraInfo<'a>>,
}

impl IncomingTopic<'_> {
    fn stream(&self, shows: Shows, channel: u32) -> Stream {
        let compressed = matches!(self.message, ImageMessage::Compressed(_));
        Stream {
            channel,
            topic: self.topic.to_owned(),
            base: base(self.topic).to_owned(),
            compressed,
            encoding: self.message.encoding().to_owned(),
            shows,
            frame: frame_name(&self.message.header().frame_id).to_owned(),
            size: match self.message {
                ImageMessage::Raw(image) => (image.width, image.height),
                ImageMessage::Compressed(_) => (0, 0),
            },
            messages: 1,
            info: self.info.map(owned),
            empty_infos: 0,
        }
    }
}

/// Makes frames of the images of two topics.
#[derive(Debug)]
pub struct Incoming {
    treatment: Treatment,
    guesses: Vec<String>,
    warnings: Vec<String>,
}

impl Incoming {
    /// From the first messages of two topics, their camera infos and the known transforms.
    ///
    /// # Errors
    /// Images that cannot be decoded, a missing or unusable camera, depth that cannot be registered.
    pub fn new(
        colour: &IncomingTopic<'_>,
        depth: &IncomingTopic<'_>,
        transforms: &Transforms,
        options: &OpenOptions,
    ) -> Result<Self> {
        let sizes = sizes(colour, depth)?;
        let probe = Probe {
            transforms: transforms.clone(),
            ..Probe::default()
        };
        let pair = Pair::of(
            colour.stream(Shows::Colour, 0),
            depth.stream(Shows::Depth, 1),
        );
        let (mut guesses, mut warnings) = (Vec::new(), Vec::new());
        let mut setup = Setup {
            path: Path::new(colour.topic),
            options,
            probe: &probe,
            pair: &pair,
            guesses: &mut guesses,
            warnings: &mut warnings,
        };
        let treatment = setup.treatment_of(sizes)?;
        let mut values = Vec::new();
        if let Ok(image) = depth.message.depth(treatment.unit) {
            ScaleDoubt::sample(&image, &mut values);
        }
        warnings.extend(scale_doubt(
            &mut values,
            treatment.unit,
            depth.message.encoding(),
        ));
        Ok(Self {
            treatment,
            guesses,
            warnings,
        })
    }

    /// The camera of the frames.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        &self.treatment.camera
    }

    /// Guesses, one sentence each.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        &self.guesses
    }

    /// Suspicious but usable properties, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// A frame of two images with these stamps, s.
    ///
    /// # Errors
    /// An image that cannot be decoded, or whose size differs from the first one.
    pub fn frame(
        &self,
        id: FrameId,
        stamps: (f64, f64),
        colour: &ImageMessage<'_>,
        depth: &ImageMessage<'_>,
        keep_colour: bool,
    ) -> std::result::Result<RgbdFrame, String> {
        let told = |which: &str, bad: &Bad| {
            format!(
                "{which} image: expected {}, found {}",
                bad.expected, bad.found
            )
        };
        let colour = colour
            .colour(keep_colour)
            .map_err(|bad| told("colour", &bad))?;
        let depth = depth
            .depth(self.treatment.unit)
            .map_err(|bad| told("depth", &bad))?;
        let frame = self.treatment.frame(id, stamps, colour, depth);
        frame.map_err(|(shows, bad)| match shows {
            Side::Colour => told("colour", &bad),
            Side::Depth => told("depth", &bad),
        })
    }
}

/// Sizes of both images; decodes them where the messages do not state the size.
fn sizes(
    colour: &IncomingTopic<'_>,
    depth: &IncomingTopic<'_>,
) -> Result<((u32, u32), (u32, u32))> {
    let refuse = |topic: &IncomingTopic<'_>, bad: Bad| crate::RecordingError::Image {
        path: Path::new(topic.topic).to_owned(),
        topic: topic.topic.to_owned(),
        stamp: stamp_seconds(topic.message.header().stamp),
        expected: bad.expected,
        found: bad.found,
    };
    let found = depth.message.shows();
    if found == Shows::Colour && !depth.message.encoding().contains("16") {
        let bad = Bad {
            expected: "depth images (16UC1, mono16, 32FC1 or compressedDepth)".to_owned(),
            found: format!("encoding \"{}\"", depth.message.encoding()),
        };
        return Err(refuse(depth, bad));
    }
    let seen = colour
        .message
        .colour(false)
        .map_err(|e| refuse(colour, e))?;
    let deep = depth
        .message
        .depth(Unit::default())
        .map_err(|e| refuse(depth, e))?;
    let size = |w: usize, h: usize| (w as u32, h as u32);
    Ok((
        size(seen.gray.width(), seen.gray.height()),
        size(deep.width(), deep.height()),
    ))
}

//! Images of topics as they arrive, made into frames as those of a recording are.
//!
//! A node that receives messages and a recording of the same messages decide alike (camera, unit of depth, rectification, registration), so that frames
//! which were recorded are the frames that were tracked, bit for bit.

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

/// An image as one of the two messages that carry images.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageMessage<'a> {
    /// `sensor_msgs/msg/Image`.
    Raw(ros::Image<'a>),
    /// `sensor_msgs/msg/CompressedImage`, of either image transport.
    Compressed(ros::CompressedImage<'a>),
}

impl<'a> ImageMessage<'a> {
    /// Reads a message of ROS 2.
    ///
    /// # Errors
    /// Bytes that are no such message.
    pub fn read(bytes: &'a [u8], compressed: bool) -> std::result::Result<Self, WireError> {
        let format = Format::CdrLittleEndian;
        Ok(if compressed {
            Self::Compressed(ros::from_bytes(bytes, format)?)
        } else {
            Self::Raw(ros::from_bytes(bytes, format)?)
        })
    }

    /// Its header.
    #[must_use]
    pub fn header(&self) -> &ros::Header<'a> {
        match self {
            Self::Raw(image) => &image.header,
            Self::Compressed(image) => &image.header,
        }
    }

    /// What its pixels are: `rgb8`, or `rgb8; jpeg compressed bgr8`.
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

    /// What it is found to be a picture of, whatever its topic is called.
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

/// Seconds of a stamp, as recordings count them: two that read the same stamp have the same number.
#[must_use]
pub fn stamp_seconds(stamp: ros::Time) -> f64 {
    seconds(
        stamp
            .sec
            .saturating_mul(1_000_000_000)
            .saturating_add(i64::from(stamp.nanosec)),
    )
}

/// Where the camera info of an image topic is by the custom of image transports: `/camera/color/camera_info` of `/camera/color/image_raw`.
#[must_use]
pub fn camera_info_topic(image_topic: &str) -> String {
    info_topics(base(image_topic)).swap_remove(0)
}

/// A topic of images when its first message is here.
#[derive(Clone, Copy, Debug)]
pub struct IncomingTopic<'a> {
    /// Its name.
    pub topic: &'a str,
    /// A message of it.
    pub message: &'a ImageMessage<'a>,
    /// Its camera info, where there is one.
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
    /// For two topics, by their first messages, their camera infos and what is known of where they stand to each other.
    ///
    /// # Errors
    /// Images that cannot be decoded, no camera or one that cannot be worked with, depth that cannot be registered.
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

    /// What was found out, one sentence each.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        &self.guesses
    }

    /// What looks wrong but can be worked with, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// A frame of two images, which were taken at these times (s).
    ///
    /// # Errors
    /// Which of the images cannot be decoded or has another size than the first one, and what it is.
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

/// Sizes of both images. What is not to be seen from the message is decoded.
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

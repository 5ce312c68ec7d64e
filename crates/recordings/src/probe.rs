//! Examines one message of each image topic, and collects the messages that describe cameras.

use crate::budget::{LONGEST_NAME, MOST_COEFFICIENTS};
use crate::decode::colour::{has_planes, is_colour};
use crate::decode::depth::{is_compressed_depth, is_deep_png, is_depth};
use crate::error::Result;
use crate::names::says_depth;
use crate::optics::{is_calibrated, is_plausible};
use crate::recording::Recording;
use crate::store::Slot;
use crate::transforms::{Transforms, frame_name};
use crate::{orbbec, realsense};
use std::collections::BTreeMap;
use stillpoint_ros_messages as ros;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shows {
    Colour,
    Depth,
    Other,
}

#[derive(Clone, Debug)]
pub(crate) struct Stream {
    pub(crate) channel: u32,
    pub(crate) topic: String,
    /// The topic without the image transport's suffix.
    pub(crate) base: String,
    pub(crate) compressed: bool,
    pub(crate) encoding: String,
    pub(crate) shows: Shows,
    pub(crate) frame: String,
    /// Width and height; zero if unknown without decoding.
    pub(crate) size: (u32, u32),
    pub(crate) messages: u64,
    pub(crate) info: Option<ros::CameraInfo<'static>>,
    /// Number of preceding camera infos without a calibration.
    pub(crate) empty_infos: usize,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Probe {
    pub(crate) streams: Vec<Stream>,
    pub(crate) infos: BTreeMap<String, ros::CameraInfo<'static>>,
    pub(crate) transforms: Transforms,
    /// Depth values per metre, as stated by a RealSense.
    pub(crate) depth_scale: Option<f64>,
    pub(crate) device: Option<String>,
    pub(crate) said: usize,
    pub(crate) remarks: Vec<String>,
}

/// Maximum number of transform messages read: static transforms come first.
const TRANSFORMS: usize = 2000;
/// Maximum number of transforms read: three hundred frames in as many messages.
const MOST_SAID: usize = 600_000;
/// Number of unreadable camera infos after which a topic is abandoned.
const MOST_BROKEN: usize = 3;
/// Number of camera infos of a topic that are searched for a calibration: half a minute of a driver that is not ready.
const INFOS: usize = 1000;

impl Probe {
    pub(crate) fn new(recording: &mut Recording) -> Result<Self> {
        let mut probe = Self::default();
        let mut empty = BTreeMap::new();
        let mut infos = probe.infos(recording, &mut empty)?;
        for type_name in ["tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"] {
            for channel in recording.channels_of(type_name) {
                probe.transforms(recording, channel)?;
            }
        }
        realsense::describe(recording, &mut probe, &mut infos)?;
        orbbec::describe(recording, &mut probe, &mut infos)?;
        for type_name in ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"] {
            for channel in recording.channels_of(type_name) {
                let compressed = type_name.ends_with("CompressedImage");
                if let Some(mut stream) = probe.stream(recording, channel, compressed)? {
                    let beside = info_topics(&stream.base);
                    if let Some(topic) = beside.iter().find(|t| infos.contains_key(*t)) {
                        stream.info = infos.get(topic).cloned();
                        stream.empty_infos = empty.get(topic).copied().unwrap_or(0);
                    }
                    probe.streams.push(stream);
                }
            }
        }
        probe.infos = infos;
        Ok(probe)
    }

    /// The first plausible camera info of each topic, else the first with a calibration, else the first; `empty` counts those before.
    fn infos(
        &mut self,
        recording: &mut Recording,
        empty: &mut BTreeMap<String, usize>,
    ) -> Result<BTreeMap<String, ros::CameraInfo<'static>>> {
        let mut infos = BTreeMap::new();
        for channel in recording.channels_of("sensor_msgs/msg/CameraInfo") {
            let slots: Vec<Slot> = recording.slots_of(channel).take(INFOS).copied().collect();
            let topic = recording.topic(channel).to_owned();
            let mut broken = 0;
            for (i, slot) in slots.into_iter().enumerate() {
                let bytes = recording.read(&slot)?;
                let info = match recording.parse::<ros::CameraInfo<'_>>(&slot, &bytes) {
                    Ok(info) if is_oversized(&info) => {
                        self.remarks.push(format!(
                            "topic {topic}: a camera info with {} lens coefficients or a name that is too long is left out",
                            info.d.len()
                        ));
                        broken += 1;
                        if broken == MOST_BROKEN {
                            break;
                        }
                        continue;
                    }
                    Ok(info) => info,
                    Err(e) => {
                        broken += 1;
                        self.remarks.push(e.to_string());
                        if broken == MOST_BROKEN {
                            break;
                        }
                        continue;
                    }
                };
                let rank = |i: &ros::CameraInfo<'_>| (is_calibrated(i), is_plausible(i));
                if infos
                    .get(&topic)
                    .is_none_or(|best| rank(&info) > rank(best))
                {
                    empty.insert(topic.clone(), i - broken);
                    infos.insert(topic.clone(), owned(&info));
                }
                if is_plausible(&info) {
                    break;
                }
            }
        }
        Ok(infos)
    }

    fn transforms(&mut self, recording: &mut Recording, channel: u32) -> Result<()> {
        let slots: Vec<Slot> = recording
            .slots_of(channel)
            .take(TRANSFORMS)
            .copied()
            .collect();
        for slot in slots {
            if self.said > MOST_SAID {
                break;
            }
            let bytes = recording.read(&slot)?;
            match recording.parse::<ros::TfMessage<'_>>(&slot, &bytes) {
                Ok(message) => {
                    self.said += message.transforms.len();
                    let all = message.transforms.iter();
                    all.for_each(|t| self.transforms.add(t));
                }
                Err(e) => {
                    self.remarks.push(e.to_string());
                    break;
                }
            }
        }
        Ok(())
    }

    fn stream(
        &mut self,
        recording: &mut Recording,
        channel: u32,
        compressed: bool,
    ) -> Result<Option<Stream>> {
        let topic = recording.topic(channel).to_owned();
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            return Ok(None);
        };
        let bytes = recording.read(&slot)?;
        let looked = look(recording, &slot, &bytes, compressed);
        let (encoding, shows, frame, size) = match looked {
            Ok(looked) => looked,
            Err(e) => {
                self.remarks.push(e.to_string());
                return Ok(None);
            }
        };
        if encoding.len().max(frame.len()) > LONGEST_NAME {
            self.remarks.push(format!(
                "topic {topic}: an encoding or frame of more than {LONGEST_NAME} bytes"
            ));
            return Ok(None);
        }
        let base = base(&topic).to_owned();
        let of_device = realsense::frame(&topic).or_else(|| orbbec::frame(&topic));
        let frame = of_device.map_or(frame, str::to_owned);
        // Grey and depth share an encoding: the name decides.
        let grey = shows == Shows::Depth && encoding == "mono16" && !says_depth(&topic);
        let shows = orbbec::shows(&topic, if grey { Shows::Colour } else { shows });
        Ok(Some(Stream {
            channel,
            base,
            compressed,
            encoding,
            shows,
            frame,
            size,
            messages: recording.contents.counts[channel as usize].messages,
            info: None,
            empty_infos: 0,
            topic,
        }))
    }
}

type Looked = (String, Shows, String, (u32, u32));

fn look(recording: &Recording, slot: &Slot, bytes: &[u8], compressed: bool) -> Result<Looked> {
    let topic = &recording.channel(slot).topic;
    if compressed {
        let m: ros::CompressedImage<'_> = recording.parse(slot, bytes)?;
        let deep = is_compressed_depth(&m.format)
            || topic.ends_with("/compressedDepth")
            || is_deep_png(&m.data) && says_depth(topic);
        let shows = if deep { Shows::Depth } else { Shows::Colour };
        let frame = frame_name(&m.header.frame_id).to_owned();
        return Ok((m.format.into_owned(), shows, frame, (0, 0)));
    }
    let m: ros::Image<'_> = recording.parse(slot, bytes)?;
    let shows = if is_depth(&m.encoding) {
        Shows::Depth
    } else if is_colour(&m.encoding) {
        Shows::Colour
    } else {
        Shows::Other
    };
    let frame = frame_name(&m.header.frame_id).to_owned();
    let size = if has_planes(&m.encoding) {
        (0, 0)
    } else {
        (m.width, m.height)
    };
    Ok((m.encoding.into_owned(), shows, frame, size))
}

/// The topic without the image transport's suffix.
pub(crate) fn base(topic: &str) -> &str {
    ["/compressedDepth", "/compressed"]
        .iter()
        .find_map(|ending| topic.strip_suffix(ending))
        .unwrap_or(topic)
}

/// Candidate camera info topics of an image topic: beside it, as by image transports, or as by RealSense.
pub(crate) fn info_topics(base: &str) -> Vec<String> {
    let up = |topic: &str| {
        topic
            .rsplit_once('/')
            .map_or("", |(parent, _)| parent)
            .to_owned()
    };
    let parent = up(base);
    let above = up(&parent);
    vec![
        format!("{parent}/camera_info"),
        format!("{base}/camera_info"),
        format!("{above}/info/camera_info"),
        format!("{above}/camera_info"),
    ]
}

/// Whether a camera info exceeds the limits; it is copied for every pair of topics.
pub(crate) fn is_oversized(info: &ros::CameraInfo<'_>) -> bool {
    let names = info.distortion_model.len().max(info.header.frame_id.len());
    info.d.len() > MOST_COEFFICIENTS || names > LONGEST_NAME
}

pub(crate) fn owned(info: &ros::CameraInfo<'_>) -> ros::CameraInfo<'static> {
    let header = ros::Header {
        seq: info.header.seq,
        stamp: info.header.stamp,
        frame_id: info.header.frame_id.clone().into_owned().into(),
    };
    ros::CameraInfo {
        header,
        height: info.height,
        width: info.width,
        distortion_model: info.distortion_model.clone().into_owned().into(),
        d: info.d.clone(),
        k: info.k,
        r: info.r,
        p: info.p,
        binning_x: info.binning_x,
        binning_y: info.binning_y,
        roi: info.roi.clone(),
    }
}

//! Classifies image topics by their names, and formats lists of names.

use crate::probe::base;

/// Parts of topic names that mean depth registered to the colour camera.
const REGISTERED: [&str; 4] = [
    "aligned_depth_to_color",
    "depth_registered",
    "depth_to_rgb",
    "depth2rgb",
];

/// Whether the topic's name says that its depth is registered to the colour camera.
#[must_use]
pub fn says_registered(topic: &str) -> bool {
    let topic = topic.to_lowercase();
    REGISTERED.iter().any(|name| topic.contains(name))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Says {
    Depth,
    /// An image that shares an encoding with depth, but is not depth.
    Other,
}

/// Name parts of depth images. Drivers of stereo cameras name depth after the method.
const DEPTH_PARTS: [&str; 1] = ["depth"];
const DEPTH_WORDS: [&str; 5] = ["range", "distance", "tof", "stereo", "z16"];
/// Parts and words in names of other images with encoding 16UC1, mono16 or 32FC1.
const OTHER_PARTS: [&str; 13] = [
    "confidence",
    "disparity",
    "infra",
    "amplitude",
    "intensity",
    "reflec",
    "thermal",
    "variance",
    "uncertain",
    "segment",
    "semantic",
    "label",
    "validity",
];
const OTHER_WORDS: [&str; 20] = [
    "conf", "disp", "ir", "ir1", "ir2", "nir", "nearir", "swir", "lwir", "amp", "ambient",
    "signal", "noise", "std", "stddev", "error", "mask", "flags", "cost", "score",
];
/// Words for the images that stereo depth is computed from; in depth names they only state the source.
const SOURCE_WORDS: [&str; 5] = ["left", "right", "gray", "grey", "mono"];

/// Meaning of the last part of a topic's name that has one.
pub(crate) fn says(topic: &str) -> Option<Says> {
    let topic = base(topic).to_lowercase();
    topic.rsplit('/').find_map(|part| {
        // Depth registered to another camera is named after both.
        let part = part.split("_to_").next().unwrap_or(part);
        let has = |parts: &[&str], words: &[&str]| {
            parts.iter().any(|p| part.contains(p))
                || part.split(['_', '-', '.']).any(|w| words.contains(&w))
        };
        if has(&OTHER_PARTS, &OTHER_WORDS) {
            Some(Says::Other)
        } else if has(&DEPTH_PARTS, &DEPTH_WORDS) {
            Some(Says::Depth)
        } else {
            has(&[], &SOURCE_WORDS).then_some(Says::Other)
        }
    })
}

pub(crate) fn says_depth(topic: &str) -> bool {
    says(topic) == Some(Says::Depth)
}

/// Number of leading name parts that two topics share.
pub(crate) fn common_parts(a: &str, b: &str) -> i32 {
    let parts = a.split('/').skip(1).zip(b.split('/').skip(1));
    parts.take_while(|(a, b)| a == b).count() as i32
}

/// A list of limited length, for messages; `none` if it is empty.
pub(crate) fn few(mut all: impl Iterator<Item = String>, none: &str) -> String {
    const MOST: usize = 12;
    let first: Vec<String> = all.by_ref().take(MOST).collect();
    let more = all.count();
    match (first.len(), more) {
        (0, _) => none.to_owned(),
        (_, 0) => first.join(", "),
        _ => format!("{} and {more} more", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topic_names_identify_depth() {
        for topic in [
            "/camera/depth/image_rect_raw",
            "/camera/aligned_depth_to_infra1/image_raw",
            "/depth_to_rgb/image_raw/compressed",
            "/kinect2/hd/image_depth_rect",
            "/device_0/sensor_0/Depth_0/image/data",
            "/infra1/depth",
            "/oak/stereo/image_raw",
            "/depth_camera_left/image_raw",
            "/o3r/distance_image",
            "/data_throttled_image_depth/compressedDepth",
        ] {
            assert!(says_depth(topic), "{topic}");
        }
        for topic in [
            "/zed/zed_node/confidence/confidence_map",
            "/camera/depth/confidence",
            "/camera/depth_confidence/image",
            "/stereo/disparity",
            "/camera/infra1/image_rect_raw",
            "/ir/image_raw",
            "/infra1/image_rect_raw/compressedDepth",
            "/tof/amplitude_image",
            "/depth/intensity/image_raw",
            "/stereo/left/image_raw",
            "/thermal/image_raw",
            "/camera/image_raw",
        ] {
            assert!(!says_depth(topic), "{topic}");
        }
        assert!(says_registered("/camera/aligned_depth_to_color/image_raw"));
        assert!(!says_registered("/camera/depth/image_rect_raw"));
    }
}

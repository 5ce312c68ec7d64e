//! Chooses the camera's topics: scores pairs of colour and depth by their similarity.

use crate::error::{RecordingError, Result};
use crate::names::{Says, common_parts, few, says, says_registered};
use crate::probe::{Probe, Shows, Stream, base};
use std::collections::BTreeSet;
use std::path::Path;

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Named<'a> {
    pub(crate) colour: Option<&'a str>,
    pub(crate) depth: Option<&'a str>,
}

#[derive(Clone, Debug)]
pub(crate) struct Pair {
    pub(crate) colour: Stream,
    pub(crate) depth: Stream,
    pub(crate) reasons: String,
    score: i32,
}

impl Pair {
    /// Two streams given by the caller.
    pub(crate) fn of(colour: Stream, depth: Stream) -> Self {
        Self {
            colour,
            depth,
            reasons: String::new(),
            score: 0,
        }
    }
}

const MOST_LISTED: usize = 10;

/// Whether a stream may be chosen as depth automatically. The encoding alone is no evidence, since confidence, disparity and infrared
/// images share it; two transports carry only depth.
fn may_be_depth(stream: &Stream) -> bool {
    let by_device = crate::orbbec::frame(&stream.topic).is_some();
    match says(&stream.topic) {
        Some(says) => says == Says::Depth,
        None => by_device || stream.encoding.contains("compressedDepth"),
    }
}

/// Chooses a pair.
///
/// # Errors
/// [`RecordingError::Topics`]: no such topic, no colour or depth, or several cameras.
pub(crate) fn choose(path: &Path, probe: &Probe, named: Named<'_>) -> Result<Pair> {
    let colours = candidates(path, probe, Shows::Colour, named.colour, "--color-topic")?;
    let depths = candidates(path, probe, Shows::Depth, named.depth, "--depth-topic")?;
    let mut pairs: Vec<Pair> = colours
        .iter()
        .flat_map(|c| {
            let reached = probe.transforms.reached_from(&c.frame);
            depths.iter().map(move |d| pair(&reached, c, d))
        })
        .collect();
    // The stable sort keeps the order of the file for equal scores.
    pairs.sort_by_key(|p| std::cmp::Reverse(p.score));
    let best = pairs[0].clone();
    let rivals: Vec<&Pair> = pairs[1..].iter().filter(|p| is_rival(p, &best)).collect();
    if let Some(rival) = rivals.first() {
        let several = std::iter::once(&best).chain(rivals.iter().copied());
        let list: Vec<String> = several
            .take(MOST_LISTED)
            .map(|p| format!("{} with {}", p.colour.topic, p.depth.topic))
            .collect();
        let option = if rival.colour.channel == best.colour.channel {
            "--depth-topic"
        } else {
            "--color-topic"
        };
        return Err(RecordingError::topics(
            path,
            "one camera",
            format!("{}: {}", rivals.len() + 1, list.join("; ")),
            &format!("name one with {option}"),
        ));
    }
    Ok(best)
}

/// Whether a pair is equally plausible. Another camera may score a little lower because its names are less descriptive.
fn is_rival(pair: &Pair, best: &Pair) -> bool {
    let apart = pair.colour.base != best.colour.base && pair.depth.base != best.depth.base;
    pair.score == best.score || (apart && best.score - pair.score <= 2)
}

fn candidates<'p>(
    path: &Path,
    probe: &'p Probe,
    shows: Shows,
    named: Option<&str>,
    option: &str,
) -> Result<Vec<&'p Stream>> {
    // A topic given by the user overrides the guess by encoding.
    let deep = |s: &&Stream| {
        shows == Shows::Depth
            && named.is_some()
            && (s.encoding.starts_with("mono16") || s.encoding.contains("png"))
    };
    let all = probe.streams.iter();
    let all: Vec<&Stream> = all.filter(|s| s.shows == shows || deep(s)).collect();
    let what = if shows == Shows::Depth {
        "depth"
    } else {
        "colour"
    };
    if let Some(named) = named {
        // Also without the transport's suffix, the raw one first.
        let exact = all.iter().find(|s| s.topic == named);
        let found = exact.or_else(|| all.iter().find(|s| s.base == base(named)));
        return found.map(|s| vec![*s]).ok_or_else(|| {
            let expected = format!("{option} to name a topic of {what} images");
            RecordingError::topics(
                path,
                &expected,
                format!("{named}, and of {what} images {}", listed(&all)),
                "name one of these",
            )
        });
    }
    let all: Vec<&Stream> = match shows {
        Shows::Depth => all.into_iter().filter(|s| may_be_depth(s)).collect(),
        _ => all,
    };
    if all.is_empty() {
        let found = format!(
            "none among {}",
            listed(&probe.streams.iter().collect::<Vec<_>>())
        );
        let remark = probe
            .remarks
            .first()
            .map_or(String::new(), |r| format!(" ({r})"));
        let encoded = |s: &&Stream| {
            s.shows == shows || (shows == Shows::Depth && s.encoding.starts_with("mono16"))
        };
        let advice = match probe.streams.iter().find(encoded) {
            Some(stream) => format!(
                "no name says that its images are distances: record depth, or if {} is depth name it with {option}",
                stream.topic
            ),
            None => "record colour and depth of one camera".to_owned(),
        };
        return Err(RecordingError::topics(
            path,
            &format!("a topic of {what} images"),
            found + &remark,
            &advice,
        ));
    }
    // Raw rather than compressed images of the same stream: they are lossless and faster to read.
    let raw = |s: &&&Stream| s.compressed && all.iter().any(|o| !o.compressed && o.base == s.base);
    Ok(all.iter().filter(|s| !raw(s)).copied().collect())
}

fn listed(streams: &[&Stream]) -> String {
    let each = streams
        .iter()
        .map(|s| format!("{} ({}, {} messages)", s.topic, s.encoding, s.messages));
    few(each, "no image topics")
}

fn pair(reached: &BTreeSet<&str>, colour: &Stream, depth: &Stream) -> Pair {
    let (mut score, mut reasons) = (0, Vec::new());
    let mut add = |points: i32, reason: &str, holds: bool| {
        if holds {
            score += points;
            reasons.push(reason.to_owned());
        }
    };
    let same_info = colour.info.as_ref().zip(depth.info.as_ref());
    let same_info =
        same_info.is_some_and(|(c, d)| c.k == d.k && (c.width, c.height) == (d.width, d.height));
    add(4, "the same camera matrix", same_info);
    add(
        3,
        "its name says that it is registered",
        says_registered(&depth.topic),
    );
    let same_frame = !colour.frame.is_empty() && colour.frame == depth.frame;
    add(3, "the same frame", same_frame);
    let same = colour.frame == depth.frame;
    let chain = !same_frame && (same || reached.contains(depth.frame.as_str()));
    add(1, "a chain of transforms between them", chain);
    let common = common_parts(&colour.topic, &depth.topic);
    add(2 * common.min(2), "the same name space", common > 0);
    let named = ["color", "colour", "rgb"]
        .iter()
        .any(|n| colour.topic.to_lowercase().contains(n));
    add(2, "named after colour", named);
    let infrared = ["infra", "/ir/", "_ir/", "fisheye"]
        .iter()
        .any(|n| colour.topic.to_lowercase().contains(n));
    let grey = colour.encoding.starts_with("mono");
    score -= 3 * i32::from(infrared) + 2 * i32::from(grey);
    Pair {
        colour: colour.clone(),
        depth: depth.clone(),
        reasons: reasons.join(", "),
        score,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(channel: u32, topic: &str, encoding: &str, frame: &str) -> Stream {
        let deep = crate::decode::depth::is_depth(encoding) || topic.ends_with("compressedDepth");
        Stream {
            channel,
            topic: topic.to_owned(),
            base: base(topic).to_owned(),
            compressed: topic.contains("/compressed"),
            encoding: encoding.to_owned(),
            shows: if deep { Shows::Depth } else { Shows::Colour },
            frame: frame.to_owned(),
            size: (640, 480),
            messages: 10,
            info: None,
            empty_infos: 0,
        }
    }

    fn chosen(
        streams: &[(&str, &str, &str)],
        named: Named<'_>,
    ) -> std::result::Result<(String, String), String> {
        let streams = streams.iter().enumerate();
        let probe = Probe {
            streams: streams
                .map(|(i, (t, e, f))| stream(i as u32, t, e, f))
                .collect(),
            ..Probe::default()
        };
        choose(Path::new("file.mcap"), &probe, named)
            .map(|p| (p.colour.topic, p.depth.topic))
            .map_err(|e| e.to_string())
    }

    fn both(colour: &str, depth: &str) -> std::result::Result<(String, String), String> {
        Ok((colour.to_owned(), depth.to_owned()))
    }

    #[test]
    fn topics_of_common_drivers_are_chosen() {
        let none = Named::default();
        // realsense-ros: aligned before raw depth, colour before infrared, raw before compressed.
        let realsense = [
            (
                "/camera/camera/depth/image_rect_raw",
                "16UC1",
                "depth_optical",
            ),
            (
                "/camera/camera/infra1/image_rect_raw",
                "mono8",
                "infra_optical",
            ),
            (
                "/camera/camera/color/image_raw/compressed",
                "rgb8; jpeg",
                "colour_optical",
            ),
            ("/camera/camera/color/image_raw", "rgb8", "colour_optical"),
            (
                "/camera/camera/aligned_depth_to_color/image_raw",
                "16UC1",
                "colour_optical",
            ),
        ];
        let expected = both(
            "/camera/camera/color/image_raw",
            "/camera/camera/aligned_depth_to_color/image_raw",
        );
        assert_eq!(chosen(&realsense, none), expected);
        let without_raw = [realsense[0], realsense[1], realsense[2]];
        let expected = both(
            "/camera/camera/color/image_raw/compressed",
            "/camera/camera/depth/image_rect_raw",
        );
        assert_eq!(chosen(&without_raw, none), expected);
        // openni_launch and the Azure Kinect's driver.
        let kinect = [
            ("/camera/rgb/image_color", "bgr8", "rgb"),
            ("/camera/depth/image", "32FC1", "depth"),
            ("/camera/depth_registered/image_raw", "16UC1", "rgb"),
        ];
        assert_eq!(
            chosen(&kinect, none),
            both(
                "/camera/rgb/image_color",
                "/camera/depth_registered/image_raw"
            )
        );
        let azure = [
            ("/rgb/image_raw", "bgra8", "rgb_camera_link"),
            ("/depth/image_raw", "16UC1", "depth_camera_link"),
            ("/depth_to_rgb/image_raw", "16UC1", "rgb_camera_link"),
            ("/ir/image_raw", "mono16", "depth_camera_link"),
        ];
        assert_eq!(
            chosen(&azure, none),
            both("/rgb/image_raw", "/depth_to_rgb/image_raw")
        );
    }

    #[test]
    fn two_cameras_are_refused_with_the_list() {
        let two = [
            ("/front/color/image_raw", "rgb8", "front"),
            ("/front/depth/image_raw", "16UC1", "front"),
            ("/rear/color/image_raw", "rgb8", "rear"),
            ("/rear/depth/image_raw", "16UC1", "rear"),
        ];
        let refused = chosen(&two, Named::default()).unwrap_err();
        for part in [
            "/front/color/image_raw with /front/depth/image_raw",
            "/rear/color",
            "--color-topic",
        ] {
            assert!(refused.contains(part), "{refused}");
        }
        let rear = Named {
            colour: Some("/rear/color/image_raw"),
            depth: None,
        };
        assert_eq!(
            chosen(&two, rear),
            both("/rear/color/image_raw", "/rear/depth/image_raw")
        );
        let wrong = Named {
            colour: None,
            depth: Some("/front/dept"),
        };
        let refused = chosen(&two, wrong).unwrap_err();
        assert!(
            refused.contains("--depth-topic") && refused.contains("/rear/depth/image_raw"),
            "{refused}"
        );
    }

    #[test]
    fn images_encoded_like_depth_must_be_named() {
        for topic in [
            "/zed/confidence/confidence_map",
            "/infra1/image_raw",
            "/camera/image_raw",
        ] {
            let streams = [("/rgb/image", "rgb8", "a"), (topic, "32FC1", "a")];
            let refused = chosen(&streams, Named::default()).unwrap_err();
            for part in ["a topic of depth images", topic, "--depth-topic"] {
                assert!(refused.contains(part), "{refused}");
            }
            let named = Named {
                depth: Some(topic),
                ..Named::default()
            };
            assert_eq!(chosen(&streams, named), both("/rgb/image", topic));
            // With one depth stream the choice is unambiguous.
            let with_depth = [streams[0], streams[1], ("/depth/image", "16UC1", "b")];
            let expected = both("/rgb/image", "/depth/image");
            assert_eq!(chosen(&with_depth, Named::default()), expected);
        }
    }

    #[test]
    fn missing_topics_are_reported() {
        let refused = chosen(&[("/a", "rgb8", "")], Named::default()).unwrap_err();
        assert!(
            refused.contains("a topic of depth images") && refused.contains("/a (rgb8"),
            "{refused}"
        );
        let many = [("/a", "rgb8", ""); 20];
        let refused = chosen(&many, Named::default()).unwrap_err();
        assert!(refused.contains("and 8 more"), "{refused}");
        let refused = chosen(&[], Named::default()).unwrap_err();
        assert!(refused.contains("no image topics"), "{refused}");
    }
}

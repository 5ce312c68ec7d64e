//! Metadata in recordings of librealsense: ROS 1 bags use `Transform` and `KeyValue` messages, databases of SDK 2.58 and later strings of
//! `key=value;`.

use crate::error::Result;
use crate::probe::{Probe, is_oversized};
use crate::recording::Recording;
use crate::store::Slot;
use crate::transforms;
use std::collections::BTreeMap;
use stillpoint_geometry::nalgebra::Matrix3;
use stillpoint_ros_messages as ros;

const DEVICE: &str = "/device_";

/// Reads cameras, the unit of depth, and the poses of the sensors. The frame of a stream is the part of its topics before `/image/data`.
pub(crate) fn describe(
    recording: &mut Recording,
    probe: &mut Probe,
    infos: &mut BTreeMap<String, ros::CameraInfo<'static>>,
) -> Result<()> {
    let channels: Vec<(u32, String, String)> = recording
        .contents
        .channels
        .iter()
        .enumerate()
        .filter(|(_, c)| c.topic.starts_with(DEVICE))
        .map(|(i, c)| (i as u32, c.topic.clone(), c.type_name.clone()))
        .collect();
    for (channel, topic, type_name) in channels {
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            continue;
        };
        if topic.contains("/image/") || topic.contains("/imu/") {
            continue;
        }
        let read = one(recording, &slot, &topic, &type_name)?;
        match read {
            Some(Said::Info(info)) if !is_oversized(&info) => drop(infos.insert(topic, *info)),
            Some(Said::Transform(mut t)) => {
                // From the stream's frame to the device's.
                let device = topic.split('/').nth(1).unwrap_or_default().to_owned();
                t.header.frame_id = stream_of(&topic).to_owned().into();
                t.child_frame_id = device.into();
                probe.transforms.add(&t);
            }
            Some(Said::Unit(metres)) if metres > 0.0 => {
                probe.depth_scale = Some((1.0 / metres * 1e3).round() / 1e3);
            }
            Some(Said::Name(name)) => probe.device = Some(name),
            _ => {}
        }
    }
    Ok(())
}

pub(crate) fn stream_of(topic: &str) -> &str {
    let ends = ["/image/", "/imu/", "/tf/", "/camera_info", "/info"];
    let end = ends.iter();
    let end = end.filter_map(|part| topic.find(part)).min();
    topic[..end.unwrap_or(topic.len())].trim_start_matches('/')
}

/// The frame of a RealSense image topic: the images themselves name none that transforms contain.
pub(crate) fn frame(topic: &str) -> Option<&str> {
    let ours = topic.starts_with(DEVICE) && topic.contains("/image/data");
    ours.then(|| stream_of(topic))
}

/// The frame of a RealSense gyroscope or accelerometer topic.
pub(crate) fn imu_frame(topic: &str) -> Option<&str> {
    let ours = topic.starts_with(DEVICE) && topic.contains("/imu/data");
    ours.then(|| stream_of(topic))
}

enum Said {
    Info(Box<ros::CameraInfo<'static>>),
    Transform(ros::TransformStamped<'static>),
    /// Metres per value.
    Unit(f64),
    Name(String),
}

fn one(
    recording: &mut Recording,
    slot: &Slot,
    topic: &str,
    type_name: &str,
) -> Result<Option<Said>> {
    let bytes = recording.read(slot)?;
    let unit = topic.ends_with("/option/Depth Units/value")
        || topic.ends_with("/option/Depth_Units/value");
    // Unreadable metadata are ignored: they may not be needed.
    Ok(match type_name {
        "geometry_msgs/msg/Transform" => {
            let transform = recording.parse::<ros::Transform>(slot, &bytes).ok();
            transform.map(|transform| {
                Said::Transform(ros::TransformStamped {
                    transform,
                    ..ros::TransformStamped::default()
                })
            })
        }
        "std_msgs/msg/Float32" if unit => {
            let value = recording.parse::<ros::Float32>(slot, &bytes).ok();
            value.map(|v| Said::Unit(f64::from(v.data)))
        }
        "diagnostic_msgs/msg/KeyValue"
            if topic.ends_with("/info") && topic.matches('/').count() == 2 =>
        {
            let pair = recording.parse::<ros::KeyValue<'_>>(slot, &bytes).ok();
            pair.filter(|p| p.key == "Name")
                .map(|p| Said::Name(p.value.into_owned()))
        }
        "std_msgs/msg/String" => {
            let text = recording.parse::<ros::StringMessage<'_>>(slot, &bytes).ok();
            text.and_then(|t| string(topic, &t.data, unit))
        }
        _ => None,
    })
}

fn string(topic: &str, text: &str, unit: bool) -> Option<Said> {
    if unit {
        return text.trim().parse().ok().map(Said::Unit);
    }
    if topic.ends_with("/camera_info") {
        return info(text).map(Box::new).map(Said::Info);
    }
    if topic.contains("/tf/") {
        return transform(text).map(Said::Transform);
    }
    let is_device = topic.ends_with("/info") && topic.matches('/').count() == 2;
    let name = is_device.then(|| value(text, "Name")).flatten()?;
    Some(Said::Name(name.to_owned()))
}

pub(crate) fn value<'t>(text: &'t str, key: &str) -> Option<&'t str> {
    let pairs = text.split(';').filter_map(|pair| pair.split_once('='));
    pairs
        .into_iter()
        .find(|(k, _)| k.trim() == key)
        .map(|(_, v)| v.trim())
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|n| n.trim().parse().ok()).collect()
}

fn info(text: &str) -> Option<ros::CameraInfo<'static>> {
    let number = |key: &str| value(text, key)?.parse::<f64>().ok();
    let mut k = [0.0; 9];
    k[0] = number("fx")?;
    k[2] = number("ppx")?;
    k[4] = number("fy")?;
    k[5] = number("ppy")?;
    k[8] = 1.0;
    Some(ros::CameraInfo {
        width: number("width")? as u32,
        height: number("height")? as u32,
        distortion_model: value(text, "model")?.to_owned().into(),
        d: numbers(value(text, "coeffs")?)?,
        k,
        ..ros::CameraInfo::default()
    })
}

/// `rotation=...;translation=...`, the rotation column by column.
fn transform(text: &str) -> Option<ros::TransformStamped<'static>> {
    let r: [f64; 9] = numbers(value(text, "rotation")?)?.try_into().ok()?;
    let t: [f64; 3] = numbers(value(text, "translation")?)?.try_into().ok()?;
    let matrix = Matrix3::from_column_slice(&r);
    Some(ros::TransformStamped {
        transform: transforms::transform(matrix, t)?,
        ..ros::TransformStamped::default()
    })
}

/// The device stamp of each image, ns, by the time at which the image was received; in databases from the accompanying strings, in ms.
pub(crate) fn device_stamps(
    recording: &mut Recording,
    image_topic: &str,
) -> Result<BTreeMap<i64, i64>> {
    let mut stamps = BTreeMap::new();
    let Some(end) = image_topic.find("/image/data") else {
        return Ok(stamps);
    };
    let topic = format!("{}/image/metadata", &image_topic[..end]);
    let channels = recording.channels_of("std_msgs/msg/String");
    for channel in channels
        .into_iter()
        .filter(|c| recording.topic(*c) == topic)
        .collect::<Vec<_>>()
    {
        let slots: Vec<Slot> = recording.slots_of(channel).copied().collect();
        for slot in slots {
            let bytes = recording.read(&slot)?;
            let text = recording.parse::<ros::StringMessage<'_>>(&slot, &bytes)?;
            // Parsed as decimals: a float would be rounded.
            let Some(ns) = value(&text.data, "timestamp").and_then(milliseconds) else {
                continue;
            };
            stamps.insert(slot.logged, ns);
        }
    }
    Ok(stamps)
}

/// `360815.089000` ms as ns.
fn milliseconds(text: &str) -> Option<i64> {
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let part: String = part.chars().chain("000000".chars()).take(6).collect();
    let ns = whole.parse::<i64>().ok()?.checked_mul(1_000_000)?;
    ns.checked_add(part.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn database_metadata_strings_are_parsed() {
        let text = "width=640;height=480;fx=613.203674;ppx=319.938843;fy=613.419312;ppy=239.182999;model=Brown Conrady;coeffs=0,0,0,0,0";
        let info = info(text).unwrap();
        assert_eq!(
            (info.width, info.k[0], info.k[5]),
            (640, 613.203674, 239.182999)
        );
        let text = "rotation=0,1,0,-1,0,0,0,0,1;translation=0.1,0.2,0.3";
        let q = transform(text).unwrap().transform.rotation;
        assert!((q.z - 0.5_f64.sqrt()).abs() < 1e-12 && q.w > 0.0, "{q:?}");
        assert!(transform("rotation=0,0,0,0,0,0,0,0,0;translation=0,0,0").is_none());
        assert_eq!(milliseconds("360815.089000"), Some(360_815_089_000));
        assert_eq!(milliseconds("12"), Some(12_000_000));
        assert_eq!(milliseconds("x"), None);
        assert_eq!(
            stream_of("/device_0/sensor_0/Depth_0/tf/ref_0"),
            "device_0/sensor_0/Depth_0"
        );
    }
}

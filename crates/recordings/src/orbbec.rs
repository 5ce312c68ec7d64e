//! Bags of Orbbec's SDK: topics are numbered by sensor, and `OBStreamProfileInfo` describes the cameras.
//!
//! Depth is assumed in millimetres; such a bag does not state the setting.

use crate::error::Result;
use crate::probe::{Probe, Shows};
use crate::recording::Recording;
use crate::transforms;
use std::collections::BTreeMap;
use stillpoint_geometry::nalgebra::Matrix3;
use stillpoint_ros_messages as ros;

/// Topics of images, and of their stream profiles: sensor 2 is colour, 3 depth.
const COLOUR: (&str, &str) = ("/cam/sensor_2/", "/cam/streamProfileType_2");
const DEPTH: (&str, &str) = ("/cam/sensor_3/", "/cam/streamProfileType_3");
const SENSORS: &str = "/cam/sensor_";

pub(crate) fn frame(topic: &str) -> Option<&'static str> {
    [(COLOUR, "orbbec_color"), (DEPTH, "orbbec_depth")]
        .into_iter()
        .find_map(|((images, _), name)| topic.starts_with(images).then_some(name))
}

/// Meaning of a topic: encodings alone do not distinguish depth from infrared, nor infrared from grey.
pub(crate) fn shows(topic: &str, by_encoding: Shows) -> Shows {
    match frame(topic) {
        Some("orbbec_depth") if by_encoding == Shows::Colour => Shows::Depth,
        Some(_) => by_encoding,
        None if topic.starts_with(SENSORS) => Shows::Other,
        None => by_encoding,
    }
}

pub(crate) fn describe(
    recording: &mut Recording,
    probe: &mut Probe,
    infos: &mut BTreeMap<String, ros::CameraInfo<'static>>,
) -> Result<()> {
    for channel in recording.channels_of("custom_msg/msg/OBStreamProfileInfo") {
        let topic = recording.topic(channel).to_owned();
        let Some((images, _)) = [COLOUR, DEPTH].into_iter().find(|(_, p)| *p == topic) else {
            continue;
        };
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            continue;
        };
        let bytes = recording.read(&slot)?;
        match recording.parse::<ros::ObStreamProfileInfo<'_>>(&slot, &bytes) {
            Ok(profile) => {
                // The place beside the images where camera infos are looked for.
                let number = images.trim_start_matches(SENSORS).trim_end_matches('/');
                let beside = format!("{images}frameType_{number}/camera_info");
                infos.insert(beside, info(&profile));
                if let Some(transform) = transform(&profile) {
                    probe.transforms.add(&transform);
                }
            }
            Err(e) => probe.remarks.push(e.to_string()),
        }
    }
    for channel in recording.channels_of("custom_msg/msg/OBDeviceInfo") {
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            continue;
        };
        let bytes = recording.read(&slot)?;
        if let Ok(device) = recording.parse::<ros::ObDeviceInfo<'_>>(&slot, &bytes) {
            probe.device = Some(device.name.into_owned());
        }
    }
    Ok(())
}

fn info(profile: &ros::ObStreamProfileInfo<'_>) -> ros::CameraInfo<'static> {
    let [fx, fy, cx, cy] = profile.camera_intrinsic.map(f64::from);
    let [k1, k2, k3, k4, k5, k6, p1, p2] = profile.camera_distortion.map(f64::from);
    // OBCameraDistortionModel: none, three names of Brown's model, which the SDK computes alike, the rational one, Kannala and Brandt's.
    let (model, d) = match profile.distortion_model {
        0 => ("plumb_bob", Vec::new()),
        1..=3 => ("plumb_bob", vec![k1, k2, p1, p2, k3]),
        4 => ("rational_polynomial", vec![k1, k2, p1, p2, k3, k4, k5, k6]),
        5 => ("equidistant", vec![k1, k2, k3, k4]),
        _ => ("a lens model of Orbbec that is not known", vec![k1]),
    };
    ros::CameraInfo {
        width: profile.width.into(),
        height: profile.height.into(),
        distortion_model: model.into(),
        d,
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        ..ros::CameraInfo::default()
    }
}

/// The depth camera's pose in the colour camera; `None` for a stream without one.
fn transform(profile: &ros::ObStreamProfileInfo<'_>) -> Option<ros::TransformStamped<'static>> {
    let matrix = Matrix3::from_row_slice(&profile.rotation_matrix.map(f64::from));
    let t = profile.translation_matrix.map(|mm| f64::from(mm) * 1e-3);
    let mut found = ros::TransformStamped {
        transform: transforms::transform(matrix, t)?,
        ..ros::TransformStamped::default()
    };
    found.header.frame_id = "orbbec_color".into();
    found.child_frame_id = "orbbec_depth".into();
    Some(found)
}

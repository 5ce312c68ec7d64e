//! The camera's mount on the robot, from transforms, and the fallback without any.

use crate::camera::CameraState;
use crate::options::{ALL, Options};
use crate::outlet::Mounting;
use std::time::Duration;
use stillpoint::ros_events::{FrameNames, Mount};

/// Default name of the frame of the camera's body.
const BODY: &str = "camera_link";

/// Decides the mount, with an optional warning; `None` to wait longer for transforms.
#[must_use]
pub fn decide(
    camera: &CameraState,
    optical: &str,
    options: &Options,
    has_publishers: bool,
    waited: Duration,
) -> Option<(Mounting, Option<String>)> {
    let names = |body: &str| FrameNames {
        map: options.map_frame.clone(),
        odom: options.odom_frame.clone(),
        body: body.to_owned(),
        optical: optical.to_owned(),
    };
    let base = options.base_frame.as_str();
    if let Some(pose) = camera.base_from_optical(base, optical) {
        let mount = Some(Mount::of_optical(&pose));
        let names = names(base);
        return Some((Mounting { mount, names }, None));
    }
    let named = ALL
        .iter()
        .any(|d| d.name == "base_frame" && d.default != base);
    let patient = has_publishers || named;
    if patient && waited.as_secs_f64() < options.base_frame_timeout {
        return None;
    }
    // A frame can have only one parent, so the root of the camera's tree is used.
    let root = camera.root_of(optical);
    let pose = camera.base_from_optical(&root, optical);
    let (mount, body) = match pose.filter(|_| root != optical) {
        Some(pose) => (Some(Mount::of_optical(&pose)), root),
        None => (None, BODY.to_owned()),
    };
    let remark = (named || camera.has_transforms()).then(|| {
        format!(
            "nothing on /tf_static leads from {base} to {optical}: poses are of {body}; publish it and call reset, or set base_frame"
        )
    });
    let names = names(&body);
    Some((Mounting { mount, names }, remark))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraTopics;
    use crate::parameters::Parameters;
    use crate::value::Value;
    use stillpoint::ros_messages as ros;
    use stillpoint::ros_messages::{Format, to_bytes};

    fn camera(chain: &[(&'static str, &'static str)]) -> CameraState {
        let mut camera = CameraState::new(CameraTopics {
            colour: String::new(),
            depth: String::new(),
            colour_info: String::new(),
            depth_info: String::new(),
            colour_compressed: false,
            depth_compressed: false,
        });
        let transforms = chain.iter().map(|(parent, child)| {
            let mut t = ros::TransformStamped::default();
            t.header.frame_id = (*parent).into();
            t.child_frame_id = (*child).into();
            t.transform.translation.x = 0.25;
            t.transform.rotation.w = 1.0;
            t
        });
        let message = ros::TfMessage {
            transforms: transforms.collect(),
        };
        let bytes = to_bytes(&message, Format::CdrLittleEndian);
        camera.take_transforms(&bytes).unwrap();
        camera
    }

    fn options(base: &str) -> Options {
        let mut p = Parameters::default();
        p.set("base_frame", &Value::Text(base.to_owned())).unwrap();
        Options::new(&p).unwrap()
    }

    const NONE: Duration = Duration::ZERO;
    const LONG: Duration = Duration::from_secs(5);

    #[test]
    fn transform_chain_gives_the_mount() {
        let camera = camera(&[("base_link", "mast"), ("mast", "eye")]);
        let (found, remark) = decide(&camera, "eye", &options("base_link"), true, NONE).unwrap();
        assert_eq!(remark, None);
        assert_eq!(
            (found.names.body.as_str(), found.names.optical.as_str()),
            ("base_link", "eye")
        );
        let mount = found.mount.unwrap().pose();
        assert!((mount.translation.x - 0.5).abs() < 1e-12);
    }

    #[test]
    fn camera_tree_is_kept_without_a_chain_to_the_base() {
        let own = camera(&[("camera_link", "frame"), ("frame", "eye")]);
        // While there is a publisher, more transforms may come.
        assert!(decide(&own, "eye", &options("base_link"), true, NONE).is_none());
        let (found, remark) = decide(&own, "eye", &options("base_link"), true, LONG).unwrap();
        assert_eq!(found.names.body, "camera_link");
        assert!(found.mount.is_some() && remark.unwrap().contains("base_link to eye"));
    }

    #[test]
    fn body_frame_is_published_without_any_transform() {
        let none = camera(&[]);
        let (found, remark) = decide(&none, "eye", &options("base_link"), false, NONE).unwrap();
        assert_eq!(
            (found.names.body.as_str(), found.mount, remark),
            ("camera_link", None, None)
        );
        // A configured base is waited for.
        assert!(decide(&none, "eye", &options("robot"), false, NONE).is_none());
        let (_, remark) = decide(&none, "eye", &options("robot"), false, LONG).unwrap();
        assert!(remark.unwrap().contains("robot"));
    }
}

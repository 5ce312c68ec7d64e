//! Wheel odometry of the robot: its messages, and the camera's mount on the base.

use crate::names::{NodeName, Remap, resolve};
use crate::outputs::name_of;
use stillpoint::geometry::OdometryModel;
use stillpoint::imaging::OdometrySample;
use stillpoint::recordings::{Transforms, odometry_sample, stamp_seconds};
use stillpoint::ros_events::Topic;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, WireError};

/// The topic of the odometry, before remapping.
pub const ODOMETRY: &str = "wheel_odometry";

/// A message of odometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Rolled {
    /// The measured pose of the base.
    pub sample: OdometrySample,
    /// Stamp of the message.
    pub stamp: ros::Time,
    /// The odometry's frame of reference, and the frame of the base.
    pub frames: [String; 2],
}

impl Rolled {
    /// Parses a message.
    ///
    /// # Errors
    /// Unreadable messages, missing stamps, invalid poses.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let told = |e: WireError| format!("odometry: {e}");
        let message: ros::Odometry<'_> =
            ros::from_bytes(bytes, Format::CdrLittleEndian).map_err(told)?;
        let stamp = message.header.stamp;
        if stamp == ros::Time::default() {
            return Err(
                "odometry: expected messages with stamps of the camera's clock, found none"
                    .to_owned(),
            );
        }
        let Some(sample) = odometry_sample(&message, stamp_seconds(stamp)) else {
            return Err(format!(
                "odometry: expected poses of numbers with a quaternion of length 1, found {:?}",
                message.pose.pose
            ));
        };
        let plain = |name: &str| name.trim_start_matches('/').to_owned();
        Ok(Self {
            sample,
            stamp,
            frames: [
                plain(&message.header.frame_id),
                plain(&message.child_frame_id),
            ],
        })
    }
}

/// Name of the topic.
///
/// # Errors
/// It is one on which this node publishes.
pub fn topic(node: &NodeName, remaps: &[Remap]) -> Result<String, String> {
    let name = resolve(ODOMETRY, node, remaps);
    if name == resolve(&name_of(Topic::Odometry), node, remaps) {
        return Err(format!(
            "{ODOMETRY}: expected odometry of wheels, found {name}, on which this node publishes; rename another topic"
        ));
    }
    Ok(name)
}

/// The camera's mount on a base, with the error model of an indoor robot, if transforms connect them without passing through the odometry's
/// frame.
#[must_use]
pub fn mounted(
    transforms: &Transforms,
    optical: &str,
    [odom, base]: &[String; 2],
) -> Option<OdometryModel> {
    let base_from_camera = transforms.find_fixed(base, optical, odom)?;
    let model = OdometryModel::mounted(base_from_camera);
    model.check().is_ok().then_some(model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::ros_messages::to_bytes;

    fn message(sec: i64, w: f64) -> ros::Odometry<'static> {
        let mut m = ros::Odometry::default();
        m.header.stamp.sec = sec;
        m.header.frame_id = "/odom".into();
        m.child_frame_id = "/base_link".into();
        m.pose.pose.position.x = 0.5;
        m.pose.pose.orientation.w = w;
        m.pose.covariance.0[0] = 0.04;
        m
    }

    fn read(message: &ros::Odometry<'_>) -> Result<Rolled, String> {
        Rolled::read(&to_bytes(message, Format::CdrLittleEndian))
    }

    #[test]
    fn odometry_message_is_read() {
        let found = read(&message(7, 1.0)).unwrap();
        assert_eq!(found.frames, ["odom", "base_link"]);
        assert_eq!(
            (found.sample.stamp, found.sample.position),
            (7.0, [0.5, 0.0, 0.0])
        );
        assert_eq!(found.sample.sigmas, Some([0.2, 0.0]));
    }

    #[test]
    fn invalid_odometry_is_reported() {
        let told = |message: &ros::Odometry<'_>| read(message).unwrap_err();
        assert!(told(&message(0, 1.0)).contains("stamps"));
        assert!(told(&message(1, 0.0)).contains("length 1"));
        assert!(told(&message(1, f64::NAN)).contains("of numbers"));
        let cut = Rolled::read(&[0, 1, 0, 0, 9]).unwrap_err();
        assert!(cut.starts_with("odometry: "), "{cut}");
    }

    #[test]
    fn own_odometry_topics_are_refused_as_wheel_odometry() {
        let node = NodeName {
            namespace: "/robot1".into(),
            name: "stillpoint".into(),
        };
        let rule = |from: &str, to: &str| Remap {
            node: None,
            from: from.to_owned(),
            to: to.to_owned(),
        };
        assert_eq!(topic(&node, &[]).unwrap(), "/robot1/wheel_odometry");
        let wheels = rule(ODOMETRY, "/odom");
        assert_eq!(
            topic(&node, std::slice::from_ref(&wheels)).unwrap(),
            "/odom"
        );
        let own = rule(ODOMETRY, "/robot1/stillpoint/odometry");
        assert!(topic(&node, &[own]).unwrap_err().contains("publishes"));
        let both = [wheels, rule("~/odometry", "/odom")];
        assert!(topic(&node, &both).unwrap_err().contains("/odom"));
    }
}

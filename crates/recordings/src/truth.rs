//! Ground truth from a topic of poses.

use crate::error::{RecordingError, Result};
use crate::file::in_order;
use crate::probe::Probe;
use crate::recording::Recording;
use crate::store::{Slot, seconds};
use crate::transforms::{self, frame_name};
use stillpoint_datasets::{Mended, StampedPose};
use stillpoint_geometry::Se3;
use stillpoint_ros_messages as ros;

const TYPES: [&str; 3] = [
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
];

/// Poses in time order, and remarks about their stamps, one sentence each.
pub(crate) type Said = (Vec<StampedPose>, Vec<String>);

/// Reads the poses of a topic in time order, as poses of the colour camera with frame `camera`: transforms from the tracked frame to the
/// camera are applied if known.
pub(crate) fn read(
    recording: &mut Recording,
    probe: &Probe,
    topic: &str,
    camera: &str,
    guesses: &mut Vec<String>,
) -> Result<Said> {
    let channels = TYPES.iter().flat_map(|t| recording.channels_of(t));
    let all: Vec<u32> = channels.collect();
    let Some(channel) = all.iter().copied().find(|c| recording.topic(*c) == topic) else {
        let names: Vec<&str> = all.iter().map(|c| recording.topic(*c)).collect();
        let found = format!(
            "{topic}, and of poses {}",
            if names.is_empty() {
                "none".to_owned()
            } else {
                names.join(", ")
            }
        );
        let expected = "--truth-topic to name a topic of poses or odometry";
        return Err(RecordingError::topics(
            &recording.path,
            expected,
            found,
            "name one of these",
        ));
    };
    let slots: Vec<Slot> = recording.slots_of(channel).copied().collect();
    let (mut poses, mut read, mut stamps) = (Vec::new(), Vec::new(), Vec::new());
    let mut body = None;
    for slot in &slots {
        let bytes = recording.read(slot)?;
        let (pose, child) = one(recording, slot, &bytes)?;
        let Some(world_from_body) = pose else {
            continue;
        };
        let body_from_camera = body.get_or_insert_with(|| {
            let known = child
                .as_deref()
                .and_then(|c| probe.transforms.find(c, camera));
            guesses.push(match (&known, &child) {
                (Some(_), Some(child)) => {
                    format!("ground truth: {topic}, brought from {child} to {camera}")
                }
                _ => format!("ground truth: {topic}, taken as poses of the camera"),
            });
            known.unwrap_or_else(Se3::identity)
        });
        stamps.push(seconds(
            slot.stamp.filter(|s| *s != 0).unwrap_or(slot.logged),
        ));
        poses.push(world_from_body * *body_from_camera);
        read.push(*slot);
    }
    let mended = in_order(&stamps, &read, &recording.set_back);
    let said = remarks(&mended, topic);
    let pose = |(stamp, at): (f64, usize)| StampedPose {
        stamp,
        world_from_camera: poses[at],
    };
    Ok((mended.stamps.into_iter().map(pose).collect(), said))
}

fn remarks(mended: &Mended, topic: &str) -> Vec<String> {
    let set_back = mended.set_back.iter().map(|at| {
        let place = format!("ground truth: topic {topic}, pose {}", at.index + 1);
        Mended::remark(at, &place)
    });
    let count =
        |n: usize, what: &str| (n > 0).then(|| format!("ground truth: topic {topic}: {what}: {n}"));
    let late = count(
        mended.late,
        "poses that come late by their stamps, all of which are sorted",
    );
    let repeats = count(mended.repeats, "poses that repeat a stamp and are left out");
    set_back.chain(late).chain(repeats).collect()
}

/// The pose in a message, and the frame that it refers to.
fn one(recording: &Recording, slot: &Slot, bytes: &[u8]) -> Result<(Option<Se3>, Option<String>)> {
    let of = |p: &ros::Pose| {
        transforms::pose([p.position.x, p.position.y, p.position.z], &p.orientation)
    };
    Ok(match recording.channel(slot).type_name.as_str() {
        "nav_msgs/msg/Odometry" => {
            let m: ros::Odometry<'_> = recording.parse(slot, bytes)?;
            (
                of(&m.pose.pose),
                Some(frame_name(&m.child_frame_id).to_owned()),
            )
        }
        "geometry_msgs/msg/TransformStamped" => {
            let m: ros::TransformStamped<'_> = recording.parse(slot, bytes)?;
            let t = &m.transform.translation;
            let pose = transforms::pose([t.x, t.y, t.z], &m.transform.rotation);
            (pose, Some(frame_name(&m.child_frame_id).to_owned()))
        }
        // The message does not state the moving frame.
        _ => {
            let m: ros::PoseStamped<'_> = recording.parse(slot, bytes)?;
            (of(&m.pose), None)
        }
    })
}

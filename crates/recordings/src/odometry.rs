//! Wheel odometry of a recording: its topic, the camera's pose on the base, and its samples.
//!
//! Messages do not state their source: a topic is chosen automatically only if nothing suggests that it is not wheel odometry, and the
//! choice is reported.

use crate::error::{RecordingError, Result};
use crate::inertial::{Stamped, stamped};
use crate::names::few;
use crate::probe::{Probe, Stream};
use crate::recording::Recording;
use crate::store::Slot;
use crate::transforms::frame_name;
use std::sync::Arc;
use stillpoint_geometry::{OdometryModel, Se3};
use stillpoint_imaging::OdometrySample;
use stillpoint_ros_messages as ros;

const TYPE: &str = "nav_msgs/msg/Odometry";
/// Samples are used from this long before the first frame, s.
const BEFORE: f64 = 0.4;
/// Variances above these mark unmeasured values: m^2, and rad^2.
const OPEN: [f64; 2] = [1e4, 10.0];
/// Suffix of the odometry topics that this program publishes.
const OWN: &str = "/stillpoint/odometry";
/// Words in names of topics and base frames that exclude wheel odometry: cameras, lasers, fusion, and ground truth.
const NOT_WHEELS: [&str; 36] = [
    "camera",
    "cam",
    "optical",
    "visual",
    "vision",
    "vo",
    "vio",
    "stereo",
    "rgbd",
    "orb",
    "slam",
    "rtabmap",
    "vins",
    "openvins",
    "okvis",
    "kimera",
    "basalt",
    "zed",
    "t265",
    "realsense",
    "imu",
    "lidar",
    "laser",
    "icp",
    "loam",
    "lio",
    "gps",
    "gnss",
    "uwb",
    "truth",
    "groundtruth",
    "gt",
    "mocap",
    "vicon",
    "optitrack",
    "qualisys",
];

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wanted<'a> {
    pub(crate) topic: Option<&'a str>,
    pub(crate) truth: Option<&'a str>,
    pub(crate) model: Option<OdometryModel>,
}

#[derive(Clone, Debug)]
pub(crate) struct Wheels {
    pub(crate) model: OdometryModel,
    stands: Stamped,
}

#[derive(Clone, Debug)]
struct Topic {
    channel: u32,
    name: String,
    /// The fixed frame in which the base moves.
    odom: String,
    base: String,
}

impl Topic {
    fn is_own(&self) -> bool {
        self.name.ends_with(OWN)
    }

    /// The word that excludes wheel odometry.
    fn doubt(&self) -> Option<&'static str> {
        let text = format!("{} {}", self.name, self.base).to_lowercase();
        let mut words = text.split(|c: char| !c.is_ascii_alphanumeric());
        words.find_map(|word| NOT_WHEELS.iter().copied().find(|n| *n == word))
    }

    /// The camera's pose on the base by constant transforms, avoiding the odometry frame.
    fn mount(&self, probe: &Probe, camera: &str) -> Option<Se3> {
        let known = !self.base.is_empty();
        known.then(|| probe.transforms.find_fixed(&self.base, camera, &self.odom))?
    }
}

/// Finds the wheel odometry; `None`, with a warning, if no topic or several topics qualify, or if the camera's pose on the base is unknown.
/// `by_arrival`: frames are stamped with the time of arrival.
///
/// # Errors
/// [`RecordingError::Topics`]: the given topic is not odometry, or is this program's own or the ground truth.
pub(crate) fn find(
    recording: &mut Recording,
    probe: &Probe,
    wanted: Wanted<'_>,
    colour: &Stream,
    by_arrival: bool,
    said: (&mut Vec<String>, &mut Vec<String>),
) -> Result<Option<Wheels>> {
    let (guesses, warnings) = said;
    let topics = topics(recording)?;
    let is_free = |t: &&Topic| !t.is_own() && Some(t.name.as_str()) != wanted.truth;
    let free: Vec<&Topic> = topics.iter().filter(is_free).collect();
    let chosen = match wanted.topic {
        Some(named) => Some(named_one(recording, &free, named)?),
        None => only(&free, warnings),
    };
    let Some(chosen) = chosen else {
        return Ok(None);
    };
    let by_transforms = || {
        chosen
            .mount(probe, &colour.frame)
            .map(OdometryModel::mounted)
    };
    let model = wanted.model.or_else(by_transforms);
    let Some(model) = model.filter(|m| m.check().is_ok()) else {
        warnings.push(unmounted(chosen, &colour.frame));
        return Ok(None);
    };
    let stands = stamped(recording, chosen.channel, by_arrival);
    guesses.push(format!(
        "odometry: {} of {}, {} samples, mounted as the {}{}",
        chosen.name,
        base_name(chosen),
        stands.len(),
        match wanted.model {
            Some(_) => "camera file says",
            None => "transforms say",
        },
        match wanted.topic {
            Some(_) => "",
            None => "; taken to be of wheels (--no-odometry leaves it out)",
        }
    ));
    Ok(Some(Wheels { model, stands }))
}

fn topics(recording: &mut Recording) -> Result<Vec<Topic>> {
    let mut found = Vec::new();
    for channel in recording.channels_of(TYPE) {
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            continue;
        };
        let bytes = recording.read(&slot)?;
        let Ok(message) = recording.parse::<ros::Odometry<'_>>(&slot, &bytes) else {
            continue;
        };
        found.push(Topic {
            channel,
            name: recording.topic(channel).to_owned(),
            odom: frame_name(&message.header.frame_id).to_owned(),
            base: frame_name(&message.child_frame_id).to_owned(),
        });
    }
    Ok(found)
}

fn named_one<'t>(recording: &Recording, free: &[&'t Topic], named: &str) -> Result<&'t Topic> {
    let found = free.iter().find(|t| t.name == named).copied();
    found.ok_or_else(|| {
        RecordingError::topics(
            &recording.path,
            "--odometry-topic to name a topic of odometry that is neither this program's own nor the ground truth",
            format!("{named}, and of such topics {}", listed(free)),
            "name one of these",
        )
    })
}

/// The only candidate for wheel odometry. Warns about rivals and excluded topics.
fn only<'t>(free: &[&'t Topic], warnings: &mut Vec<String>) -> Option<&'t Topic> {
    let wheels: Vec<&Topic> = free
        .iter()
        .copied()
        .filter(|t| t.doubt().is_none())
        .collect();
    match (wheels.as_slice(), free) {
        ([one], _) => return Some(one),
        ([], []) => {}
        ([], [other, ..]) => warnings.push(format!(
            "topic {} is not used as odometry: \"{}\" in its name or base says that it is not of wheels; if it does not come from this camera it can be named with --odometry-topic, or left out with --no-odometry",
            other.name,
            other.doubt().unwrap_or_default()
        )),
        (rivals, _) => warnings.push(format!(
            "no odometry is used, as there are {} topics: {}; name that of the wheels with --odometry-topic, or none with --no-odometry",
            rivals.len(),
            listed(rivals)
        )),
    }
    None
}

fn unmounted(topic: &Topic, camera: &str) -> String {
    format!(
        "odometry of {} is not used: nothing says where the camera ({}) stands on {}; record /tf_static with a chain that does not move between them, or give a camera file with a table [odometry] by --camera",
        topic.name,
        if camera.is_empty() {
            "without a frame"
        } else {
            camera
        },
        base_name(topic)
    )
}

fn base_name(topic: &Topic) -> &str {
    match topic.base.as_str() {
        "" => "a base without a name",
        base => base,
    }
}

fn listed(topics: &[&Topic]) -> String {
    few(topics.iter().map(|t| t.name.clone()), "none")
}

#[derive(Debug)]
pub(crate) struct Stands {
    all: Stamped,
    next: usize,
}

impl Stands {
    /// From shortly before `first`, the stamp of the first frame, s.
    pub(crate) fn new(wheels: &Wheels, first: f64) -> Self {
        Self {
            next: wheels.stands.partition_point(|s| s.0 < first - BEFORE),
            all: Arc::clone(&wheels.stands),
        }
    }

    /// The samples not yet taken up to `stamp`, s, and one after it. Unreadable ones are skipped.
    pub(crate) fn take_until(
        &mut self,
        recording: &mut Recording,
        stamp: f64,
    ) -> Vec<OdometrySample> {
        let after = self.all.partition_point(|s| s.0 < stamp);
        let end = (after + 1).min(self.all.len());
        let due = self.all.get(self.next..end).unwrap_or_default();
        let taken = due.iter().filter_map(|(t, slot)| read(recording, slot, *t));
        let taken = taken.collect();
        self.next = self.next.max(end);
        taken
    }
}

fn read(recording: &mut Recording, slot: &Slot, stamp: f64) -> Option<OdometrySample> {
    let bytes = recording.read(slot).ok()?;
    let message: ros::Odometry<'_> = recording.parse(slot, &bytes).ok()?;
    odometry_sample(&message, stamp)
}

/// Converts an odometry message with a stamp, s; `None` for an invalid pose. Covariances that are empty or impossible count as unknown.
#[must_use]
pub fn odometry_sample(message: &ros::Odometry<'_>, stamp: f64) -> Option<OdometrySample> {
    let (p, q) = (&message.pose.pose.position, &message.pose.pose.orientation);
    let sample = OdometrySample {
        stamp,
        position: [p.x, p.y, p.z],
        orientation: [q.x, q.y, q.z, q.w],
        sigmas: sigmas(&message.pose.covariance.0),
    };
    sample.is_pose().then_some(sample)
}

/// Standard deviations of the position in the ground plane, m, and of the yaw, rad.
fn sigmas(covariance: &[f64; 36]) -> Option<[f64; 2]> {
    // The six variances are those of x, y, z and of the rotations about them.
    let [x, y, yaw] = [0, 7, 35].map(|i| covariance[i]);
    let place = if x < y { y } else { x };
    let is_stated = |v: f64, open: f64| (0.0..=open).contains(&v);
    let stated = is_stated(x, OPEN[0]) && is_stated(y, OPEN[0]) && is_stated(yaw, OPEN[1]);
    (stated && (place > 0.0 || yaw > 0.0)).then(|| [place.sqrt(), yaw.sqrt()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unset_covariances_are_ignored() {
        let of = |x: f64, y: f64, yaw: f64| {
            let mut all = [0.0; 36];
            (all[0], all[7], all[35]) = (x, y, yaw);
            sigmas(&all)
        };
        assert_eq!(of(0.0, 0.0, 0.0), None);
        assert_eq!(of(0.04, 0.01, 0.25), Some([0.2, 0.5]));
        assert_eq!(of(0.01, 0.04, 0.0), Some([0.2, 0.0]));
        for bad in [-1.0, 1e6, f64::NAN, f64::INFINITY] {
            assert_eq!(of(bad, 0.01, 0.01), None, "{bad}");
            assert_eq!(of(0.01, bad, 0.01), None, "{bad}");
            assert_eq!(of(0.01, 0.01, bad), None, "{bad}");
        }
    }

    #[test]
    fn names_exclude_odometry_not_from_wheels() {
        let topic = |name: &str, base: &str| Topic {
            channel: 0,
            name: name.into(),
            odom: "odom".into(),
            base: base.into(),
        };
        for (name, base) in [
            ("/odom", "base_link"),
            ("/robot/wheel_odometry", "base_footprint"),
            ("/odometry/filtered", "base_link"),
            ("/diff_drive_controller/odom", "robot/base"),
        ] {
            assert_eq!(topic(name, base).doubt(), None, "{name}");
        }
        for (name, base, word) in [
            ("/visual_odometry", "base_link", "visual"),
            ("/odom", "camera_link", "camera"),
            ("/rtabmap/odom", "base_link", "rtabmap"),
            ("/odom/GT", "base_link", "gt"),
        ] {
            assert_eq!(topic(name, base).doubt(), Some(word), "{name}");
        }
        assert!(topic("/stillpoint/odometry", "base_link").is_own());
        assert!(topic("/robot/stillpoint/odometry", "base_link").is_own());
        assert!(!topic("/stillpoint/wheel_odometry", "base_link").is_own());
    }
}

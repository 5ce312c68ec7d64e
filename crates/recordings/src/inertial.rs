//! The inertial sensor of a recording: its topics, mounting and samples.
//!
//! Samples are read on demand, so that a recording of hours starts at once.

use crate::error::{RecordingError, Result};
use crate::file::in_order;
use crate::names::{common_parts, few};
use crate::probe::{Probe, Stream};
use crate::realsense;
use crate::recording::Recording;
use crate::store::{Slot, seconds};
use crate::transforms::frame_name;
use std::sync::Arc;
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{ImuModel, Vec3};
use stillpoint_imaging::ImuSample;
use stillpoint_ros_messages as ros;

const TYPE: &str = "sensor_msgs/msg/Imu";
/// Samples are used from this long before the first frame, s.
const BEFORE: f64 = 0.1;

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wanted<'a> {
    pub(crate) topic: Option<&'a str>,
    pub(crate) model: Option<ImuModel>,
}

pub(crate) type Stamped = Arc<[(f64, Slot)]>;

#[derive(Clone, Debug)]
pub(crate) struct Sensor {
    pub(crate) model: ImuModel,
    rates: Stamped,
    /// Specific forces from a separate topic, and the rotation to the axes of the rates.
    forces: Option<(Stamped, UnitQuaternion<f64>)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Holds {
    Rates,
    Forces,
    Both,
}

#[derive(Clone, Debug)]
struct Topic {
    channel: u32,
    name: String,
    holds: Holds,
    frame: String,
}

/// Finds the sensor of the camera; `None` without one, or if its mounting is unknown, which gives a warning. `by_arrival`: frames are
/// stamped with the time of arrival.
///
/// # Errors
/// [`RecordingError::Topics`]: the given topic does not hold angular rates.
pub(crate) fn find(
    recording: &mut Recording,
    probe: &Probe,
    wanted: Wanted<'_>,
    colour: &Stream,
    by_arrival: bool,
    said: (&mut Vec<String>, &mut Vec<String>),
) -> Result<Option<Sensor>> {
    let (guesses, warnings) = said;
    let topics = topics(recording)?;
    let turning: Vec<&Topic> = topics.iter().filter(|t| t.holds != Holds::Forces).collect();
    let mount = |t: &Topic| {
        let by_transforms = || probe.transforms.find(&colour.frame, &t.frame);
        let usual = ImuModel::bmi055();
        wanted
            .model
            .or_else(|| by_transforms().map(|pose| usual.mounted(pose)))
    };
    let chosen = match wanted.topic {
        Some(named) => Some(named_one(recording, &turning, named)?),
        None => best(&turning, &|t| mount(t).is_some(), &colour.topic, warnings),
    };
    let Some(chosen) = chosen else {
        return Ok(None);
    };
    let Some(model) = mount(chosen) else {
        warnings.push(unmounted(chosen, &colour.frame));
        return Ok(None);
    };
    let partner = (chosen.holds == Holds::Rates)
        .then(|| partner(&topics, chosen))
        .flatten();
    let forces = partner.map(|p| {
        let turn = probe.transforms.find(&chosen.frame, &p.frame);
        let turn = turn.map_or_else(UnitQuaternion::identity, |pose| pose.rotation);
        (stamped(recording, p.channel, by_arrival), turn)
    });
    let sensor = Sensor {
        model,
        rates: stamped(recording, chosen.channel, by_arrival),
        forces,
    };
    guesses.push(format!(
        "inertial sensor: {}{}, {} samples, mounted {}",
        chosen.name,
        partner.map_or(String::new(), |p| format!(" with {}", p.name)),
        sensor.rates.len(),
        if wanted.model.is_some() {
            "as the camera file says"
        } else {
            "as the transforms say"
        }
    ));
    Ok(Some(sensor))
}

fn topics(recording: &mut Recording) -> Result<Vec<Topic>> {
    let mut found = Vec::new();
    for channel in recording.channels_of(TYPE) {
        let Some(slot) = recording.slots_of(channel).next().copied() else {
            continue;
        };
        let bytes = recording.read(&slot)?;
        let Ok(message) = recording.parse::<ros::Imu<'_>>(&slot, &bytes) else {
            continue;
        };
        let name = recording.topic(channel).to_owned();
        let own = realsense::imu_frame(&name);
        let frame = own.unwrap_or_else(|| frame_name(&message.header.frame_id));
        found.push(Topic {
            channel,
            holds: holds(&name, &message),
            frame: frame.to_owned(),
            name,
        });
    }
    Ok(found)
}

/// Drivers with separate topics name them accordingly; a covariance that begins with -1 marks a missing value (`sensor_msgs/Imu`).
fn holds(topic: &str, message: &ros::Imu<'_>) -> Holds {
    let name = topic.to_lowercase();
    let no_rates = message.angular_velocity_covariance[0] == -1.0;
    let no_forces = message.linear_acceleration_covariance[0] == -1.0;
    if no_rates || (name.contains("accel") && !name.contains("gyro")) {
        Holds::Forces
    } else if no_forces || (name.contains("gyro") && !name.contains("accel")) {
        Holds::Rates
    } else {
        Holds::Both
    }
}

fn named_one<'t>(recording: &Recording, turning: &[&'t Topic], named: &str) -> Result<&'t Topic> {
    let found = turning.iter().find(|t| t.name == named).copied();
    found.ok_or_else(|| {
        RecordingError::topics(
            &recording.path,
            "--imu-topic to name a topic of an inertial sensor's angular rates",
            format!("{named}, and of such topics {}", listed(turning)),
            "name one of these",
        )
    })
}

/// The topic whose name has most in common with the camera's, preferably with both kinds of values. Warns about topics without a known
/// mounting, and about rivals.
fn best<'t>(
    turning: &[&'t Topic],
    is_mounted: &dyn Fn(&Topic) -> bool,
    colour: &str,
    warnings: &mut Vec<String>,
) -> Option<&'t Topic> {
    let mounted: Vec<&Topic> = turning.iter().copied().filter(|t| is_mounted(t)).collect();
    if mounted.is_empty() {
        if let Some(first) = turning.first() {
            warnings.push(unmounted(first, "the camera"));
        }
        return None;
    }
    let rank = |t: &Topic| (common_parts(colour, &t.name), t.holds == Holds::Both);
    let top = mounted.iter().map(|t| rank(t)).max()?;
    let firsts: Vec<&Topic> = mounted.into_iter().filter(|t| rank(t) == top).collect();
    if firsts.len() > 1 {
        warnings.push(format!(
            "no inertial sensor is used, as there are {}: {}; name one with --imu-topic",
            firsts.len(),
            listed(&firsts)
        ));
        return None;
    }
    firsts.first().copied()
}

fn unmounted(topic: &Topic, camera: &str) -> String {
    format!(
        "topic {} is not used: nothing says how the inertial sensor ({}) stands to {camera}; record /tf_static, or give a camera file with a table [imu] by --camera",
        topic.name,
        if topic.frame.is_empty() {
            "without a frame"
        } else {
            &topic.frame
        }
    )
}

fn listed(topics: &[&Topic]) -> String {
    few(topics.iter().map(|t| t.name.clone()), "none")
}

/// The topic of forces that belongs to one of rates.
fn partner<'t>(topics: &'t [Topic], rates: &Topic) -> Option<&'t Topic> {
    let forces = topics.iter().filter(|t| t.holds == Holds::Forces);
    // Of equals the first in the file.
    forces
        .rev()
        .max_by_key(|t| common_parts(&t.name, &rates.name))
}

/// The messages of a topic by stamp; with `by_arrival` by the time of arrival.
pub(crate) fn stamped(recording: &Recording, channel: u32, by_arrival: bool) -> Stamped {
    let time = |s: &Slot| {
        let own = s.stamp.filter(|ns| *ns != 0 && !by_arrival);
        (seconds(own.unwrap_or(s.logged)), *s)
    };
    let mut all: Vec<(f64, Slot)> = recording.slots_of(channel).map(time).collect();
    if !recording.set_back.is_empty() {
        let (stamps, slots): (Vec<f64>, Vec<Slot>) = all.into_iter().unzip();
        let mended = in_order(&stamps, &slots, &recording.set_back).stamps;
        return mended.into_iter().map(|(t, i)| (t, slots[i])).collect();
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.dedup_by(|a, b| a.0 == b.0);
    all.into()
}

/// Reads the samples of a sensor in time order.
#[derive(Debug)]
pub(crate) struct Samples {
    sensor: Sensor,
    next: usize,
    /// The forces that were read last, with their indices.
    read: [Option<(usize, Vec3)>; 2],
}

impl Samples {
    /// From shortly before `first`, the stamp of the first frame, s.
    pub(crate) fn new(sensor: Sensor, first: f64) -> Self {
        let next = sensor.rates.partition_point(|s| s.0 < first - BEFORE);
        Self {
            sensor,
            next,
            read: [None; 2],
        }
    }

    /// The samples not yet taken up to `stamp`, s, and one after it. Unreadable ones are skipped.
    pub(crate) fn take_until(&mut self, recording: &mut Recording, stamp: f64) -> Vec<ImuSample> {
        let rates = Arc::clone(&self.sensor.rates);
        let after = rates.partition_point(|s| s.0 < stamp);
        let end = (after + 1).min(rates.len());
        let mut taken = Vec::new();
        for (stamp, slot) in rates.get(self.next..end).unwrap_or_default() {
            let Some((rate, own_force)) = values(recording, slot) else {
                continue;
            };
            let force = if self.sensor.forces.is_some() {
                self.force_at(recording, *stamp)
            } else {
                own_force
            };
            taken.push(ImuSample {
                stamp: *stamp,
                angular_rate: rate.into(),
                specific_force: force.into(),
            });
        }
        self.next = self.next.max(end);
        taken
    }

    /// The specific force interpolated at a time; the nearest one at the ends. Zero if none is readable.
    fn force_at(&mut self, recording: &mut Recording, stamp: f64) -> Vec3 {
        let forces = self.sensor.forces.clone();
        let Some((list, turn)) = forces.filter(|(list, _)| !list.is_empty()) else {
            return Vec3::zeros();
        };
        let after = list.partition_point(|s| s.0 < stamp);
        let (low, high) = (after.saturating_sub(1), after.min(list.len() - 1));
        let forces = [low, high].map(|i| self.force(recording, &list, i));
        let force = match forces {
            [Some(a), Some(b)] if low < high => {
                let part = (stamp - list[low].0) / (list[high].0 - list[low].0);
                a + (b - a) * part.clamp(0.0, 1.0)
            }
            [a, b] => a.or(b).unwrap_or_default(),
        };
        turn * force
    }

    fn force(&mut self, recording: &mut Recording, list: &Stamped, index: usize) -> Option<Vec3> {
        let known = self.read.iter().flatten().find(|r| r.0 == index);
        if let Some((_, force)) = known {
            return Some(*force);
        }
        let (_, force) = values(recording, &list.get(index)?.1)?;
        self.read = [self.read[1], Some((index, force))];
        Some(force)
    }
}

fn values(recording: &mut Recording, slot: &Slot) -> Option<(Vec3, Vec3)> {
    let bytes = recording.read(slot).ok()?;
    let message: ros::Imu<'_> = recording.parse(slot, &bytes).ok()?;
    let vector = |v: &ros::Vector3| Vec3::new(v.x, v.y, v.z);
    let rate = vector(&message.angular_velocity);
    let force = vector(&message.linear_acceleration);
    rate.iter()
        .chain(force.iter())
        .all(|v| v.is_finite())
        .then_some((rate, force))
}

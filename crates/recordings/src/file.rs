//! A recording opened as an RGB-D camera: frames, camera, and guesses.

use crate::budget::one_line;
use crate::choose::{Named, Pair, choose};
use crate::error::{RecordingError, Result};
use crate::inertial::{self, Sensor};
use crate::input::OpenOptions;
use crate::odometry::{self, Wheels};
use crate::probe::{Probe, Stream};
use crate::realsense;
use crate::recording::{Files, Recording};
use crate::setup::{Setup, Treatment};
use crate::source::{RecordingSource, doubt};
use crate::store::{Slot, seconds};
use crate::truth;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint_datasets::{
    CameraModel, FrameOptions, Mended, SetBack, StampedPose, associate, mend,
};

/// A frame: a colour image and its depth image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) stamp: f64,
    pub(crate) depth_stamp: f64,
    pub(crate) colour: Slot,
    pub(crate) depth: Slot,
}

impl Entry {
    /// Whether its stamp is the time of arrival, because the driver sets none.
    fn is_by_arrival(&self) -> bool {
        self.stamp == seconds(self.colour.logged)
            && self
                .colour
                .stamp
                .is_none_or(|own| own != self.colour.logged)
    }
}

struct Beside<'a> {
    options: &'a OpenOptions,
    probe: &'a Probe,
    colour: &'a Stream,
    /// Frames are stamped with the time of arrival.
    by_arrival: bool,
}

impl Beside<'_> {
    /// Finds the sensors, and stores their mounting in the camera.
    fn find(
        &self,
        recording: &mut Recording,
        mut treatment: Treatment,
        said: (&mut Vec<String>, &mut Vec<String>),
    ) -> Result<(Treatment, Option<Sensor>, Option<Wheels>)> {
        let (guesses, warnings) = said;
        let Self {
            options,
            probe,
            colour,
            by_arrival,
        } = *self;
        let mut inertial = None;
        if !options.no_imu {
            let wanted = inertial::Wanted {
                topic: options.imu_topic.as_deref(),
                model: treatment.camera.imu,
            };
            let said = (&mut *guesses, &mut *warnings);
            inertial = inertial::find(recording, probe, wanted, colour, by_arrival, said)?;
        }
        treatment.camera.imu = inertial.as_ref().map(|s| s.model);
        let mut wheels = None;
        if !options.no_odometry {
            let wanted = odometry::Wanted {
                topic: options.odometry_topic.as_deref(),
                truth: options.truth_topic.as_deref(),
                model: treatment.camera.odometry,
            };
            let said = (&mut *guesses, &mut *warnings);
            wheels = odometry::find(recording, probe, wanted, colour, by_arrival, said)?;
        }
        treatment.camera.odometry = wheels.as_ref().map(|w| w.model);
        Ok((treatment, inertial, wheels))
    }
}

/// An opened recording.
#[derive(Debug)]
pub struct FileRecording {
    pub(crate) path: PathBuf,
    pub(crate) entries: Arc<[Entry]>,
    pub(crate) treatment: Arc<Treatment>,
    pub(crate) strict: bool,
    pub(crate) files: Files,
    pub(crate) inertial: Option<Sensor>,
    pub(crate) wheels: Option<Wheels>,
    truth: Option<truth::Said>,
    set_back: Vec<SetBack>,
    guesses: Vec<String>,
    warnings: Vec<String>,
}

impl FileRecording {
    pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        let files = Files::scan(path)?;
        let mut recording = files.open()?;
        let mut warnings = recording.contents.remarks.lines();
        let probe = Probe::new(&mut recording)?;
        if probe.transforms.beyond() > 0 {
            warnings.push(format!(
                "{} transforms are left out: they name more frames than robots have, or frames with very long names",
                probe.transforms.beyond()
            ));
        }
        let named = Named {
            colour: options.colour_topic.as_deref(),
            depth: options.depth_topic.as_deref(),
        };
        let pair = choose(path, &probe, named)?;
        let mut guesses = vec![format!(
            "{}: colour {} and depth {}{}",
            files.format,
            pair.colour.topic,
            pair.depth.topic,
            if pair.reasons.is_empty() {
                String::new()
            } else {
                format!(" ({})", pair.reasons)
            }
        )];
        let (entries, counted) = index(&mut recording, &pair, options.max_dt, &mut warnings)?;
        guesses.push(counted);
        let mut setup = Setup {
            path,
            options,
            probe: &probe,
            pair: &pair,
            guesses: &mut guesses,
            warnings: &mut warnings,
        };
        let treatment = setup.treatment(&mut recording, &entries)?;
        let encoding = &pair.depth.encoding;
        warnings.extend(doubt(&mut recording, &entries, treatment.unit, encoding));
        let beside = Beside {
            options,
            probe: &probe,
            colour: &pair.colour,
            by_arrival: entries.iter().all(Entry::is_by_arrival),
        };
        let said = (&mut guesses, &mut warnings);
        let (treatment, inertial, wheels) = beside.find(&mut recording, treatment, said)?;
        let truth = match &options.truth_topic {
            Some(topic) => Some(truth::read(
                &mut recording,
                &probe,
                topic,
                &pair.colour.frame,
                &mut guesses,
            )?),
            None => None,
        };
        Ok(Self {
            path: path.to_owned(),
            entries: entries.into(),
            treatment: Arc::new(treatment),
            strict: options.strict,
            files,
            inertial,
            wheels,
            truth,
            set_back: recording.set_back,
            guesses: guesses.iter().map(|line| one_line(line)).collect(),
            warnings: warnings.iter().map(|line| one_line(line)).collect(),
        })
    }

    /// The file format.
    #[must_use]
    pub fn format(&self) -> &str {
        self.files.format
    }

    /// The camera, with the size of the images.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        &self.treatment.camera
    }

    /// Colour and depth stamps of each frame, s.
    pub fn stamps(&self) -> impl ExactSizeIterator<Item = (f64, f64)> + '_ {
        self.entries.iter().map(|e| (e.stamp, e.depth_stamp))
    }

    /// Guesses with their reasons, one sentence each.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        &self.guesses
    }

    /// Suspicious but usable properties, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Where the clock that stamped the images was set back.
    #[must_use]
    pub fn set_back(&self) -> &[SetBack] {
        &self.set_back
    }

    /// Poses of the ground truth topic, if one was given.
    #[must_use]
    pub fn ground_truth(&self) -> Option<Vec<StampedPose>> {
        self.ground_truth_said().map(|(poses, _)| poses)
    }

    /// Like [`Self::ground_truth`], with remarks about the stamps, one sentence each.
    #[must_use]
    pub fn ground_truth_said(&self) -> Option<(Vec<StampedPose>, Vec<String>)> {
        self.truth.clone()
    }

    /// A source of the decoded frames. It reopens the files, so that sources are independent.
    ///
    /// # Errors
    /// A start after the last frame, a missing file.
    pub fn frames(&self, options: &FrameOptions) -> Result<RecordingSource> {
        RecordingSource::new(self, options)
    }
}

/// Messages of a stream by stamp, s, ascending and unique.
fn stamped(
    recording: &mut Recording,
    stream: &Stream,
    warnings: &mut Vec<String>,
) -> Result<Vec<(f64, Slot)>> {
    let device = realsense::device_stamps(recording, &stream.topic)?;
    let all: Vec<&Slot> = recording.slots_of(stream.channel).collect();
    // Some drivers leave zero in every stamp; a single zero is a clock that starts at zero.
    let zeros = all.iter().filter(|s| s.stamp == Some(0)).count();
    let from_zero = zeros == 1 && all.len() > 1;
    let stamp = |s: &Slot| {
        let own = s.stamp.filter(|ns| *ns != 0 || from_zero);
        device.get(&s.logged).copied().or(own)
    };
    // If any stamp is missing, the time of arrival is used for all.
    let unstamped = all.iter().filter(|s| stamp(s).is_none()).count();
    if unstamped > 0 {
        warnings.push(format!(
            "topic {}: {unstamped} of {} images have no stamp; the times at which they were recorded are used",
            stream.topic,
            all.len()
        ));
    }
    let time = |s: &Slot| {
        if unstamped > 0 {
            s.logged
        } else {
            stamp(s).unwrap_or(s.logged)
        }
    };
    let slots: Vec<Slot> = all.iter().map(|s| **s).collect();
    let stamps: Vec<f64> = all.into_iter().map(|s| seconds(time(s))).collect();
    let mended = in_order(&stamps, &slots, &recording.set_back);
    for at in &mended.set_back {
        let place = format!("topic {}, message {}", stream.topic, at.index + 1);
        warnings.push(Mended::remark(at, &place));
    }
    if mended.repeats > 0 {
        warnings.push(format!(
            "topic {}: {} images repeat a stamp and are left out",
            stream.topic, mended.repeats
        ));
    }
    // Other streams stamped by the same clock use the same corrections.
    if recording.set_back.is_empty() {
        recording.set_back = mended.set_back;
    }
    let stamps = mended.stamps.into_iter();
    Ok(stamps.map(|(t, i)| (t, slots[i])).collect())
}

/// Corrects the stamps (s) of messages in file order to be ascending; `like` are the places where another stream found the clock set back.
pub(crate) fn in_order(stamps: &[f64], slots: &[Slot], like: &[SetBack]) -> Mended {
    let step = |i: usize| Some(seconds(slots[i].logged.checked_sub(slots[i - 1].logged)?));
    mend(stamps, step, like)
}

/// Pairs of images written at equal times, as by [`crate::McapRecorder`]. `None` if any image has no partner, or stamps of a pair differ by
/// more than `max_dt`.
fn written_together(
    colour: &[(f64, Slot)],
    depth: &[(f64, Slot)],
    max_dt: f64,
) -> Option<Vec<(usize, usize)>> {
    let written: BTreeMap<i64, usize> = depth
        .iter()
        .enumerate()
        .map(|(j, (_, slot))| (slot.logged, j))
        .collect();
    if written.len() != depth.len() || colour.len() != depth.len() {
        return None;
    }
    let mut taken = vec![false; depth.len()];
    let mut pairs = Vec::with_capacity(colour.len());
    for (i, (stamp, slot)) in colour.iter().enumerate() {
        let j = *written.get(&slot.logged)?;
        let alone = !std::mem::replace(&mut taken[j], true);
        if !alone || (stamp - depth[j].0).abs() > max_dt {
            return None;
        }
        pairs.push((i, j));
    }
    Some(pairs)
}

/// The frames, and a summary of how many images they use.
fn index(
    recording: &mut Recording,
    pair: &Pair,
    max_dt: f64,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Entry>, String)> {
    let colour = stamped(recording, &pair.colour, warnings)?;
    let depth = stamped(recording, &pair.depth, warnings)?;
    let times = |list: &[(f64, Slot)]| list.iter().map(|(t, _)| *t).collect::<Vec<f64>>();
    let pairs = written_together(&colour, &depth, max_dt)
        .unwrap_or_else(|| associate(&times(&colour), &times(&depth), max_dt));
    let counted = format!(
        "frames: {} of {} colour images have one of {} depth images within {} ms",
        pairs.len(),
        colour.len(),
        depth.len(),
        max_dt * 1e3
    );
    if pairs.is_empty() {
        let range = |list: &[(f64, Slot)]| match (list.first(), list.last()) {
            (Some((a, _)), Some((b, _))) => format!("{a:.3} to {b:.3} s"),
            _ => "nowhere".to_owned(),
        };
        return Err(RecordingError::topics(
            &recording.path,
            &format!("colour and depth images within {max_dt} s of each other"),
            format!(
                "colour from {}, depth from {}",
                range(&colour),
                range(&depth)
            ),
            "check that both have the stamps of one clock, or name other topics with --color-topic and --depth-topic",
        ));
    }
    let entry = |(i, j): (usize, usize)| Entry {
        stamp: colour[i].0,
        depth_stamp: depth[j].0,
        colour: colour[i].1,
        depth: depth[j].1,
    };
    Ok((pairs.into_iter().map(entry).collect(), counted))
}

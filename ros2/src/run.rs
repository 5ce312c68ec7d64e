//! One run: from the first frame of a camera until a reset, another map, or the end of the node.

use crate::about::about;
use crate::camera::Ready;
use crate::fusing::Fusing;
use crate::maps;
use crate::options::Options;
use crate::outlet::{Decided, Outlet};
use crate::outputs::Outputs;
use crate::pictures::Pictures;
use crate::priority;
use crate::record::{Entry, Recorder, Recording};
use crate::timing::Timing;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::datasets::AtomicFile;
use stillpoint::detection::Detector;
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame, Simd};
use stillpoint::live::{Delivery, LiveOptions, LiveResult, LiveSystem, Stage, Subscribed, Watch};
use stillpoint::map::Map;
use stillpoint::ros_events::{FrameNames, Publisher};
use stillpoint::slam::{Config, MapUse, Stages};
use stillpoint::view::Style;

/// Maximum number of events queued for publishing: more than a minute at 30 Hz.
const EVENTS: usize = 4096;
/// Stored trajectory of a run without a log, frames: more than two minutes, enough for the node.
const FRAMES: usize = 4096;
/// Maximum number of frames with images queued for the surface.
const IMAGES: usize = 4;

/// An initial map.
pub struct Known {
    /// The map.
    pub map: Map,
    /// How it is used.
    pub map_use: MapUse,
    /// Its file, if it has one.
    pub path: Option<PathBuf>,
    /// Readout time of its camera with standard deviation, s.
    pub readout: Option<[f64; 2]>,
}

/// Components of a run.
pub struct Plan<'a> {
    /// Converter of images.
    pub ready: Ready,
    /// Parameters of the node.
    pub options: &'a Options,
    /// Configuration of the system.
    pub config: &'a Config,
    /// An initial map.
    pub known: Option<Known>,
    /// Publisher of the previous run, if `odom` continues.
    pub publisher: Option<Publisher>,
    /// Writers of topics.
    pub outputs: &'a Arc<Outputs>,
    /// Names of the topics of colour and depth images.
    pub topics: [&'a str; 2],
    /// Name of the inertial sensor's topic, if used.
    pub imu_topic: Option<&'a str>,
    /// Name of the odometry's topic, if used.
    pub odometry_topic: Option<&'a str>,
    /// Number of the run: files of later ones have it in their names.
    pub number: u32,
}

/// A run in progress.
pub struct Run {
    ready: Ready,
    live: LiveSystem,
    decided: Decided,
    outlet: Subscribed<Outlet>,
    timing: Timing,
    pictures: Option<Subscribed<Pictures>>,
    fusing: Option<Subscribed<Fusing>>,
    recording: Option<(Recording, Recorder)>,
    log: Option<PathBuf>,
    about: String,
    next: u32,
    keep_colour: bool,
}

/// Result of a finished run.
pub struct Ended {
    /// Publisher for the next run.
    pub publisher: Option<Publisher>,
    /// The map.
    pub map: Option<Map>,
    /// Numbers of received frames, and of those dropped.
    pub frames: [u64; 2],
    /// Number of frames with a pose.
    pub tracked: u64,
    /// Median and 95th percentile of the latency from the last packet of an image to its odometry, over the last minute, s.
    pub latency: Option<[f32; 2]>,
    /// Failures of threads, and files that could not be written.
    pub troubles: Vec<String>,
}

impl Run {
    /// Starts a run.
    ///
    /// # Errors
    /// Unusable camera, map of another one, unreadable model, file that cannot be written, no more threads.
    pub fn begin(plan: Plan<'_>) -> Result<Self, String> {
        let options = plan.options;
        let camera = plan.ready.incoming.camera().camera;
        let mut config = plan.config.clone();
        let ids = plan
            .known
            .as_ref()
            .map_or(0, |k| k.map.view().keyframe_bound());
        maps::start_with(&mut config, plan.known.as_ref().and_then(|k| k.readout));
        let about = about(&plan, &config)?;
        let detector = options.model.as_deref().map(load_detector).transpose()?;
        let looks = detector.is_some();
        let stages = stages(&config, camera, plan.known)?;
        let stages = match plan.ready.imu {
            Some(model) => stages.with_imu(model).map_err(|e| e.to_string())?,
            None => stages,
        };
        let stages = match plan.ready.wheels {
            Some(model) => stages.with_odometry(model).map_err(|e| e.to_string())?,
            None => stages,
        };
        let log = options.log.as_ref().map(|f| numbered(f, plan.number));
        let recording = options.record.as_ref().map(|f| numbered(f, plan.number));
        let recording = recording.as_deref().map(Recording::begin).transpose()?;
        let recorder = recording.as_ref().map(|(_, recorder)| recorder.clone());
        let system = LiveOptions {
            drop_late: options.drop_late,
            keep_log: log.is_some(),
            keep_frames: Some(FRAMES),
            hook: Some(Arc::new(priority::lower_once)),
            subscriber_hook: Some(Arc::new(|name| {
                // Published results should not be delayed.
                if name != "publish" {
                    priority::lower_once(Stage::Looping);
                }
            })),
            ..LiveOptions::default()
        };
        let threads = |e: std::io::Error| format!("expected threads for a run, found: {e}");
        let mut live = LiveSystem::start(stages, detector, system).map_err(threads)?;
        let decided = Decided::default();
        let fresh = Publisher::new(camera, FrameNames::default());
        let publisher = plan.publisher.unwrap_or_else(|| fresh.clone());
        let timing = Timing::default();
        let outlet = Outlet::new(publisher, &decided, plan.outputs, recorder.clone(), options)
            .timed(timing.clone());
        let outlet = live
            .subscribe("publish", Delivery::until_full(EVENTS), outlet)
            .map_err(threads)?;
        let pictures = options.pictures.then(|| {
            let style = Style {
                bare: true,
                weights: config.motion_weights.clone(),
                ..Style::default()
            };
            let recorder = recorder.clone().filter(|_| options.record_images);
            Pictures::new(fresh.clone(), &decided, plan.outputs, recorder, style)
        });
        let newest = Delivery::newest(1).with_images(1, 1);
        let pictures = pictures.map(|p| live.subscribe("pictures", newest, p));
        let fusing = options.dense.then(|| {
            let to = (&decided, plan.outputs);
            Fusing::new(fresh, to, recorder, options, (&camera, ids))
        });
        let all = Delivery::until_full(EVENTS).with_images(IMAGES, 1);
        let fusing = fusing.transpose()?.map(|f| live.subscribe("fuse", all, f));
        Ok(Self {
            keep_colour: looks || options.pictures || options.dense,
            ready: plan.ready,
            pictures: pictures.transpose().map_err(threads)?,
            fusing: fusing.transpose().map_err(threads)?,
            live,
            decided,
            outlet,
            timing,
            recording,
            log,
            about,
            next: 0,
        })
    }

    /// The camera's mount and names of frames, to be set once.
    #[must_use]
    pub fn decided(&self) -> &Decided {
        &self.decided
    }

    /// The converter of images, with the frame of the camera.
    #[must_use]
    pub fn ready(&self) -> &Ready {
        &self.ready
    }

    /// Records a received message, if there is a recording.
    pub fn record(&self, entry: impl FnOnce() -> Entry) {
        if let Some((_, recorder)) = &self.recording {
            recorder.write(entry());
        }
    }

    /// Whether there is a recording.
    #[must_use]
    pub fn is_recorded(&self) -> bool {
        self.recording.is_some()
    }

    /// The number of the next frame. It is consumed even if decoding fails, as in the recording.
    pub fn number(&mut self) -> FrameId {
        self.next += 1;
        FrameId(self.next - 1)
    }

    /// Whether frames need their colours.
    #[must_use]
    pub fn keep_colour(&self) -> bool {
        self.keep_colour
    }

    /// Adds IMU samples. Returns false if tracking has ended.
    pub fn tell_inertial(&mut self, samples: Vec<ImuSample>) -> bool {
        self.ready.imu.is_none() || self.live.tell_inertial(samples)
    }

    /// Adds wheel odometry. Returns false if tracking has ended.
    pub fn tell_odometry(&mut self, samples: Vec<OdometrySample>) -> bool {
        self.ready.wheels.is_none() || self.live.tell_odometry(samples)
    }

    /// Adds a frame. Returns false if tracking has ended.
    pub fn push(&mut self, frame: RgbdFrame) -> bool {
        self.live.push(frame)
    }

    /// Latency of frames.
    #[must_use]
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// State of the live run.
    #[must_use]
    pub fn watch(&self) -> Watch {
        self.live.watch()
    }

    /// Ends the run: publishes remaining results, writes the log and finishes the recording.
    pub fn end(self) -> Ended {
        let result = self.live.finish();
        let mut troubles = troubles(&result);
        let publisher = self.outlet.join().map(Outlet::finish).unwrap_or_else(|e| {
            troubles.push(format!("publishing failed: {e}"));
            None
        });
        if let Some(Err(e)) = self.pictures.map(Subscribed::join) {
            troubles.push(format!("drawing failed: {e}"));
        }
        match self.fusing.map(Subscribed::join) {
            Some(Ok(fusing)) => fusing.finish(),
            Some(Err(e)) => troubles.push(format!("fusing failed: {e}")),
            None => {}
        }
        if let Some((recording, recorder)) = self.recording {
            drop(recorder);
            troubles.extend(recording.finish().err());
        }
        if let Some(path) = &self.log {
            let mut log = result.log;
            log.about = self.about;
            troubles.extend(write(path, log.to_text().as_bytes()).err());
        }
        Ended {
            publisher,
            frames: [
                result.statistics.arrived,
                result.statistics.dropped.len() as u64,
            ],
            tracked: self.timing.frames(),
            latency: self.timing.latency(),
            map: result.map,
            troubles,
        }
    }
}

fn stages(config: &Config, camera: Camera, known: Option<Known>) -> Result<Stages, String> {
    let stages = Stages::new(config.clone(), camera, Simd::detect()).map_err(|e| e.to_string())?;
    let Some(known) = known else {
        return Ok(stages);
    };
    maps::check_fits(&known.map, &camera)?;
    stages
        .with_map(known.map, known.map_use)
        .map_err(|e| e.to_string())
}

fn troubles(result: &LiveResult) -> Vec<String> {
    use stillpoint::live::WorkerEnd;
    let ended = &result.ended;
    let ends = [
        ("tracking", Some(&ended.tracking)),
        ("detection", ended.detection.as_ref()),
        ("mapping", Some(&ended.mapping)),
        ("looping", Some(&ended.looping)),
    ];
    let told = ends.into_iter().filter_map(|(stage, end)| match end? {
        WorkerEnd::Finished => None,
        WorkerEnd::Panicked(reason) => Some(format!("{stage} panicked: {reason}")),
        WorkerEnd::GivenUp => Some(format!("{stage} did not answer and was given up")),
    });
    let missed = result.statistics.subscribers.iter();
    let missed = missed
        .filter(|(name, missed)| name == "publish" && missed.events > 0)
        .map(|(_, missed)| {
            format!(
                "{} events were not published: publishing is too slow",
                missed.events
            )
        });
    told.chain(missed).collect()
}

fn load_detector(file: &str) -> Result<Box<dyn Detector>, String> {
    use stillpoint::datasets::{read_regular, read_regular_text};
    use stillpoint::inference::{LARGEST, ModelCard, OnnxDetector, OnnxOptions, Runtime};
    let refuse = |e: &dyn std::fmt::Display| {
        format!(
            "model: {file}: expected a model of a detector in the ONNX format, found: {e}; name its file, or none"
        )
    };
    let bytes = read_regular(Path::new(file), LARGEST).map_err(|e| refuse(&e))?;
    let card = Path::new(file).with_extension("toml");
    let card = card.is_file().then_some(card);
    let card = card.map(|path| {
        let text = read_regular_text(&path, 1 << 22).map_err(|e| refuse(&e))?;
        ModelCard::parse(&path.display().to_string(), &text).map_err(|e| refuse(&e))
    });
    let card = card.transpose()?;
    let options = OnnxOptions::default();
    let detector = OnnxDetector::with_card(bytes, file, card.as_ref(), &Runtime::Rten, &options);
    Ok(Box::new(detector.map_err(|e| refuse(&e))?))
}

/// `run.mcap` of the first run, `run_2.mcap` of the second.
fn numbered(file: &str, number: u32) -> PathBuf {
    let path = Path::new(file);
    if number < 2 {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path
        .extension()
        .map(|e| format!(".{}", e.to_string_lossy()));
    path.with_file_name(format!("{stem}_{number}{}", ending.unwrap_or_default()))
}

/// Writes a file atomically.
///
/// # Errors
/// Failures of the system.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    use std::io::Write;
    let refuse = |e: std::io::Error| {
        format!(
            "{}: expected to write it, found: {e}; check the folder's permissions and the free space",
            path.display()
        )
    };
    let mut file = AtomicFile::create(path).map_err(refuse)?;
    file.write_all(bytes).map_err(refuse)?;
    file.commit().map_err(refuse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_later_runs_are_numbered() {
        assert_eq!(numbered("/a/run.mcap", 1), Path::new("/a/run.mcap"));
        assert_eq!(numbered("/a/run.mcap", 3), Path::new("/a/run_3.mcap"));
        assert_eq!(numbered("run", 2), Path::new("run_2"));
    }
}

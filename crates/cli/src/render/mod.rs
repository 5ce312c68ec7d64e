//! `render`: a run as an animation.

pub(crate) mod reel;
mod scene;
mod size;

pub(crate) use scene::{Named, Scene};
pub(crate) use size::{Format, write};

use crate::args::ConfigArgs;
use crate::args::render::RenderArgs;
use crate::config;
use crate::console;
use crate::failure::{Failure, Status};
use crate::input::{self, said};
use crate::interrupt::Interrupt;
use crate::output::{StreamedFile, is_result_file};
use crate::render::reel::Reel;
use crate::run::about::{About, Simulated};
use crate::run::drive::Driver;
use crate::run::known_map::KnownMap;
use crate::run::{paths, replay};
use crate::simulate::ground_truth;
use crate::sink::{KnownUp, Sinks};
use crate::sinks::dense::{Fusion, Wish};
use crate::timing::Timing;
use serde_json::Value;
use std::path::{Path, PathBuf};
use stillpoint::datasets::{FrameOptions, ReadAhead, StampedPose, read_regular, trajectory};
use stillpoint::geometry::{Camera, ImuModel, OdometryModel};
use stillpoint::recordings::Input;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{LogEntry, RunLog};

/// Maximum size of a summary, bytes: 64 MiB, so that a file of another kind is refused before it fills the memory.
const LARGEST: u64 = 1 << 26;
/// Label of the run's trajectory.
pub(crate) const OURS: &str = "Stillpoint";
/// Label of the demo's trajectory without the filter.
pub(crate) const OFF: &str = "filter off";

pub(crate) fn render(args: &RenderArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let format = Format::of(&args.out)?;
    let found = Found::at(&args.result)?;
    found.check_out(args)?;
    let file = StreamedFile::create(&args.out, "--out")?;
    let mut also = Vec::new();
    let beside = found.others.iter().map(|(name, file)| (*name, file));
    let asked = args.also.iter().map(|a| (a.name.as_str(), &a.file));
    for (name, path) in beside.chain(asked) {
        also.push(Named {
            name: name.to_owned(),
            poses: trajectory::read(path).map_err(Failure::input)?,
        });
    }
    let scene = found.repeat(args, timing)?;
    let shot = scene.shoot(&also)?;
    let said = write(&shot, format, args.max_mb, (file, &args.out))?;
    console::report(&format!("{said}\n"));
    Ok(Status::Ok)
}

struct Found {
    folder: PathBuf,
    log_path: PathBuf,
    log: RunLog,
    about: About,
    input: PathBuf,
    others: Vec<(&'static str, PathBuf)>,
}

struct Footage {
    frames: ReadAhead,
    camera: Camera,
    imu: Option<ImuModel>,
    odometry: Option<OdometryModel>,
    truth: Option<Vec<StampedPose>>,
}

impl Found {
    fn at(folder: &Path) -> Result<Self, Failure> {
        if !folder.is_dir() {
            let what = if folder.exists() { "a file" } else { "nothing" };
            return Err(Failure::input(format!(
                "{}: expected the result folder of a run, found {what}; run, live and demo write such folders, below out/ unless --out names another",
                folder.display()
            )));
        }
        let mut others = Vec::new();
        let mut folder = folder.to_owned();
        // The demo's folder holds two results.
        if !folder.join("run.log").exists() && folder.join("on").join("run.log").exists() {
            others.push((OFF, folder.join("off").join("trajectory.txt")));
            folder = folder.join("on");
        }
        let log_path = folder.join("run.log");
        let (log, _) = replay::read(&log_path)?;
        let about = About::read(&log.about, &log_path)?;
        let summary = folder.join("summary.json");
        let bytes = read_regular(&summary, LARGEST).map_err(|e| {
            Failure::input(format!(
                "{}: expected the summary of a run, found: {e}; check the path",
                summary.display()
            ))
        })?;
        let json: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        let input = PathBuf::from(json["input"]["name"].as_str().unwrap_or_default());
        Ok(Self {
            folder,
            log_path,
            log,
            about,
            input,
            others,
        })
    }

    /// Refuses an output path that is an input or a file of the result.
    fn check_out(&self, args: &RenderArgs) -> Result<(), Failure> {
        let mut inputs: Vec<(&str, &Path)> = vec![("the log", &self.log_path)];
        inputs.extend(args.also.iter().map(|a| ("--also", &*a.file)));
        inputs.extend(self.others.iter().map(|(name, file)| (*name, &**file)));
        paths::check(&[("--out", args.out.as_path())], &inputs)?;
        let name = args
            .out
            .file_name()
            .and_then(|n| n.to_str())
            .unwrap_or_default();
        if paths::is_in(&args.out, &self.folder) && is_result_file(name) {
            return Err(Failure::input(format!(
                "{}: expected a path of its own for --out, found a file of the result; name another with --out",
                args.out.display()
            )));
        }
        Ok(())
    }

    /// Repeats the run, and keeps the data to draw.
    fn repeat(self, args: &RenderArgs, timing: &'static Timing) -> Result<Scene, Failure> {
        let about = &self.about;
        let mut config =
            config::resolve_over(&about.config, &self.log_path, &ConfigArgs::default())?;
        let footage = match &about.simulated {
            Some(simulated) => Footage::simulated(simulated, config.seed)?,
            None => Footage::recorded(
                args.input.as_deref().unwrap_or(&self.input),
                about,
                &args.out,
            )?,
        };
        let known = KnownMap::of(about.load_map.as_deref(), about.localize.as_deref());
        let known = known.map(|k| k.load(&mut config, &footage.camera, None));
        let known = known.transpose()?;
        let simd = config::simd()?;
        let wish = Wish {
            known: known.as_ref().and_then(|k| k.dense.clone()),
            weights: config.motion_weights.clone(),
            keyframes: known.as_ref().map_or(0, |k| k.map.view().keyframe_bound()),
            logged: about.dense.clone().filter(|d| d.voxel > 0.0),
            ..Wish::default()
        };
        let is_frame = |entry: &&LogEntry| matches!(entry, LogEntry::TrackFrame { .. });
        let frames = self.log.entries.iter().filter(is_frame).count();
        let fusion = Fusion::new(wish, &footage.camera, simd)?;
        let mut sinks = Sinks(vec![Box::new(fusion), Box::new(Reel::new(frames))]);
        let interrupt = Interrupt::prepare();
        let driver = Driver {
            config,
            camera: footage.camera,
            imu: footage.imu,
            odometry: footage.odometry,
            simd,
            timing,
            interrupt: &interrupt,
            detector: None,
            map: known.map(|k| (k.map, k.map_use)),
        };
        let mut frames = footage.frames;
        let detector = about.detector.clone().unwrap_or_default();
        let place = self.log_path.display().to_string();
        let session = driver
            .drive_replay(&mut frames, &mut sinks, self.log, detector)
            .map_err(|e| e.at(&place))?;
        match session.agrees {
            Some(true) => {}
            None => return Err(Failure::criteria("interrupted: no picture was written")),
            Some(false) => {
                return Err(Failure::criteria(format!(
                    "{place}: expected the trajectory of the run, found another; name the input of the run with --input"
                )));
            }
        }
        let mut found = sinks.finish(&session, KnownUp::default(), None)?;
        let reel = found.shelf.take().unwrap_or_else(|| Reel::new(0));
        let (fused, camera) = (found.shelf.get(), &footage.camera);
        Ok(Scene::of(reel, &session, fused, footage.truth, camera))
    }
}

impl Footage {
    fn simulated(simulated: &Simulated, seed: u64) -> Result<Self, Failure> {
        let simulator = Simulator::new(&SimulatorConfig {
            scene: simulated.scene.clone(),
            seed,
            frames: Some(simulated.frames),
            ..SimulatorConfig::default()
        });
        let simulator = simulator.map_err(Failure::input)?;
        Ok(Self {
            camera: *simulator.camera(),
            imu: None,
            odometry: None,
            truth: Some(ground_truth(&simulator)),
            frames: ReadAhead::new(simulator.source().with_colour()),
        })
    }

    fn recorded(path: &Path, about: &About, out: &Path) -> Result<Self, Failure> {
        if !path.exists() {
            return Err(Failure::input(format!(
                "{}: expected the input of the run, found nothing; name it with --input",
                path.display()
            )));
        }
        let wanted = replay::input_of(about, None);
        let dataset = input::open(path, &wanted)?;
        if matches!(dataset, Input::Device(_)) {
            return Err(Failure::input(
                "expected a recording, found a camera: record it, and run on what was recorded",
            ));
        }
        paths::check_outputs(&[], &[("--out", out)], path, &dataset)?;
        let truth = dataset.ground_truth_said()?.map(said);
        let frames = dataset.frames(&FrameOptions {
            start: wanted.start,
            max_frames: None,
            keep_colour: true,
        })?;
        Ok(Self {
            camera: dataset.camera().camera,
            imu: dataset.imu(),
            odometry: dataset.odometry(),
            truth,
            frames: ReadAhead::new(frames),
        })
    }
}

//! What `run` and `replay` have in common: an input that is opened, a result that is begun, and how both come to their end.

use crate::args::InputArgs;
use crate::args::run::OutputArgs;
use crate::config;
use crate::console;
use crate::dense::{Fusion, Logged, Wish};
use crate::failure::{Failure, Status};
use crate::input::{open, said};
use crate::interrupt::Interrupt;
use crate::output::ResultFolder;
use crate::page;
use crate::run::known_map::KnownMap;
use crate::run::recording::{RecordingFile, RunRecording, SharedRecorder};
use crate::run::result::{Setup, Voice, finish};
use crate::run::session::{Driver, Outputs, Session};
use crate::run::view::PageView;
use crate::run::{default_out, input, outputs, paths, played};
use crate::things::Gatherer;
use crate::timing::Timing;
use std::path::{Path, PathBuf};
use stillpoint::datasets::{FrameOptions, ReadAhead, StampedPose};
use stillpoint::detection::Detector;
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::map::Map;
use stillpoint::recordings::{Input, MessageFile, Source};
use stillpoint::slam::{Config, MapUse, Up};
use stillpoint::view::live::About;

/// What is asked for.
pub(crate) struct Task<'a> {
    /// Data set folder or recording.
    pub(crate) path: &'a Path,
    pub(crate) input: &'a InputArgs,
    pub(crate) output: &'a OutputArgs,
    pub(crate) config: Config,
    /// What is done to the data set, in the name of the result folder.
    pub(crate) done: &'static str,
    /// The file of `--log`.
    pub(crate) log: Option<&'a Path>,
    /// Files that are read, which nothing may take the place of, with what they are named by.
    pub(crate) inputs: Vec<(&'static str, &'a Path)>,
    /// A recording that has more than what the run finds.
    pub(crate) recorder: Option<SharedRecorder>,
    pub(crate) timing: &'static Timing,
}

/// The input of a task.
pub(crate) struct Opened<'a> {
    task: Task<'a>,
    simd: Simd,
    pub(crate) dataset: Input,
}

/// A task whose first frame can go by.
pub(crate) struct Begun<'a> {
    task: Task<'a>,
    simd: Simd,
    dataset: Input,
    truth: Option<Vec<StampedPose>>,
    out: PathBuf,
    folder: ResultFolder,
}

/// What a repetition has to know: which frames found their images in time.
#[derive(Default)]
pub(crate) struct Repeated {
    /// Of those that were fused.
    pub(crate) dense: Option<Logged>,
    /// Numbers of those in which things were looked for.
    pub(crate) things: Option<Vec<u32>>,
}

/// What a driver takes of it.
pub(crate) struct Means {
    pub(crate) frames: ReadAhead,
    pub(crate) outputs: Outputs,
    pub(crate) interrupt: Interrupt,
    pub(crate) map: Option<(Map, MapUse)>,
}

impl<'a> Task<'a> {
    /// Opens the data set or recording.
    pub(crate) fn open(self) -> Result<Opened<'a>, Failure> {
        let dataset = open(self.path, self.input)?;
        self.with(dataset)
    }

    /// With an input that is open.
    pub(crate) fn with(self, dataset: Input) -> Result<Opened<'a>, Failure> {
        let simd = config::simd()?;
        Ok(Opened {
            task: self,
            simd,
            dataset,
        })
    }
}

impl<'a> Opened<'a> {
    /// Reads the map to begin with, and begins everything that is to be written. `colour`: whether somebody looks at colours;
    /// `ahead`: frames that are read ahead; `adds_ids`: whether the frames become ids of a map that is loaded and saved again; `logged`: what a run
    /// fused that is repeated.
    pub(crate) fn begin(
        self,
        known: Option<KnownMap<'_>>,
        colour: bool,
        ahead: usize,
        adds_ids: bool,
        logged: Repeated,
    ) -> Result<(Begun<'a>, Means), Failure> {
        let Self {
            mut task,
            simd,
            dataset,
        } = self;
        let truth = dataset.ground_truth_said()?.map(said);
        let source = frames(&task, &dataset, colour)?;
        let remaining = source.remaining();
        let ids = adds_ids.then(|| remaining.unwrap_or(dataset.stamps().len()));
        let camera = dataset.camera().camera;
        let map = known.map(|k| k.load(&mut task.config, &camera, ids));
        let map = map.transpose()?;
        if let Some(k) = map.as_ref().filter(|_| adds_ids && !task.output.dense)
            && k.dense.is_some()
        {
            console::warn(
                "the surface in the map is not saved with it again: this run has no --dense",
            );
        }
        let wish = task.output.dense.then(|| Wish {
            voxel: task.output.voxel,
            known: map.as_ref().and_then(|k| k.dense.clone()),
            weights: task.config.motion_weights.clone(),
            keyframes: map.as_ref().map_or(0, |k| k.map.view().keyframe_bound()),
            logged: logged.dense,
        });
        let named_up = task.output.up.and_then(|up| Up::along(&up.into()));
        let known_up = map.as_ref().and_then(|k| k.up);
        let gatherer = task.output.things.then(|| {
            let up = named_up.or(known_up).map(|up| up.vector());
            Gatherer::new(&camera, up, map.as_ref(), &task.config, logged.things)
        });
        let known_things = map.as_ref().and_then(|k| k.things.clone());
        let out = task.output.out.clone();
        let out = out.unwrap_or_else(|| default_out(task.path, task.done));
        paths::check_run(task.output, &out, task.log, &task.inputs)?;
        paths::check_input(task.output, (&out, task.log), task.path, &dataset)?;
        let folder = ResultFolder::create(&out)?;
        let recorder = task.recorder.take();
        let mut outputs = outputs(task.output, &task.config, &dataset, remaining, task.timing)?;
        let fusion = wish.map(|wish| Fusion::new(wish, &camera, simd));
        outputs.dense = fusion.transpose()?;
        if let (Some(report), Some(known)) = (&mut outputs.report, &map) {
            report.0.begin_with(known.map.view().keyframe_bound());
        }
        outputs.things = gatherer;
        outputs.known_things = known_things;
        (outputs.named_up, outputs.known_up) = (named_up, known_up);
        outputs.record = recording(task.output, recorder, &camera, &task.config)?;
        outputs.view = shown(&task, &dataset, remaining)?;
        if let (Some(view), Some(dense)) = (&outputs.view, &mut outputs.dense) {
            dense.show_on(view.surface());
        }
        let means = Means {
            frames: ReadAhead::with_capacity(played::Reading::new(source, task.timing), ahead),
            outputs,
            interrupt: Interrupt::prepare(),
            map: map.map(|k| (k.map, k.map_use)),
        };
        let begun = Begun {
            task,
            simd,
            dataset,
            truth,
            out,
            folder,
        };
        Ok((begun, means))
    }
}

/// The frames that are asked for.
fn frames(task: &Task<'_>, dataset: &Input, colour: bool) -> Result<Source, Failure> {
    let draws = task.output.record.is_some() && !task.output.no_record_images;
    Ok(dataset.frames(&FrameOptions {
        start: task.input.start,
        max_frames: task.input.max_frames.map(|n| n as usize),
        keep_colour: colour
            || task.output.overlay.is_some()
            || !task.output.no_report
            || task.output.view.is_some()
            || task.output.dense
            || draws,
    })?)
}

/// What `--view` asks for. Says where it is to be seen.
fn shown(
    task: &Task<'_>,
    dataset: &Input,
    frames: Option<usize>,
) -> Result<Option<PageView>, Failure> {
    let Some(place) = &task.output.view else {
        return Ok(None);
    };
    let input = input(task.path, dataset);
    let about = About {
        name: page::data::name(&input.name),
        input: format!("{} - camera {}", input.layout, input.camera),
        command: page::typed(),
        config: config::to_text(&task.config)?,
        time_is: "latency".to_owned(),
        frames: frames.map(|n| n as u64),
    };
    PageView::start(place, about).map(Some)
}

/// What `--record` asks for.
fn recording(
    args: &OutputArgs,
    shared: Option<SharedRecorder>,
    camera: &Camera,
    config: &Config,
) -> Result<Option<RunRecording>, Failure> {
    let Some(path) = &args.record else {
        return Ok(None);
    };
    let file = match shared {
        Some(recorder) => RecordingFile::Shared(recorder),
        None => RecordingFile::Own(Box::new(
            MessageFile::replace(path).map_err(Failure::input)?,
        )),
    };
    let weights = (!args.no_record_images).then(|| config.motion_weights.clone());
    Ok(Some(RunRecording::new(path, file, *camera, weights)))
}

impl Begun<'_> {
    pub(crate) fn config(&self) -> &Config {
        &self.task.config
    }

    /// What lets the frames go by.
    pub(crate) fn driver<'i>(
        &self,
        interrupt: &'i Interrupt,
        detector: Option<Box<dyn Detector>>,
        map: Option<(Map, MapUse)>,
    ) -> Driver<'i> {
        Driver {
            config: self.task.config.clone(),
            camera: self.dataset.camera().camera,
            imu: self.dataset.imu(),
            odometry: self.dataset.odometry(),
            simd: self.simd,
            timing: self.task.timing,
            interrupt,
            detector,
            map,
        }
    }

    /// Writes the result and reports on it. `log` is the log of the run, as it stands in the result folder.
    pub(crate) fn end(
        self,
        session: &Session,
        mut outputs: Outputs,
        log: impl FnOnce() -> Result<Option<Vec<u8>>, Failure>,
    ) -> Result<Status, Failure> {
        let (gathered, view) = (outputs.report.take(), outputs.view.take());
        let written = outputs.finish()?;
        let setup = Setup {
            input: input(self.task.path, &self.dataset),
            config: &self.task.config,
            simd: self.simd,
            timing: self.task.timing,
            truth: self.truth.as_deref(),
            log: log()?,
            report: gathered.as_ref().map(|g| &g.0),
            view: view.as_ref(),
            command: page::typed(),
        };
        let voice = Voice::of(self.task.output);
        let status = finish(&setup, session, self.folder, &self.out, voice)?;
        voice.say(&written);
        if let Some(view) = view {
            view.end(&self.out);
        }
        Ok(status)
    }
}

/// How a run ended whose result is written: with the failure to save its map, if there was one.
pub(crate) fn last(session: Session, status: Status) -> Result<Status, Failure> {
    match session.saved {
        Some(Err(failure)) => Err(failure),
        _ => Ok(status),
    }
}

//! The common steps of `run` and `replay`: opening the input, starting the outputs, and finishing them.

use crate::args::InputArgs;
use crate::config;
use crate::failure::{Failure, Status};
use crate::input::{open, said};
use crate::interrupt::Interrupt;
use crate::output::ResultFolder;
use crate::page;
use crate::run::drive::Driver;
use crate::run::known_map::{Known, KnownMap};
use crate::run::result::{Voice, finish};
use crate::run::session::Session;
use crate::run::setup::Setup;
use crate::run::summary::Input as Described;
use crate::run::{paths, played};
use crate::sink::{Found, KnownUp, Repeated, Shelf, Sinks, Start};
use crate::sinks::OutputArgs;
use crate::sinks::record::SharedRecorder;
use crate::sinks::view::PageView;
use crate::timing::Timing;
use std::path::{Path, PathBuf};
use stillpoint::datasets::{FrameOptions, ReadAhead, StampedPose};
use stillpoint::detection::Detector;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::map::Map;
use stillpoint::recordings::{Input, Source};
use stillpoint::slam::{Config, MapUse};

pub(crate) struct Task<'a> {
    pub(crate) path: &'a Path,
    pub(crate) input: &'a InputArgs,
    pub(crate) output: &'a OutputArgs,
    pub(crate) config: Config,
    /// Suffix of the result folder's default name.
    pub(crate) done: &'static str,
    pub(crate) log: Option<&'a Path>,
    /// Files that are read and must not be replaced, with their names for messages.
    pub(crate) inputs: Vec<(&'static str, &'a Path)>,
    pub(crate) recorder: Option<SharedRecorder>,
    pub(crate) timing: &'static Timing,
}

pub(crate) struct Opened<'a> {
    task: Task<'a>,
    simd: Simd,
    pub(crate) dataset: Input,
}

pub(crate) struct Begun<'a> {
    task: Task<'a>,
    simd: Simd,
    dataset: Input,
    truth: Option<Vec<StampedPose>>,
    out: PathBuf,
    folder: ResultFolder,
    input: Described,
    config_text: String,
    up: KnownUp,
}

/// A task whose frames are processed and whose sinks have finished.
pub(crate) struct Over<'a>(Begun<'a>);

pub(crate) struct Means {
    pub(crate) frames: ReadAhead,
    pub(crate) sinks: Sinks,
    pub(crate) interrupt: Interrupt,
    pub(crate) map: Option<(Map, MapUse)>,
}

impl<'a> Task<'a> {
    pub(crate) fn open(self) -> Result<Opened<'a>, Failure> {
        let dataset = open(self.path, self.input)?;
        self.with(dataset)
    }

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
    /// Reads the initial map, and starts all outputs. `colour`: whether the detector needs colour; `ahead`: frames that are read ahead;
    /// `adds_ids`: whether the frames become ids of a map that is loaded and saved again; `logged`: frames that the replayed run fused.
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
        let out = task.output.folder.out.clone();
        let out = out.unwrap_or_else(|| default_out(task.path, task.done));
        task.check_paths(&out, &dataset)?;
        let folder = ResultFolder::create(&out)?;
        let up = KnownUp {
            named: task.output.up.named(),
            known: map.as_ref().and_then(|k| k.up),
        };
        let input = described(task.path, &dataset);
        let config_text = config::to_text(&task.config)?;
        let mut begun = Begun {
            task,
            simd,
            dataset,
            truth,
            out,
            folder,
            input,
            config_text,
            up,
        };
        let sinks = begun.begin_sinks(map.as_ref(), remaining, adds_ids, logged)?;
        let timing = begun.task.timing;
        let means = Means {
            frames: ReadAhead::with_capacity(played::Reading::new(source, timing), ahead),
            sinks,
            interrupt: Interrupt::prepare(),
            map: map.map(|k| (k.map, k.map_use)),
        };
        Ok((begun, means))
    }
}

impl Task<'_> {
    fn check_paths(&self, out: &Path, dataset: &Input) -> Result<(), Failure> {
        let mut files = self.output.files();
        files.extend(self.log.map(|path| ("--log", path)));
        paths::check_run(&files, out, &self.inputs)?;
        let mut folders = vec![("--out", out)];
        folders.extend(self.output.folders());
        paths::check_outputs(&folders, &files, self.path, dataset)
    }
}

fn described(path: &Path, dataset: &Input) -> Described {
    Described {
        name: path.display().to_string(),
        layout: dataset.kind(),
        camera: dataset.camera().name.clone(),
    }
}

/// `out/` with the name of the folder, or of the file without its extension, and `_` with `done` if that is not empty.
fn default_out(path: &Path, done: &str) -> PathBuf {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = path.file_name().or(full.file_name());
    let stem = name.and_then(|n| Path::new(n).file_stem());
    let name = if path.is_file() { stem } else { name };
    let mut name = name.unwrap_or("run".as_ref()).to_owned();
    name.push(done);
    Path::new("out").join(name)
}

fn frames(task: &Task<'_>, dataset: &Input, colour: bool) -> Result<Source, Failure> {
    Ok(dataset.frames(&FrameOptions {
        start: task.input.start,
        max_frames: task.input.max_frames.map(|n| n as usize),
        keep_colour: colour || task.output.wants_colour(),
    })?)
}

impl<'a> Begun<'a> {
    /// Starts all outputs besides the result; `frames` is the number of frames, if known.
    fn begin_sinks(
        &mut self,
        known: Option<&Known>,
        frames: Option<usize>,
        saves_map: bool,
        logged: Repeated,
    ) -> Result<Sinks, Failure> {
        let mut shelf = Shelf::default();
        if let Some(recorder) = self.task.recorder.take() {
            shelf.put(recorder);
        }
        self.task.output.begin(&mut Start {
            config: &self.task.config,
            config_text: &self.config_text,
            camera: self.dataset.camera().camera,
            simd: self.simd,
            timing: self.task.timing,
            name: page::data::name(&self.input.name),
            input: &self.input,
            command: page::typed(),
            stamps: &self.dataset.stamps(),
            frames,
            known,
            saves_map,
            up: self.up.named.or(self.up.known),
            logged,
            shelf,
        })
    }

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

    /// Finishes the sinks after the last frame. Returns their results.
    ///
    /// # Errors
    /// An output that cannot be completed.
    pub(crate) fn finish(
        mut self,
        session: &Session,
        sinks: Sinks,
    ) -> Result<(Over<'a>, Found), Failure> {
        let found = sinks.finish(session, self.up, Some(&mut self.folder))?;
        Ok((Over(self), found))
    }
}

impl Over<'_> {
    pub(crate) fn config(&self) -> &Config {
        &self.0.task.config
    }

    /// Writes and reports the result. `log` is the run log for the result folder.
    pub(crate) fn write(
        self,
        session: &Session,
        found: &Found,
        log: Option<Vec<u8>>,
    ) -> Result<Status, Failure> {
        let Self(begun) = self;
        let setup = Setup {
            input: begun.input,
            config_text: begun.config_text,
            simd: begun.simd,
            timing: begun.task.timing,
            truth: begun.truth.as_deref(),
            report: found.shelf.get(),
            command: page::typed(),
            log,
        };
        let voice = Voice::of(begun.task.output.json.json);
        let status = finish(&setup, (session, found), begun.folder, &begun.out, voice)?;
        voice.say(&found.said);
        if let Some(view) = found.shelf.get::<PageView>() {
            view.end(&begun.out);
        }
        Ok(status)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_output_folder_is_named_after_the_input() {
        assert_eq!(
            default_out(Path::new("data/desk/"), ""),
            Path::new("out/desk")
        );
        let here = std::env::current_dir().unwrap();
        let name = here.file_name().unwrap();
        assert_eq!(default_out(Path::new("."), ""), Path::new("out").join(name));
        // The default name drops the extension of a file, but not of a folder.
        let dir = tempfile::tempdir().unwrap();
        let [file, folder] = ["walk.mcap", "walk.bag"].map(|n| dir.path().join(n));
        std::fs::write(&file, "").unwrap();
        std::fs::create_dir(&folder).unwrap();
        assert_eq!(default_out(&file, "_live"), Path::new("out/walk_live"));
        assert_eq!(default_out(&folder, ""), Path::new("out/walk.bag"));
    }
}

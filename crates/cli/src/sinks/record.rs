//! `--record`: writes the results of a run as ROS 2 messages in an MCAP file.

use crate::dense::Fused;
use crate::failure::Failure;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use crate::sinks::overlay::{Style, picture};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use stillpoint::detection::MotionWeights;
use stillpoint::geometry::Camera;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::recordings::{self, McapRecorder, MessageFile, TopicInfo};
use stillpoint::ros_events::{FrameNames, Outgoing, Publisher, Topic};
use stillpoint::slam::Event;
use stillpoint::view::write_jpeg;

/// Spacing of the surface points, m: a cell of the coarse grid.
const SPACING: f64 = 0.05;
/// JPEG quality of the images, percent, at which marks stay sharp.
const QUALITY: u8 = 80;

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct RecordOutput {
    /// Record the results to this file, as ROS 2 messages with the axes of REP-103: transforms map -> odom -> camera_link, odometry, path,
    /// landmarks, objects, health, and frames with the static filter's verdicts. Foxglove, Rerun, PlotJuggler and ros2 bag play open it.
    /// live realsense writes the camera's frames into it too; run and replay read them.
    #[arg(long, value_name = "FILE.mcap", verbatim_doc_comment)]
    pub(crate) record: Option<PathBuf>,
    /// Write no images into the file of --record.
    #[arg(long, requires = "record")]
    pub(crate) no_record_images: bool,
}

impl Output for RecordOutput {
    /// Uses a recorder that the camera also writes to, if there is one.
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(path) = &self.record else {
            return Ok(None);
        };
        let file = match start.shelf.take() {
            Some(recorder) => RecordingFile::Shared(recorder),
            None => RecordingFile::Own(Box::new(
                MessageFile::replace(path).map_err(Failure::input)?,
            )),
        };
        let draws = !self.no_record_images;
        let weights = draws.then(|| start.config.motion_weights.clone());
        let recording = RunRecording::new(path, file, start.camera, weights);
        Ok(Some(Box::new(recording)))
    }

    fn files(&self) -> Vec<(&'static str, &Path)> {
        self.record.iter().map(|f| ("--record", &**f)).collect()
    }

    fn wants_colour(&self) -> bool {
        self.record.is_some() && !self.no_record_images
    }
}

#[derive(Clone, Debug)]
pub(crate) struct SharedRecorder(Arc<Mutex<Option<McapRecorder>>>);

impl SharedRecorder {
    pub(crate) fn new(recorder: McapRecorder) -> Self {
        Self(Arc::new(Mutex::new(Some(recorder))))
    }

    /// Lets `write` append; does nothing once it is finished.
    pub(crate) fn write(
        &self,
        write: impl FnOnce(&mut McapRecorder) -> recordings::Result<()>,
    ) -> recordings::Result<()> {
        let mut recorder = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        recorder.as_mut().map_or(Ok(()), write)
    }

    pub(crate) fn finish(&self) -> Result<(), Failure> {
        let mut recorder = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let finished = recorder.take().map_or(Ok(()), McapRecorder::finish);
        finished.map_err(Failure::input)
    }
}

enum RecordingFile {
    Own(Box<MessageFile>),
    /// A file shared with the camera, which its creator finishes.
    Shared(SharedRecorder),
}

impl RecordingFile {
    fn write(&mut self, messages: &[Outgoing]) -> Result<(), Failure> {
        let all = |file: &mut MessageFile| {
            messages
                .iter()
                .try_for_each(|m| file.write(info(m.topic), m.time, &m.bytes))
        };
        match self {
            Self::Own(file) => all(file),
            Self::Shared(recorder) => recorder.write(|r| all(r.file())),
        }
        .map_err(Failure::input)
    }
}

fn info(topic: Topic) -> TopicInfo<'static, impl FnOnce() -> String> {
    TopicInfo {
        name: topic.name(),
        type_name: topic.type_name(),
        definition: move || topic.definition(),
        is_latched: topic.is_latched(),
    }
}

struct RunRecording {
    path: PathBuf,
    file: RecordingFile,
    publisher: Publisher,
    /// Style of the images, if they are written.
    style: Option<Style>,
    messages: usize,
}

impl RunRecording {
    /// For a camera; writes images if class weights are given.
    fn new(
        path: &Path,
        file: RecordingFile,
        camera: Camera,
        weights: Option<MotionWeights>,
    ) -> Self {
        Self {
            path: path.to_owned(),
            file,
            publisher: Publisher::new(camera, FrameNames::default()),
            style: weights.map(|weights| Style {
                bare: true,
                weights,
                ..Style::default()
            }),
            messages: 0,
        }
    }

    /// Writes points of the surface and the floor plan.
    fn surface(&mut self, fused: &Fused) -> Result<(), Failure> {
        let mut messages = vec![self.publisher.surface(&fused.mesh.thinned(SPACING))];
        let plan = fused.plan();
        messages.extend(plan.map(|plan| {
            let grid = plan.in_axes_of(&self.publisher.map_from_world());
            self.publisher
                .grid(grid.width as u32, grid.resolution, &grid.origin, grid.cells)
        }));
        self.add(&messages)
    }

    fn add(&mut self, messages: &[Outgoing]) -> Result<(), Failure> {
        self.messages += messages.len();
        self.file.write(messages)
    }
}

impl Sink for RunRecording {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("record", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let _span = tracing::info_span!("record").entered();
        let messages = self.publisher.publish(event);
        self.add(&messages)?;
        if let (Some(style), Some(tracked)) = (&self.style, event.as_frame())
            && let Some(frame) = &tracked.frame
        {
            let _span = tracing::info_span!("record_image").entered();
            let drawn = picture(frame, &tracked.report, style);
            let mut jpeg = Vec::new();
            write_jpeg(&drawn, QUALITY, &mut jpeg).map_err(Failure::input)?;
            let messages = self.publisher.picture(jpeg);
            self.add(&messages)?;
        }
        Ok(())
    }

    /// Writes the surface, if there is one, and pending messages, and moves the file into place.
    fn finish(mut self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        if let Some(fused) = ended.found.shelf.get::<Fused>() {
            self.surface(fused)?;
        }
        let last = self.publisher.finish();
        self.add(&last)?;
        if let RecordingFile::Own(file) = self.file {
            file.finish().map_err(Failure::input)?;
        }
        let (messages, path) = (self.messages, self.path.display());
        ended.found.said += &format!("{messages} messages in {path}\n");
        Ok(())
    }
}

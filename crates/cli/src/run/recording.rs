//! `--record`: what a run finds, as messages of ROS 2 in an MCAP file.

use crate::dense::Fused;
use crate::failure::Failure;
use crate::run::overlay::{Style, picture};
use crate::run::session::listeners::Writer;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use stillpoint::detection::MotionWeights;
use stillpoint::geometry::Camera;
use stillpoint::recordings::{self, McapRecorder, MessageFile, TopicInfo};
use stillpoint::ros_events::{FrameNames, Outgoing, Publisher, Topic};
use stillpoint::slam::Event;
use stillpoint::view::write_jpeg;

/// Between points of the surface, m: a cell of the coarse grid.
const SPACING: f64 = 0.05;
/// Quality of the pictures, percent: marks stay sharp.
const QUALITY: u8 = 80;

/// A recorder that a camera and a run write to.
#[derive(Clone, Debug)]
pub(crate) struct SharedRecorder(Arc<Mutex<Option<McapRecorder>>>);

impl SharedRecorder {
    pub(crate) fn new(recorder: McapRecorder) -> Self {
        Self(Arc::new(Mutex::new(Some(recorder))))
    }

    /// Lets `write` append; nothing once it is finished.
    pub(crate) fn write(
        &self,
        write: impl FnOnce(&mut McapRecorder) -> recordings::Result<()>,
    ) -> recordings::Result<()> {
        let mut recorder = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        recorder.as_mut().map_or(Ok(()), write)
    }

    /// Gives the file its name.
    pub(crate) fn finish(&self) -> Result<(), Failure> {
        let mut recorder = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let finished = recorder.take().map_or(Ok(()), McapRecorder::finish);
        finished.map_err(Failure::input)
    }
}

/// Where messages go.
pub(crate) enum RecordingFile {
    /// A file of its own.
    Own(Box<MessageFile>),
    /// One that a camera writes to too, and that whoever opened it finishes.
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

/// Writes messages while frames go by.
pub(crate) struct RunRecording {
    path: PathBuf,
    file: RecordingFile,
    publisher: Publisher,
    /// How pictures are drawn, if they are.
    style: Option<Style>,
    messages: usize,
}

impl RunRecording {
    /// For a camera; with pictures where weights of classes are given.
    pub(crate) fn new(
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

    /// Writes what was fused: points of the surface and the floor plan.
    pub(crate) fn surface(&mut self, fused: &Fused) -> Result<(), Failure> {
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

    /// Writes what is left and gives the file its name. Returns what there is, for the report.
    pub(crate) fn finish(mut self) -> Result<String, Failure> {
        let last = self.publisher.finish();
        self.add(&last)?;
        if let RecordingFile::Own(file) = self.file {
            file.finish().map_err(Failure::input)?;
        }
        let (messages, path) = (self.messages, self.path.display());
        Ok(format!("{messages} messages in {path}\n"))
    }
}

impl Writer for RunRecording {
    fn write(&mut self, event: &Event) -> Result<(), Failure> {
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
}

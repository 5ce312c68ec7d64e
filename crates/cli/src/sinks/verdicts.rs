//! `--verdicts`: writes the static filter's verdict on every keypoint as a table.

use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, FrameReport};

/// The columns: colour stamp, s; raw pixel; `static` or `dynamic`; reasons joined by `+`.
const HEADER: &str = "timestamp,u,v,verdict,reasons";

const OPTION: &str = "--verdicts";

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct VerdictsOutput {
    /// Write the static filter's verdict on every keypoint: timestamp,u,v,verdict,reasons (raw pixels).
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) verdicts: Option<PathBuf>,
}

impl Output for VerdictsOutput {
    fn begin(&self, _: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(path) = &self.verdicts else {
            return Ok(None);
        };
        Ok(Some(Box::new(VerdictFile::create(path)?)))
    }

    fn files(&self) -> Vec<(&'static str, &Path)> {
        self.verdicts.iter().map(|f| (OPTION, &**f)).collect()
    }
}

#[derive(Debug)]
struct VerdictFile {
    file: StreamedFile,
    path: PathBuf,
    rows: usize,
}

impl Sink for VerdictFile {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_all("verdicts"))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(frame) = event.as_frame() else {
            return Ok(());
        };
        let _span = tracing::info_span!("verdicts").entered();
        self.add(&frame.report)
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let said = format!("{} verdicts in {}\n", self.rows, self.path.display());
        self.file.finish()?;
        ended.found.said += &said;
        Ok(())
    }
}

impl VerdictFile {
    fn create(path: &Path) -> Result<Self, Failure> {
        let mut file = StreamedFile::create(path, OPTION)?;
        file.write(|w| writeln!(w, "{HEADER}"))?;
        Ok(Self {
            file,
            path: path.to_owned(),
            rows: 0,
        })
    }

    /// One row per keypoint of a frame, tracked or lost.
    fn add(&mut self, report: &FrameReport) -> Result<(), Failure> {
        let stamp = report.stamp;
        self.rows += report.verdicts.len();
        self.file.write(|w| {
            report.verdicts.iter().try_for_each(|v| {
                let [x, y] = v.pixel;
                let verdict = if v.dynamic { "dynamic" } else { "static" };
                writeln!(w, "{stamp:.6},{x:.3},{y:.3},{verdict},{}", v.reasons)
            })
        })
    }
}

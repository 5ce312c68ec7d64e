//! `--verdicts`: what the static filter said of every keypoint, as a table.

use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::run::session::listeners::Writer;
use std::io::Write;
use std::path::{Path, PathBuf};
use stillpoint::slam::{Event, FrameReport};

/// The columns: colour stamp, s; raw pixel; `static` or `dynamic`; reasons joined by `+`.
const HEADER: &str = "timestamp,u,v,verdict,reasons";

/// The table in the making, written row by row as frames go by.
#[derive(Debug)]
pub(crate) struct VerdictFile {
    file: StreamedFile,
    path: PathBuf,
    rows: usize,
}

impl Writer for VerdictFile {
    fn write(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(frame) = event.as_frame() else {
            return Ok(());
        };
        let _span = tracing::info_span!("verdicts").entered();
        self.add(&frame.report)
    }
}

impl VerdictFile {
    pub(crate) fn create(path: &Path) -> Result<Self, Failure> {
        let mut file = StreamedFile::create(path, "--verdicts")?;
        file.write(|w| writeln!(w, "{HEADER}"))?;
        Ok(Self {
            file,
            path: path.to_owned(),
            rows: 0,
        })
    }

    /// One row per keypoint of a frame, whatever became of its pose.
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

    /// Puts the table where it belongs. Returns what there is, for the report.
    pub(crate) fn finish(self) -> Result<String, Failure> {
        self.file.finish()?;
        Ok(format!(
            "{} verdicts in {}\n",
            self.rows,
            self.path.display()
        ))
    }
}

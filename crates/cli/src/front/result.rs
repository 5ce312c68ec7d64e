//! The result folder of a run that another front end drives.

use super::Refused;
use crate::config;
use crate::dense::Fused;
use crate::output::{ResultFolder, is_result_file};
use crate::run::result::write;
use crate::run::setup::Setup;
use crate::run::summary::{DetectorJson, Input};
use crate::run::tally::{End, Tally};
use crate::sink::Found;
use crate::timing::Timing;
use std::path::Path;
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::{DenseCounts, DenseMap};
use stillpoint::detection::DetectorInfo;
use stillpoint::imaging::Simd;
use stillpoint::map::MapView;
use stillpoint::slam::{self, Config, Event, Subscriber, Trajectory};
use stillpoint::view::report::ReportRecorder;

/// The name of a frame's time in `summary.json`, as the command line has it.
const TOTAL: &str = "total";

/// Keeps what a result folder says of a run, while it goes on: a subscriber, as the command line has them.
#[derive(Default)]
pub struct ResultRecorder {
    tally: Tally,
    /// What the report shows.
    report: Option<ReportRecorder>,
    timing: Timing,
}

/// A run that is over: what it was, and what it gave.
pub struct Driven<'a> {
    /// What was run on, as a path or a name; its layout; where the camera comes from.
    pub input: [String; 3],
    /// How to run it again.
    pub command: String,
    /// What it was run with.
    pub config: &'a Config,
    /// The instruction set.
    pub simd: Simd,
    /// What the detector was.
    pub detector: &'a DetectorInfo,
    /// Poses of all frames.
    pub trajectory: &'a Trajectory,
    /// The final map.
    pub view: Arc<MapView>,
    /// When the parts of a frame are exposed, as estimated in the end.
    pub timing: slam::Timing,
    /// The surface, where one was fused, and what was done for it.
    pub surface: Option<(DenseMap, DenseCounts)>,
    /// The true poses, where they are known.
    pub truth: Option<&'a [StampedPose]>,
    /// Frames that could not be read.
    pub skipped: usize,
    /// From the first frame to the last, s.
    pub seconds: f64,
}

impl ResultRecorder {
    /// Before the first frame; `pictures` says whether a report is to be written. `keyframes` is how many ids the map had before.
    #[must_use]
    pub fn new(pictures: bool, keyframes: usize) -> Self {
        let report = pictures.then(|| {
            let mut report = ReportRecorder::new();
            report.begin_with(keyframes);
            report
        });
        Self {
            report,
            ..Self::default()
        }
    }

    /// Takes what the last frame took, ms.
    pub fn end_frame(&mut self, milliseconds: f64) {
        self.timing.take_frame(TOTAL, milliseconds);
    }

    /// Writes the result folder as the command line does, but for the log: as a whole or not at all. `option` is what named the folder.
    ///
    /// # Errors
    /// [`Refused`] for a folder that cannot be written.
    pub fn write(
        &self,
        folder: &Path,
        option: &'static str,
        run: Driven<'_>,
    ) -> Result<(), Refused> {
        let mut folder = ResultFolder::create_of(folder, option, is_result_file)?;
        let mut session = self.tally.clone().close(End {
            trajectory: run.trajectory.clone(),
            view: run.view,
            map: None,
            timing: run.timing,
            detector: DetectorJson::new(run.detector),
            interrupted: false,
            seconds: run.seconds,
            log: None,
            agrees: None,
            live: None,
        });
        session.tracking.skipped += run.skipped;
        let mut found = Found::default();
        if let Some((map, counts)) = run.surface {
            let fused = Fused::of(map, &counts);
            fused.write(&mut folder)?;
            found.shelf.put(fused);
        }
        let [name, layout, camera] = run.input;
        let setup = Setup {
            input: Input {
                name,
                layout,
                camera,
            },
            config_text: config::to_text(run.config)?,
            simd: run.simd,
            timing: &self.timing,
            truth: run.truth,
            report: self.report.as_ref(),
            command: run.command,
            log: None,
        };
        write(&setup, &session, &found, folder)?;
        Ok(())
    }
}

impl Subscriber for ResultRecorder {
    fn receive(&mut self, event: &Event) {
        self.tally.receive(event);
        if let Some(report) = &mut self.report {
            report.receive(event);
        }
    }
}

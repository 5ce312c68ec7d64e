//! The result folder of a run driven by another front end.

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

/// Name of the time per frame in `summary.json`, as in the command line.
const TOTAL: &str = "total";

/// Subscriber that collects the contents of a result folder during a run.
#[derive(Default)]
pub struct ResultRecorder {
    tally: Tally,
    report: Option<ReportRecorder>,
    timing: Timing,
}

/// A finished run.
pub struct Driven<'a> {
    /// Input path or name; its layout; source of the camera model.
    pub input: [String; 3],
    /// The command that repeats the run.
    pub command: String,
    /// Its settings.
    pub config: &'a Config,
    /// The instruction set.
    pub simd: Simd,
    /// The detector.
    pub detector: &'a DetectorInfo,
    /// Poses of all frames.
    pub trajectory: &'a Trajectory,
    /// The final map.
    pub view: Arc<MapView>,
    /// The final estimate of the camera's timing.
    pub timing: slam::Timing,
    /// The dense map and its counters, if one was fused.
    pub surface: Option<(DenseMap, DenseCounts)>,
    /// The true poses, if known.
    pub truth: Option<&'a [StampedPose]>,
    /// Number of frames that could not be read.
    pub skipped: usize,
    /// From the first frame to the last, s.
    pub seconds: f64,
}

impl ResultRecorder {
    /// Creates it before the first frame; `pictures` enables the HTML report. `keyframes` is the number of keyframe ids already in the map.
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

    /// Sets the processing time of the last frame, ms.
    pub fn end_frame(&mut self, milliseconds: f64) {
        self.timing.take_frame(TOTAL, milliseconds);
    }

    /// Writes the result folder atomically, as the command line does but without a run log. `option` named the folder, for messages.
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

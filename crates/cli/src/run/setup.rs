//! What a result is about.

use crate::run::summary::Input;
use crate::timing::Timing;
use stillpoint::datasets::StampedPose;
use stillpoint::imaging::Simd;
use stillpoint::view::report::ReportRecorder;

/// What a result is about.
pub(crate) struct Setup<'a> {
    pub(crate) input: Input,
    /// The configuration, as it stands in the folder.
    pub(crate) config_text: String,
    pub(crate) simd: Simd,
    pub(crate) timing: &'a Timing,
    pub(crate) truth: Option<&'a [StampedPose]>,
    /// What the report shows of the frames; none where none is to be written.
    pub(crate) report: Option<&'a ReportRecorder>,
    /// How the run was begun.
    pub(crate) command: String,
    /// The log of the run, as it stands in the folder.
    pub(crate) log: Option<Vec<u8>>,
}

//! Metadata of a result.

use crate::run::summary::Input;
use crate::timing::Timing;
use stillpoint::datasets::StampedPose;
use stillpoint::imaging::Simd;
use stillpoint::view::report::ReportRecorder;

pub(crate) struct Setup<'a> {
    pub(crate) input: Input,
    pub(crate) config_text: String,
    pub(crate) simd: Simd,
    pub(crate) timing: &'a Timing,
    pub(crate) truth: Option<&'a [StampedPose]>,
    /// Data of the frames for the HTML report; `None` if there is no report.
    pub(crate) report: Option<&'a ReportRecorder>,
    pub(crate) command: String,
    pub(crate) log: Option<Vec<u8>>,
}

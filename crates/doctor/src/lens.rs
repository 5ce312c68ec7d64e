//! Checks the camera's intrinsics and lens model.

use crate::finding::{Finding, Report, Symptom};
use stillpoint_geometry::Camera;

/// Reports invalid intrinsics, and a lens model that folds within the image.
pub(crate) fn judge(camera: &Camera, report: &mut Report) -> bool {
    let Err(error) = camera.check() else {
        return true;
    };
    report.find(Finding {
        symptom: Symptom::Lens,
        message: format!("the camera cannot be computed with: {error}"),
        remedy: "check order and number of the distortion coefficients (k1, k2, p1, p2, k3) and that they belong to images of this size; or calibrate anew and give --camera camera.toml".into(),
        evidence: Vec::new(),
    });
    false
}

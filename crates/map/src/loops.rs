//! Loop measurements: relative poses of keyframes from place recognition.

use crate::KeyframeId;
use stillpoint_geometry::{Mat6, Se3};

/// A relative pose of two keyframes, measured when a place was recognised. It stays fixed when the poses of the
/// keyframes change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopEdge {
    /// The older keyframe. It may have been culled since.
    pub old: KeyframeId,
    /// The keyframe in which the place was recognised. It may have been culled since.
    pub new: KeyframeId,
    /// Maps camera coordinates of the new keyframe to those of the older one, m.
    pub old_from_new: Se3,
    /// The inverse of its covariance, for a perturbation `[translation; rotation]` in the new keyframe's coordinates: m, rad.
    pub information: Mat6,
    /// Landmarks around the older keyframe that support this motion in the new one.
    pub inliers: u32,
}

impl LoopEdge {
    /// The upper triangle of the information matrix, row by row.
    pub(crate) fn triangle(&self) -> [f64; 21] {
        let mut rows = (0..6).flat_map(|r| (r..6).map(move |c| (r, c)));
        std::array::from_fn(|_| rows.next().map_or(0.0, |at| self.information[at]))
    }

    /// The symmetric matrix of an upper triangle, row by row.
    pub(crate) fn symmetric(triangle: &[f64; 21]) -> Mat6 {
        let mut matrix = Mat6::zeros();
        let rows = (0..6).flat_map(|r| (r..6).map(move |c| (r, c)));
        for ((r, c), value) in rows.zip(triangle) {
            matrix[(r, c)] = *value;
            matrix[(c, r)] = *value;
        }
        matrix
    }

    /// Whether the keyframes differ and pose and information are valid.
    pub(crate) fn is_sound(&self) -> bool {
        let information = &self.information;
        let positive = (0..6).all(|i| information[(i, i)] >= 0.0);
        let symmetric = *information == information.transpose();
        self.old != self.new
            && self.old_from_new.is_finite()
            && information.iter().all(|x| x.is_finite())
            && positive
            && symmetric
    }
}

//! Absolute camera pose from known points, without an initial guess and with many outliers. Used for relocalisation.

use crate::extent::spread;
use crate::sampling::Rng;
use crate::{
    Intrinsics, MotionOptions, MotionPair, PoseObservation, PoseOptions, find_camera_motion,
    optimise_pose,
};
use stillpoint_geometry::{Mat6, Se3, Vec3};

/// Effort and gates of the search for an absolute pose.
#[derive(Clone, Copy, Debug)]
pub struct AbsolutePoseOptions {
    /// Probability of drawing at least one sample without outliers, 0 to 1.
    pub confidence: f64,
    /// Minimum number of samples.
    pub min_iterations: usize,
    /// Maximum number of samples. The default finds 15 % of inliers with 99.9 %.
    pub max_iterations: usize,
    /// Factor on the squared chi-square gates (95 %).
    pub gate_scale: f64,
    /// Minimum number of inliers, at least 4: three points allow several poses.
    pub min_inliers: usize,
    /// Minimum spread of the inliers' points across their best-fitting line, m.
    pub min_extent_m: f64,
}

impl Default for AbsolutePoseOptions {
    fn default() -> Self {
        Self {
            confidence: 0.999,
            min_iterations: 20,
            max_iterations: 2050,
            gate_scale: 1.0,
            min_inliers: 15,
            min_extent_m: 0.05,
        }
    }
}

/// An estimated pose.
#[derive(Clone, Debug)]
pub struct AbsolutePose {
    /// The pose.
    pub camera_from_world: Se3,
    /// Per observation: within the gate.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub inlier_count: usize,
    /// Samples drawn.
    pub iterations: usize,
    /// Inverse covariance, for a left perturbation `[translation; rotation]` of `camera_from_world`, from the
    /// measurements' variances.
    pub information: Mat6,
}

/// Result of the search for an absolute pose.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // There is one per candidate, and none is kept.
pub enum AbsolutePoseOutcome {
    /// A pose was found.
    Found(AbsolutePose),
    /// Fewer finite observations than the required number of inliers.
    TooFewObservations {
        /// Number of finite observations.
        usable: usize,
    },
    /// No pose has enough inliers.
    NoConsensus,
    /// The inliers' points are nearly collinear or coincident and do not determine a pose.
    Degenerate {
        /// Number of inliers.
        inliers: usize,
    },
}

impl AbsolutePoseOutcome {
    /// The pose, if one was found.
    #[must_use]
    pub fn found(&self) -> Option<&AbsolutePose> {
        match self {
            Self::Found(pose) => Some(pose),
            _ => None,
        }
    }
}

/// Factor on the squared gates for the final optimisation. Chosen: twice the gate as a distance.
pub(crate) const FINAL_OPENING: f64 = 4.0;

/// Estimates the pose `camera_from_world` with most inliers. Samples of three are solved by P3P, or by alignment if all
/// have depth; each new best one is refined locally (LO-RANSAC); the winner is optimised on all observations near it by
/// [`optimise_pose`].
#[must_use]
pub fn find_absolute_pose(
    camera: &Intrinsics,
    observations: &[PoseObservation],
    options: &AbsolutePoseOptions,
    rng: Rng,
) -> AbsolutePoseOutcome {
    let least = options.min_inliers.max(4);
    let usable = observations.iter().filter(|o| is_usable(o)).count();
    if usable < least {
        return AbsolutePoseOutcome::TooFewObservations { usable };
    }
    let pairs: Vec<MotionPair> = observations
        .iter()
        .map(|o| MotionPair {
            point: o.point,
            measurement: o.measurement,
            weight: if is_usable(o) { 1.0 } else { 0.0 },
        })
        .collect();
    let motion = MotionOptions {
        confidence: options.confidence,
        min_iterations: options.min_iterations,
        max_iterations: options.max_iterations,
        gate_scale: options.gate_scale,
        min_inliers: least,
        ..MotionOptions::default()
    };
    let Some(rough) = find_camera_motion(camera, &pairs, None, &motion, rng) else {
        return AbsolutePoseOutcome::NoConsensus;
    };
    refine(
        camera,
        observations,
        options,
        &rough.b_from_a,
        rough.iterations,
    )
}

fn refine(
    camera: &Intrinsics,
    observations: &[PoseObservation],
    options: &AbsolutePoseOptions,
    rough: &Se3,
    iterations: usize,
) -> AbsolutePoseOutcome {
    let near: Vec<usize> = (0..observations.len())
        .filter(|&i| {
            let o = &observations[i];
            let chi2 = o.measurement.chi2(camera, &rough.transform(&o.point));
            is_usable(o) && chi2 <= o.measurement.gate() * options.gate_scale * FINAL_OPENING
        })
        .collect();
    let chosen: Vec<PoseObservation> = near.iter().map(|&i| observations[i]).collect();
    let pose_options = PoseOptions {
        gate_scale: options.gate_scale,
        ..PoseOptions::default()
    };
    let estimate = optimise_pose(camera, rough, &chosen, &pose_options);
    if estimate.inlier_count < options.min_inliers.max(4) || !estimate.camera_from_world.is_finite()
    {
        return AbsolutePoseOutcome::NoConsensus;
    }
    let (mut inliers, mut points) = (vec![false; observations.len()], Vec::<Vec3>::new());
    for (&i, inlier) in near.iter().zip(&estimate.inliers) {
        inliers[i] = *inlier;
        if *inlier {
            points.push(observations[i].point);
        }
    }
    if spread(&points) < options.min_extent_m {
        return AbsolutePoseOutcome::Degenerate {
            inliers: estimate.inlier_count,
        };
    }
    AbsolutePoseOutcome::Found(AbsolutePose {
        camera_from_world: estimate.camera_from_world,
        inliers,
        inlier_count: estimate.inlier_count,
        iterations,
        information: estimate.information,
    })
}

fn is_usable(o: &PoseObservation) -> bool {
    o.point.sum().is_finite() && o.measurement.is_sound()
}

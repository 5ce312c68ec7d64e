//! Two-view relations, camera motion, rigid and absolute poses, pose optimisation, triangulation, bundle adjustment and
//! pose graphs.
//!
//! Functions from arrays to results, independent of keyframes and maps. Failing to converge is a result, not an error.
//! All sums are taken in a fixed order.

mod absolute_pose;
mod bundle;
mod camera_motion;
mod covariance;
mod degeneracy;
mod extent;
mod fundamental;
mod gradients;
mod homography;
mod linear;
mod linearise;
mod motion_search;
mod observation;
mod ordering;
mod p3p;
mod place;
mod pose;
mod pose_graph;
mod reduced;
mod rigid;
mod sampling;
mod schur;
mod sparse;
mod triangulate;
mod turn;
mod twist;
mod two_view;
mod votes;

pub use absolute_pose::{
    AbsolutePose, AbsolutePoseOptions, AbsolutePoseOutcome, find_absolute_pose,
};
pub use bundle::{
    BundleObservation, BundleOptions, BundleProblem, BundleReport, BundleStop, adjust_bundle,
};
pub use camera_motion::{CameraMotion, MotionOptions, MotionPair, MotionPrior};
pub use covariance::pose_covariance;
pub use degeneracy::{Degeneracy, DegeneracyTest, test_degeneracy, transfer_squared};
pub use fundamental::{
    Fundamental, epipolar_distance, find_fundamental, sampson_squared, seven_point,
};
pub use homography::{Homography, find_homography, four_point};
pub use linearise::{Linearised, linearise};
pub use motion_search::{MotionFinder, find_camera_motion};
pub use observation::{Intrinsics, Measurement};
pub use p3p::p3p;
pub use place::KnownPlace;
pub use pose::{PoseEstimate, PoseObservation, PoseOptions, optimise_pose, optimise_pose_in};
pub use pose_graph::{
    EdgeFit, EdgeKernel, PoseGraph, PoseGraphEdge, PoseGraphOptions, PoseGraphOutcome,
    PoseGraphRefusal, PoseGraphReport, optimise_pose_graph,
};
pub use rigid::{RigidEstimate, RigidOptions, RigidOutcome, RigidPair, find_rigid};
pub use sampling::{Purpose, Rng, address, ransac_iterations, rng};
pub use triangulate::{Triangulation, triangulate_midpoint};
pub use turn::{KnownShift, KnownTurn};
pub use two_view::{PixelPair, TwoViewOptions};

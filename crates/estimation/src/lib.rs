//! Pose optimisation, triangulation and bundle adjustment: arrays in, results out.

//! Deterministic rooms with a Kinect-like camera and exact ground truth.

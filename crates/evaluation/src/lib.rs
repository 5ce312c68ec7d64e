//! ATE, RPE, timing statistics and plots of trajectories.

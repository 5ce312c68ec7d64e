//! `--up`: the up direction in the map.

use crate::sink::Output;
use clap::Args;
use stillpoint::slam::Up;

#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct UpOutput {
    /// Approximate direction away from the floor, in the map frame [default: for --dense as measured by the inertial sensor, else as stored
    /// in the initial map, else assuming that the camera was first held upright]. --save-map stores it.
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
}

/// Parses `0,-1,0`.
pub(crate) fn direction(text: &str) -> Result<[f64; 3], String> {
    let parts: Vec<f64> = text
        .split(',')
        .filter_map(|p| p.trim().parse().ok())
        .collect();
    <[f64; 3]>::try_from(parts)
        .ok()
        .filter(|d| d.iter().all(|v| v.is_finite()) && d.iter().any(|v| v.abs() > 1e-6))
        .ok_or_else(|| "expected three numbers that are not all 0, such as 0,-1,0".to_owned())
}

impl UpOutput {
    pub(crate) fn named(self) -> Option<Up> {
        self.up.and_then(|up| Up::along(&up.into()))
    }
}

impl Output for UpOutput {}

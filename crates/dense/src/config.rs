//! Settings of the dense map.

/// Settings of the dense map. All lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseConfig {
    /// Voxel size, m. Range: 0.005 to 0.2. 2 cm shows furniture and is the precision of a depth camera up to 3 m.
    pub voxel: f64,
    /// Maximum depth that is fused, m. Range: 0.5 to 8. A Kinect errs by 2.6 cm at 4 m (Nguyen et al., 2012) and by more beyond.
    pub max_depth: f64,
    /// Minimum depth that is used, m. Range: 0.01 to 2.
    pub min_depth: f64,
    /// Minimum time between integrated frames, s. Range: 0 to 10. 15 frames per second see every surface often, at half the cost.
    pub interval: f64,
    /// Memory for kept frames, bytes. Beyond it the oldest drop their depth.
    pub depth_budget: usize,
    /// Maximum number of kept frames that are re-integrated per event during a correction.
    pub rebuild_per_event: usize,
    /// Side of the cells of the coarse grid, m. Range: 0.02 to 0.5.
    pub cell: f64,
}

impl Default for DenseConfig {
    fn default() -> Self {
        Self {
            voxel: 0.02,
            max_depth: 4.0,
            min_depth: 0.3,
            interval: 0.05,
            depth_budget: 256 << 20,
            rebuild_per_event: 2,
            cell: 0.05,
        }
    }
}

/// A setting out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name}: expected {least} to {most}, found {found}; correct it")]
pub struct DenseConfigError {
    name: &'static str,
    least: f64,
    most: f64,
    found: f64,
}

impl DenseConfig {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The first setting out of range.
    pub fn validate(&self) -> Result<(), DenseConfigError> {
        for (name, found, least, most) in [
            ("voxel", self.voxel, 0.005, 0.2),
            ("max_depth", self.max_depth, 0.5, 8.0),
            ("min_depth", self.min_depth, 0.01, 2.0),
            ("interval", self.interval, 0.0, 10.0),
            ("cell", self.cell, 0.02, 0.5),
        ] {
            if !(least..=most).contains(&found) {
                return Err(DenseConfigError {
                    name,
                    least,
                    most,
                    found,
                });
            }
        }
        Ok(())
    }

    /// Truncation distance, m: four voxels, and at least the depth error.
    #[must_use]
    pub fn truncation(&self) -> f64 {
        (4.0 * self.voxel).max(0.06)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_values_are_reported() {
        assert_eq!(DenseConfig::default().validate(), Ok(()));
        for voxel in [0.0, 1.0, f64::NAN] {
            let config = DenseConfig {
                voxel,
                ..DenseConfig::default()
            };
            let said = config.validate().unwrap_err().to_string();
            assert!(
                said.starts_with("voxel: expected 0.005 to 0.2, found"),
                "{said}"
            );
        }
    }
}

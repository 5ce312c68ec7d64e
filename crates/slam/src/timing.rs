//! Estimated exposure timing, and its storage in map files.

use stillpoint_map::Extension;

/// Exposure times of the parts of a frame, relative to its stamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Readout time from the exposure of the first row to the last, s; the stamp is that of the middle row.
    pub readout: f64,
    /// Standard deviation of the readout, s; 0 if configured rather than estimated.
    pub readout_sigma: f64,
    /// Age of the depth image at its stamp, s.
    pub depth_delay: f64,
}

impl Timing {
    /// Name of the map file extension that holds the readout of the map's camera.
    pub const EXTENSION: &str = "stillpoint/readout";

    /// Readout and standard deviation as a map file extension: two little-endian doubles, s.
    #[must_use]
    pub fn to_extension(&self) -> Extension {
        let numbers = [self.readout, self.readout_sigma];
        Extension {
            name: Self::EXTENSION.to_owned(),
            bytes: numbers.iter().flat_map(|n| n.to_le_bytes()).collect(),
        }
    }

    /// Readout and standard deviation (s) from [`Timing::to_extension`]; `None` for invalid bytes.
    #[must_use]
    pub fn readout_in(bytes: &[u8]) -> Option<[f64; 2]> {
        let (numbers, rest) = bytes.as_chunks::<8>();
        let [readout, sigma] = numbers else {
            return None;
        };
        let both = [readout, sigma].map(|n| f64::from_le_bytes(*n));
        let valid = rest.is_empty() && both.iter().all(|n| (0.0..=0.1).contains(n));
        valid.then_some(both)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn readout_round_trips_through_bytes(readout in 0.0..0.1, readout_sigma in 0.0..0.1) {
            let timing = Timing { readout, readout_sigma, depth_delay: 0.01 };
            let bytes = timing.to_extension().bytes;
            prop_assert_eq!(Timing::readout_in(&bytes), Some([readout, readout_sigma]));
            prop_assert_eq!(Timing::readout_in(&bytes[1..]), None);
        }

        #[test]
        fn arbitrary_bytes_give_a_valid_readout_or_none(bytes in prop::collection::vec(any::<u8>(), 0..24)) {
            if let Some(both) = Timing::readout_in(&bytes) {
                prop_assert!(bytes.len() == 16 && both.iter().all(|n| (0.0..=0.1).contains(n)));
            }
        }
    }
}

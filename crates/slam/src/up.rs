//! The up direction in the world of a map, and its storage in map files.

use stillpoint_geometry::Vec3;
use stillpoint_map::Extension;

/// Accepted norms of a unit vector.
const UNIT: std::ops::RangeInclusive<f64> = 0.99..=1.01;

/// Unit vector away from the ground in the world of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Up(Vec3);

impl Up {
    /// Name of the map file extension that holds it.
    pub const EXTENSION: &str = "stillpoint/up";

    /// Direction of a vector; `None` if zero or not finite.
    #[must_use]
    pub fn along(vector: &Vec3) -> Option<Self> {
        let length = vector.norm();
        (length.is_finite() && length > 0.0).then(|| Self(vector / length))
    }

    /// As a unit vector.
    #[must_use]
    pub fn vector(&self) -> Vec3 {
        self.0
    }

    /// As a map file extension: x, y, z as little-endian doubles.
    #[must_use]
    pub fn to_extension(&self) -> Extension {
        Extension {
            name: Self::EXTENSION.to_owned(),
            bytes: self.0.iter().flat_map(|n| n.to_le_bytes()).collect(),
        }
    }

    /// Inverse of [`Up::to_extension`]; `None` for bytes that are not a unit vector.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (numbers, rest) = bytes.as_chunks::<8>();
        let numbers: &[[u8; 8]; 3] = numbers.try_into().ok()?;
        let vector = Vec3::from(numbers.map(f64::from_le_bytes));
        (rest.is_empty() && UNIT.contains(&vector.norm())).then_some(Self(vector))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn direction_round_trips_through_bytes(vector in prop::array::uniform3(-5.0..5.0_f64)) {
            let Some(up) = Up::along(&vector.into()) else { return Ok(()) };
            let bytes = up.to_extension().bytes;
            prop_assert_eq!(Up::from_bytes(&bytes), Some(up));
            prop_assert_eq!(Up::from_bytes(&bytes[1..]), None);
        }

        #[test]
        fn arbitrary_bytes_give_a_unit_vector_or_none(bytes in prop::collection::vec(any::<u8>(), 0..32)) {
            if let Some(up) = Up::from_bytes(&bytes) {
                prop_assert!(bytes.len() == 24 && UNIT.contains(&up.vector().norm()));
            }
        }
    }

    #[test]
    fn invalid_vectors_have_no_direction() {
        assert_eq!(Up::along(&Vec3::zeros()), None);
        assert_eq!(Up::along(&Vec3::new(f64::NAN, 0.0, 1.0)), None);
        assert_eq!(Up::from_bytes(&[0; 24]), None);
        assert_eq!(Up::from_bytes(&f64::NAN.to_le_bytes().repeat(3)), None);
    }
}

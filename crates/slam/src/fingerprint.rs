//! 64-bit FNV-1a hash (Fowler, Noll, Vo); not cryptographic.

use stillpoint_geometry::Se3;

/// Hash of all bytes in order. Inputs that differ in one byte have different hashes, since each step is bijective.
#[derive(Clone, Debug)]
pub(crate) struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fingerprint {
    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.0 = (self.0 ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    pub(crate) fn number(&mut self, number: u64) {
        self.bytes(&number.to_le_bytes());
    }

    pub(crate) fn pose(&mut self, pose: &Se3) {
        for x in pose.rotation.coords.iter().chain(pose.translation.iter()) {
            self.number(x.to_bits());
        }
    }

    pub(crate) fn value(&self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fnv1a_matches_published_values() {
        // From the authors' test suite.
        for (text, value) in [
            ("", 0xcbf2_9ce4_8422_2325),
            ("a", 0xaf63_dc4c_8601_ec8c),
            ("foobar", 0x8594_4171_f739_67e8),
        ] {
            let mut f = Fingerprint::default();
            f.text(text);
            assert_eq!(f.value(), value, "{text:?}");
        }
    }
}

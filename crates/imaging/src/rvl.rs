//! RVL compression of depth images by runs of zeros and variable-length differences: A. D. Wilson, Fast lossless depth
//! image compression, ACM Interactive Surfaces and Spaces 2017.

/// Writes numbers as groups of three bits in half bytes, the highest half byte of each 32-bit word first.
struct Writer<'a> {
    out: &'a mut Vec<u8>,
    word: u64,
    filled: u32,
}

impl Writer<'_> {
    #[inline]
    fn put(&mut self, mut value: u32) {
        loop {
            let more = u64::from(value > 7) << 3;
            self.word = (self.word << 4) | u64::from(value & 7) | more;
            self.filled += 1;
            if self.filled == 8 {
                self.out
                    .extend_from_slice(&(self.word as u32).to_le_bytes());
                (self.word, self.filled) = (0, 0);
            }
            value >>= 3;
            if value == 0 {
                return;
            }
        }
    }

    fn finish(self) {
        if self.filled > 0 {
            let word = (self.word << (4 * (8 - self.filled))) as u32;
            self.out.extend_from_slice(&word.to_le_bytes());
        }
    }
}

/// Packs values into `out`, which is cleared first.
pub fn encode(values: &[u16], out: &mut Vec<u8>) {
    out.clear();
    let mut writer = Writer {
        out,
        word: 0,
        filled: 0,
    };
    let (mut at, mut last) = (0, 0_i32);
    while at < values.len() {
        let zeros = values[at..].iter().take_while(|v| **v == 0).count();
        at += zeros;
        let run = values[at..].iter().take_while(|v| **v != 0).count();
        writer.put(zeros as u32);
        writer.put(run as u32);
        for v in &values[at..at + run] {
            let difference = i32::from(*v) - last;
            last = i32::from(*v);
            writer.put(((difference << 1) ^ (difference >> 31)) as u32);
        }
        at += run;
    }
    writer.finish();
}

struct Reader<'a> {
    words: std::slice::ChunksExact<'a, u8>,
    word: u32,
    left: u32,
}

impl Reader<'_> {
    #[inline]
    fn next(&mut self) -> Option<u32> {
        let mut value = 0_u32;
        for shift in (0..32).step_by(3) {
            if self.left == 0 {
                self.word = u32::from_le_bytes(self.words.next()?.try_into().ok()?);
                self.left = 8;
            }
            let part = self.word >> 28;
            self.word <<= 4;
            self.left -= 1;
            value |= (part & 7) << shift;
            if part & 8 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Unpacks `count` values into `out`, which is cleared first; `None` for malformed bytes. Memory is proportional to the
/// values read, except for runs of zeros.
#[must_use]
pub fn decode(bytes: &[u8], count: usize, out: &mut Vec<u16>) -> Option<()> {
    out.clear();
    let mut reader = Reader {
        words: bytes.chunks_exact(4),
        word: 0,
        left: 0,
    };
    let mut last = 0_i32;
    while out.len() < count {
        let (zeros, run) = (reader.next()? as usize, reader.next()? as usize);
        if zeros.checked_add(run)? > count - out.len() || zeros + run == 0 {
            return None;
        }
        out.resize(out.len() + zeros, 0);
        for _ in 0..run {
            let coded = reader.next()?;
            last = last.wrapping_add((coded >> 1) as i32 ^ -((coded & 1) as i32));
            out.push(last as u16);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rvl_round_trips(values in prop::collection::vec(prop_oneof![Just(0_u16), any::<u16>(), 900_u16..1000], 0..400)) {
            let (mut bytes, mut back) = (Vec::new(), Vec::new());
            encode(&values, &mut bytes);
            prop_assert_eq!(decode(&bytes, values.len(), &mut back), Some(()));
            prop_assert_eq!(&back, &values);
            prop_assert!(values.is_empty() || decode(&bytes, values.len() + 9, &mut back).is_none());
        }

        #[test]
        fn arbitrary_bytes_are_refused_or_decoded(bytes in prop::collection::vec(any::<u8>(), 0..200), count in 0_usize..500) {
            let mut out = Vec::new();
            if decode(&bytes, count, &mut out).is_some() {
                prop_assert_eq!(out.len(), count);
            }
        }
    }

    /// The bytes of Wilson's paper: two zeros, then +5, -1, +0.
    #[test]
    fn encoding_matches_the_paper() {
        let mut bytes = Vec::new();
        encode(&[0, 0, 5, 4, 4], &mut bytes);
        assert_eq!(bytes, 0x23A1_1000_u32.to_le_bytes());
    }

    fn decoded(bytes: &[u8], count: usize) -> Option<Vec<u16>> {
        let mut out = vec![7];
        decode(bytes, count, &mut out).map(|()| out)
    }

    /// Packs half bytes, the first one highest in its word.
    fn words(halves: &[u8]) -> Vec<u8> {
        let word = |chunk: &[u8]| {
            let place = |(i, h): (usize, &u8)| u32::from(*h) << (28 - 4 * i);
            chunk.iter().enumerate().map(place).sum::<u32>()
        };
        halves
            .chunks(8)
            .flat_map(|c| word(c).to_le_bytes())
            .collect()
    }

    #[test]
    fn runs_and_differences_are_decoded() {
        // 2 zeros, then 3 values: +5 (coded 10 = 2 + 1 * 8), -1 (coded 1), +0.
        let bytes = words(&[2, 3, 8 | 2, 1, 1, 0]);
        assert_eq!(decoded(&bytes, 5), Some(vec![0, 0, 5, 4, 4]));
        assert_eq!(decoded(&bytes, 6), None, "nothing is left");
        assert_eq!(decoded(&bytes, 4), None, "more than there is room for");
        assert_eq!(decoded(&[], 1), None);
        assert_eq!(decoded(&[0xff; 64], 100), None);
        assert_eq!(decoded(&[0; 64], 100), None);
    }
}

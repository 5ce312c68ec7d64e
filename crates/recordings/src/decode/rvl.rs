//! Depth images compressed by runs of zeros and differences of variable length: A. D. Wilson, Fast lossless depth image compression,
//! ACM Interactive Surfaces and Spaces 2017.

/// Reads numbers of three bits per half byte, the highest half byte of each 32-bit word first.
struct Numbers<'a> {
    words: std::slice::ChunksExact<'a, u8>,
    word: u32,
    left: u32,
}

impl Numbers<'_> {
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

/// `count` depth values; `None` for bytes that are not that many.
pub(super) fn decode(bytes: &[u8], count: usize) -> Option<Vec<u16>> {
    // The last word is written as a whole.
    let mut numbers = Numbers {
        words: bytes.chunks_exact(4),
        word: 0,
        left: 0,
    };
    let mut out = Vec::new();
    let mut last = 0_i32;
    while out.len() < count {
        let zeros = numbers.next()? as usize;
        let values = numbers.next()? as usize;
        let left = (count - out.len()).checked_sub(zeros)?.checked_sub(values);
        left?;
        if zeros == 0 && values == 0 {
            return None;
        }
        out.resize(out.len() + zeros, 0);
        for _ in 0..values {
            let coded = numbers.next()?;
            // The sign is the lowest bit.
            let difference = (coded >> 1) as i32 ^ -((coded & 1) as i32);
            last = last.wrapping_add(difference);
            out.push(last as u16);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half bytes, the first one highest in its word.
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

    /// Images that another implementation compressed: those of `tools/recordings/rvl_frames.py`, and of the file that `STILLPOINT_RVL` names.
    #[test]
    fn images_of_another_implementation_are_read() {
        let mut files = vec![include_bytes!("../../tests/golden/rvl.bin").to_vec()];
        files.extend(std::env::var_os("STILLPOINT_RVL").map(|p| std::fs::read(p).unwrap()));
        for file in files {
            let mut rest = &*file;
            let mut images = 0;
            while !rest.is_empty() {
                let head = [0, 4, 8]
                    .map(|at| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap()) as usize);
                let (packed, values) = rest[12..].split_at(head[2]);
                let count = head[0] * head[1];
                let expected = values[..2 * count].chunks_exact(2);
                let expected: Vec<u16> =
                    expected.map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
                assert_eq!(decode(packed, count), Some(expected), "image {images}");
                rest = &values[2 * count..];
                images += 1;
            }
            assert!(images >= 8, "{images}");
        }
    }

    #[test]
    fn runs_and_differences_are_read() {
        // 2 zeros, then 3 values: +5 (coded 10 = 2 + 1 * 8), -1 (coded 1), +0.
        let bytes = words(&[2, 3, 8 | 2, 1, 1, 0]);
        assert_eq!(decode(&bytes, 5), Some(vec![0, 0, 5, 4, 4]));
        assert_eq!(decode(&bytes, 6), None, "nothing is left");
        assert_eq!(decode(&bytes, 4), None, "more than there is room for");
        assert_eq!(decode(&[], 1), None);
        // Numbers without an end, and runs of nothing.
        assert_eq!(decode(&[0xff; 64], 100), None);
        assert_eq!(decode(&[0; 64], 100), None);
    }
}

//! Decodes YUV images: packed pairs of pixels (4:2:2), or a luma plane followed by chroma.

/// Byte positions of the two luma values and the chroma of a pair of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Order {
    luma: [usize; 2],
    blue: usize,
    red: usize,
}

/// The order of an encoding: ROS's `yuv422` is UYVY, `yuv422_yuy2` is YUYV.
pub(super) fn order(encoding: &str) -> Option<Order> {
    match encoding {
        "yuv422" | "uyvy" | "UYVY" => Some(Order {
            luma: [1, 3],
            blue: 0,
            red: 2,
        }),
        "yuv422_yuy2" | "yuyv" | "YUYV" | "yuy2" => Some(Order {
            luma: [0, 2],
            blue: 1,
            red: 3,
        }),
        _ => None,
    }
}

/// RGB by ITU-R BT.601, with luma from 16 to 235.
fn pixel(luma: u8, blue: u8, red: u8) -> [u8; 3] {
    let (u, v) = (i32::from(blue) - 128, i32::from(red) - 128);
    let y = 298 * (i32::from(luma) - 16) + 128;
    let channels = [y + 409 * v, y - 100 * u - 208 * v, y + 516 * u];
    channels.map(|c| (c >> 8).clamp(0, 255) as u8)
}

pub(super) fn rgb<'a>(
    rows: impl Iterator<Item = &'a [u8]>,
    width: usize,
    height: usize,
    order: Order,
) -> Vec<u8> {
    let mut out = Vec::with_capacity(3 * width * height);
    for row in rows {
        let end = out.len() + 3 * width;
        for pair in row.chunks(4) {
            // An odd width leaves half a pair, whose second chroma is missing.
            let at = |i: usize| pair.get(i).copied().unwrap_or(128);
            for luma in order.luma {
                out.extend(pixel(at(luma), at(order.blue), at(order.red)));
            }
        }
        out.resize(end, 0);
    }
    out
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Planes {
    /// Number of pixels along each side that share a chroma value.
    shared: usize,
    /// Interleaved chroma; otherwise two planes.
    together: bool,
    red_first: bool,
}

/// The layout of an encoding, by the names of ROS and of some drivers.
pub(super) fn planes(encoding: &str) -> Option<Planes> {
    let of = |shared, together, red_first| {
        Some(Planes {
            shared,
            together,
            red_first,
        })
    };
    match encoding.to_lowercase().as_str() {
        "nv12" => of(2, true, false),
        "nv21" => of(2, true, true),
        "nv24" => of(1, true, false),
        "i420" | "yuv420" | "yuv420p" => of(2, false, false),
        "yv12" => of(2, false, true),
        _ => None,
    }
}

impl Planes {
    /// Bytes of a chroma row, and of all chroma, for luma rows of `step` bytes.
    fn chroma(&self, height: usize, step: usize) -> (usize, usize) {
        let rows = height.div_ceil(self.shared);
        let row = step.div_ceil(self.shared);
        if self.together {
            (2 * row, 2 * row * rows)
        } else {
            (row, 2 * row * rows)
        }
    }

    /// Height of the image, if enough bytes are present. Some drivers include the rows of chroma in the stated height.
    fn height(&self, bytes: usize, stated: usize, step: usize) -> Option<usize> {
        let size = |height: usize| height * step + self.chroma(height, step).1;
        if size(stated) <= bytes {
            return Some(stated);
        }
        // Luma is two thirds of the data, or a third.
        let of_all = if self.shared == 2 { [2, 3] } else { [1, 3] };
        let height = stated * of_all[0] / of_all[1];
        let all = stated * step;
        (height > 0 && bytes == all && size(height) == all).then_some(height)
    }

    /// The image as RGB, and its height; `None` where bytes are missing.
    pub(super) fn rgb(
        &self,
        data: &[u8],
        (width, height): (usize, usize),
        step: usize,
    ) -> Option<(Vec<u8>, usize)> {
        let step = if step == 0 { width } else { step };
        if step < width {
            return None;
        }
        let height = self.height(data.len(), height, step)?;
        let (luma, chroma) = data.split_at(height * step);
        let (row, all) = self.chroma(height, step);
        let (first, second, apart) = if self.together {
            (chroma, &chroma[1..], 2)
        } else {
            (chroma, &chroma[all / 2..], 1)
        };
        let (blue, red) = if self.red_first {
            (second, first)
        } else {
            (first, second)
        };
        let mut out = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            let start = y / self.shared * row;
            for (x, luma) in luma[y * step..][..width].iter().enumerate() {
                let at = start + x / self.shared * apart;
                out.extend(pixel(*luma, blue[at], red[at]));
            }
        }
        Some((out, height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_yuv_orders_give_bt601_colours() {
        // Black, white and the primary red of BT.601: (81, 90, 240).
        for (encoding, bytes) in [
            ("uyvy", [128, 16, 128, 235, 90, 81, 240, 81]),
            ("yuyv", [16, 128, 235, 128, 81, 90, 81, 240]),
        ] {
            let order = order(encoding).unwrap();
            let found = rgb([&bytes[..]].into_iter(), 4, 1, order);
            let expected = [0, 0, 0, 255, 255, 255, 254, 0, 0, 254, 0, 0];
            for (f, e) in found.iter().zip(expected) {
                assert!(f.abs_diff(e) <= 1, "{encoding}: {found:?}");
            }
        }
    }

    #[test]
    fn planar_chroma_is_decoded() {
        // 4 x 2 px: red on the left, white on the right; rows of chroma for two rows of luma.
        let luma = [81, 81, 235, 235, 81, 81, 235, 235];
        let near = |found: &[u8], name: &str| {
            for (i, p) in found.chunks(3).enumerate() {
                let expected = if i % 4 < 2 { [254, 0, 0] } else { [255; 3] };
                let off = p.iter().zip(expected).map(|(f, e)| f.abs_diff(e)).max();
                assert!(off <= Some(1), "{name}: {found:?}");
            }
        };
        for (name, chroma) in [
            ("nv12", vec![90, 240, 128, 128]),
            ("NV21", vec![240, 90, 128, 128]),
            ("i420", vec![90, 128, 240, 128]),
            ("yv12", vec![240, 128, 90, 128]),
            ("nv24", [90, 240, 90, 240, 128, 128, 128, 128].repeat(2)),
        ] {
            let planes = planes(name).unwrap();
            let bytes = [&luma[..], &chroma].concat();
            let (found, height) = planes.rgb(&bytes, (4, 2), 4).unwrap();
            assert_eq!(height, 2);
            near(&found, name);
            // With the rows of chroma in the height.
            let rows = bytes.len() / 4;
            let (found, height) = planes.rgb(&bytes, (4, rows), 4).unwrap();
            assert_eq!(height, 2, "{name}");
            near(&found, name);
            assert!(planes.rgb(&bytes[..bytes.len() - 1], (4, 2), 4).is_none());
            assert!(planes.rgb(&bytes, (5, 2), 4).is_none());
        }
        // Odd sides: the last column and row have their own chroma.
        let bytes = [&[235; 9][..], &[128; 8]].concat();
        let (found, _) = planes("nv12").unwrap().rgb(&bytes, (3, 3), 3).unwrap();
        assert_eq!(found, [255; 27]);
    }
}

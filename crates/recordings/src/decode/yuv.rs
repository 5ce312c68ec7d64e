//! Packed YUV 4:2:2, as cameras send it over USB.

/// Where the two luminances and the chroma of a pair of pixels are.
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

/// Rows of pairs of pixels as RGB, by ITU-R BT.601 with luminance from 16 to 235.
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
            let at = |i: usize| i32::from(pair.get(i).copied().unwrap_or(128));
            let (u, v) = (at(order.blue) - 128, at(order.red) - 128);
            for luma in order.luma {
                let y = 298 * (at(luma) - 16) + 128;
                let channels = [y + 409 * v, y - 100 * u - 208 * v, y + 516 * u];
                out.extend(channels.map(|c| (c >> 8).clamp(0, 255) as u8));
            }
        }
        out.resize(end, 0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_give_the_colours_of_the_standard() {
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
}

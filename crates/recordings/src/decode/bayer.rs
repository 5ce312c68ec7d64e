//! Demosaicing of Bayer images.

/// Channel (0 red, 1 green, 2 blue) of a pixel, by the parities of row and column.
pub(super) type Mosaic = [[usize; 2]; 2];

/// The mosaic of an encoding, and the bytes per pixel. The names list the first two pixels of the first two rows.
pub(super) fn mosaic(encoding: &str) -> Option<(Mosaic, usize)> {
    let rest = encoding.strip_prefix("bayer_")?;
    let (name, bytes) = rest
        .strip_suffix("16")
        .map(|name| (name, 2))
        .or_else(|| rest.strip_suffix('8').map(|name| (name, 1)))?;
    let mosaic = match name {
        "rggb" => [[0, 1], [1, 2]],
        "bggr" => [[2, 1], [1, 0]],
        "gbrg" => [[1, 2], [0, 1]],
        "grbg" => [[1, 0], [2, 1]],
        _ => return None,
    };
    Some((mosaic, bytes))
}

/// Interpolates each missing channel as the mean of the neighbours that have it.
pub(super) fn rgb(values: &[u8], width: usize, height: usize, mosaic: Mosaic) -> Vec<u8> {
    let mut out = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for x in 0..width {
            let (mut sums, mut counts) = ([0_u32; 3], [0_u32; 3]);
            for row in rows.clone() {
                let seen = &mosaic[row & 1];
                for column in x.saturating_sub(1)..(x + 2).min(width) {
                    let channel = seen[column & 1];
                    sums[channel] += u32::from(values[row * width + column]);
                    counts[channel] += 1;
                }
            }
            let own = mosaic[y & 1][x & 1];
            let value = values[y * width + x];
            out.extend(
                [0, 1, 2].map(|channel| match (counts[channel], sums[channel]) {
                    // An image of one row or column lacks some channels.
                    (0, _) => value,
                    _ if channel == own => value,
                    (count, sum) => ((sum + count / 2) / count) as u8,
                }),
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_colour_is_demosaiced_exactly() {
        let colour = [200, 120, 40];
        for name in ["rggb", "bggr", "gbrg", "grbg"] {
            let (mosaic, bytes) = mosaic(&format!("bayer_{name}8")).unwrap();
            assert_eq!(bytes, 1);
            // The name states the colours of the first pixels.
            let letters = name
                .bytes()
                .map(|b| b"rgb".iter().position(|l| *l == b).unwrap());
            assert!(letters.eq(mosaic.concat()), "{name}");
            let values: Vec<u8> = (0..5 * 4)
                .map(|i| colour[mosaic[(i / 5) & 1][(i % 5) & 1]])
                .collect();
            let found = rgb(&values, 5, 4, mosaic);
            assert!(found.chunks(3).all(|p| p == colour), "{name}: {found:?}");
        }
        assert_eq!(mosaic("bayer_rggb16").unwrap().1, 2);
        assert!(mosaic("bayer_rgbg8").is_none() && mosaic("rggb8").is_none());
        assert_eq!(rgb(&[7], 1, 1, [[0, 1], [1, 2]]), [7, 7, 7]);
    }

    #[test]
    fn missing_colours_are_interpolated_linearly() {
        // Red falls from 100 to 60 along a row of RGRG; green and blue are 0.
        let (mosaic, _) = mosaic("bayer_rggb8").unwrap();
        let found = rgb(&[100, 0, 60, 0, 0, 0, 0, 0], 4, 2, mosaic);
        assert_eq!([found[0], found[3], found[6]], [100, 80, 60]);
    }
}

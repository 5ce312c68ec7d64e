//! Scouts: features that tell where those beside them are in the image before.

/// Where a feature is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Raw px.
    pub(super) pixel: [f32; 2],
    /// m; 0 where there is none.
    pub(super) depth: f32,
}

/// A feature that was found in the image before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scout {
    pub(super) place: Place,
    /// From where it was expected to where it was found, raw px.
    pub(super) off: [f32; 2],
}

/// What the guess of a feature is off by, raw px: that of the scout which is nearest in space, with a focal length in px; nothing without scouts. Of a feature
/// without depth the nearest in the image.
pub(super) fn off_near(scouts: &[Scout], place: &Place, focal: f32) -> [f32; 2] {
    let distance = |scout: &Scout| {
        let [x, y] = [0, 1].map(|k| scout.place.pixel[k] - place.pixel[k]);
        let known = scout.place.depth > 0.0 && place.depth > 0.0;
        let z = if known {
            focal * (scout.place.depth / place.depth - 1.0)
        } else {
            0.0
        };
        x * x + y * y + z * z
    };
    let mut nearest = (f32::INFINITY, [0.0; 2]);
    for scout in scouts {
        let distance = distance(scout);
        if distance < nearest.0 {
            nearest = (distance, scout.off);
        }
    }
    nearest.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32, depth: f32) -> Place {
        Place {
            pixel: [x, 100.0],
            depth,
        }
    }

    #[test]
    fn the_nearest_in_space_tells() {
        let scouts = [(100.0, 1.0, 5.0), (110.0, 3.0, -2.0), (300.0, 0.0, 9.0)];
        let scouts = scouts.map(|(x, depth, off)| Scout {
            place: at(x, depth),
            off: [off, 0.0],
        });
        let off = |x, depth| off_near(&scouts, &at(x, depth), 500.0)[0];
        // Somebody at 1 m stands before a wall at 3 m: what is nearer in the image is not what moves alike.
        assert_eq!((off(108.0, 1.1), off(102.0, 2.9)), (5.0, -2.0));
        // Where one of both has no depth, the image decides.
        assert_eq!((off(104.0, 0.0), off(106.0, 0.0)), (5.0, -2.0));
        assert_eq!(off(290.0, 1.0), 9.0);
        assert_eq!(off_near(&[], &at(1.0, 1.0), 500.0), [0.0; 2]);
    }
}

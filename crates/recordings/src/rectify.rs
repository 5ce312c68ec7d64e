//! Rectifies images by a lookup table.

use crate::decode::Colour;
use crate::optics::Optics;
use std::sync::Arc;
use stillpoint_geometry::Vec2;
use stillpoint_imaging::{ColourImage, DepthImage, GrayImage};

/// Source position of each output pixel, px; NaN outside of the image.
#[derive(Debug)]
pub(crate) struct Rectifier {
    width: usize,
    height: usize,
    places: Vec<[f32; 2]>,
}

impl Rectifier {
    pub(crate) fn new(optics: &Optics) -> Self {
        let (width, height) = (optics.width as usize, optics.height as usize);
        let [fx, fy, cx, cy] = optics.k;
        let place = |i: usize| {
            let (u, v) = ((i % width) as f64, (i / width) as f64);
            let p = optics.project(Vec2::new((u - cx) / fx, (v - cy) / fy));
            let inside =
                p.x >= 0.0 && p.y >= 0.0 && p.x <= (width - 1) as f64 && p.y <= (height - 1) as f64;
            if inside {
                [p.x as f32, p.y as f32]
            } else {
                [f32::NAN; 2]
            }
        };
        let places = (0..width * height).map(place).collect();
        Self {
            width,
            height,
            places,
        }
    }

    /// Colour and grey are interpolated; black outside of the image.
    pub(crate) fn colour(&self, image: Colour) -> Colour {
        let gray = self.interpolate::<1>(image.gray.data());
        let gray = GrayImage::from_vec(self.width, self.height, gray).unwrap_or(image.gray);
        let colour = image.colour.map(|c| {
            let data = self.interpolate::<3>(c.data());
            ColourImage::from_vec(self.width, self.height, data).map_or(c, Arc::new)
        });
        Colour { gray, colour }
    }

    fn interpolate<const N: usize>(&self, data: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(N * self.places.len());
        for [x, y] in &self.places {
            if x.is_nan() {
                out.extend([0; N]);
                continue;
            }
            let (x0, y0) = (*x as usize, *y as usize);
            let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
            let (a, b) = (x - x0 as f32, y - y0 as f32);
            let at = |x: usize, y: usize, c: usize| f32::from(data[N * (y * self.width + x) + c]);
            out.extend(std::array::from_fn::<u8, N, _>(|c| {
                let above = at(x0, y0, c) * (1.0 - a) + at(x1, y0, c) * a;
                let below = at(x0, y1, c) * (1.0 - a) + at(x1, y1, c) * a;
                (above * (1.0 - b) + below * b + 0.5) as u8
            }));
        }
        out
    }

    /// Depth uses the nearest pixel, since interpolation between two surfaces would be wrong.
    pub(crate) fn depth(&self, image: &DepthImage) -> Option<DepthImage> {
        let nearest = |[x, y]: &[f32; 2]| {
            if x.is_nan() {
                0.0
            } else {
                image.at((x + 0.5) as usize, (y + 0.5) as usize)
            }
        };
        let data = self.places.iter().map(nearest).collect();
        DepthImage::from_vec(self.width, self.height, data).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Lens;

    #[test]
    fn rectification_straightens_lines() {
        let optics = Optics {
            width: 160,
            height: 120,
            k: [150.0, 150.0, 80.0, 60.0],
            lens: Lens::Equidistant([-0.02, 0.01, 0.0, 0.0]),
        };
        // The distorted view of a wall whose right half, from x = 0.3 z on, is white and farther away.
        let mut gray = GrayImage::new(160, 120);
        let mut depth = vec![1.0; 160 * 120];
        for y in 0..120 {
            for x in 0..160 {
                if optics.ray(Vec2::new(x as f64, y as f64)).x > 0.3 {
                    gray.data_mut()[y * 160 + x] = 200;
                    depth[y * 160 + x] = 2.0;
                }
            }
        }
        let rectifier = Rectifier::new(&optics);
        let image = Colour { gray, colour: None };
        let edge = |g: &GrayImage, y: usize| (0..160).position(|x| g.at(x, y) > 100).unwrap();
        let bent = edge(&image.gray, 5).abs_diff(edge(&image.gray, 60));
        assert!(bent >= 2, "the control is bent: {bent} px");
        let depth = DepthImage::from_vec(160, 120, depth).unwrap();
        let depth = rectifier.depth(&depth).unwrap();
        let found = rectifier.colour(image);
        for y in [5, 30, 60, 90, 115] {
            assert!(edge(&found.gray, y).abs_diff(125) <= 1, "row {y}");
            assert_eq!((depth.at(123, y), depth.at(128, y)), (1.0, 2.0), "row {y}");
        }
    }
}

//! Depth images brought into the colour camera.

use crate::optics::Optics;
use stillpoint_geometry::{Se3, Vec2, Vec3};
use stillpoint_imaging::DepthImage;

/// Brings depth images of one camera into another. Each pixel is a square patch at its depth: two opposite corners of it are projected, what lies
/// between them is filled, and the nearest surface wins. So no holes open where the colour camera has more pixels.
#[derive(Debug)]
pub(crate) struct Registration {
    depth_size: (usize, usize),
    size: (usize, usize),
    /// Directions to the corners of the depth camera's pixels, turned into the colour camera: one row and column more than it has pixels.
    corners: Vec<[f32; 3]>,
    /// From the depth camera's centre, m.
    translation: [f32; 3],
    target: Optics,
}

impl Registration {
    pub(crate) fn new(depth: &Optics, colour: &Optics, colour_from_depth: &Se3) -> Self {
        let (width, height) = (depth.width as usize, depth.height as usize);
        let rotation = colour_from_depth.rotation_matrix();
        let corner = |i: usize| {
            let (x, y) = (i % (width + 1), i / (width + 1));
            let ray = depth.ray(Vec2::new(x as f64 - 0.5, y as f64 - 0.5));
            let turned = rotation * Vec3::new(ray.x, ray.y, 1.0);
            [turned.x as f32, turned.y as f32, turned.z as f32]
        };
        let t = colour_from_depth.translation;
        Self {
            depth_size: (width, height),
            size: (colour.width as usize, colour.height as usize),
            corners: (0..(width + 1) * (height + 1)).map(corner).collect(),
            translation: [t.x as f32, t.y as f32, t.z as f32],
            target: *colour,
        }
    }

    /// Width and height of the images that are registered.
    pub(crate) fn depth_size(&self) -> (usize, usize) {
        self.depth_size
    }

    /// The depth image in the colour camera; `None` for one of another size.
    pub(crate) fn register(&self, depth: &DepthImage) -> Option<DepthImage> {
        let (width, height) = self.depth_size;
        if (depth.width(), depth.height()) != (width, height) {
            return None;
        }
        let mut out = vec![f32::INFINITY; self.size.0 * self.size.1];
        for (y, row) in depth.data().chunks_exact(width).enumerate() {
            for (x, &z) in row.iter().enumerate() {
                if z > 0.0 {
                    let first = y * (width + 1) + x;
                    self.splat(first, z, &mut out);
                }
            }
        }
        // What nothing was seen at is infinite, which the image takes for none.
        DepthImage::from_vec(self.size.0, self.size.1, out).ok()
    }

    /// A pixel whose upper left corner is `first`, at depth `z`, m.
    #[inline]
    fn splat(&self, first: usize, z: f32, out: &mut [f32]) {
        let (width, _) = self.depth_size;
        let Some((a, _)) = self.pixel(first, z) else {
            return;
        };
        let Some((b, _)) = self.pixel(first + width + 2, z) else {
            return;
        };
        // The patch has the depth of its middle.
        let (upper, lower) = (self.corners[first][2], self.corners[first + width + 2][2]);
        let depth = z * 0.5 * (upper + lower) + self.translation[2];
        let (x0, x1) = (a[0].min(b[0]), a[0].max(b[0]));
        let (y0, y1) = (a[1].min(b[1]), a[1].max(b[1]));
        let (w, h) = (self.size.0 as i32, self.size.1 as i32);
        if x0 < 0 || y0 < 0 || x1 >= w || y1 >= h {
            return;
        }
        for y in y0..=y1 {
            let row = (y * w) as usize;
            for cell in &mut out[row + x0 as usize..=row + x1 as usize] {
                *cell = cell.min(depth);
            }
        }
    }

    /// The pixel that a corner is in, when it is before the camera.
    #[inline]
    fn pixel(&self, corner: usize, z: f32) -> Option<([i32; 2], f32)> {
        let ([a, b, c], [tx, ty, tz]) = (self.corners[corner], self.translation);
        let depth = c * z + tz;
        if depth <= 0.0 {
            return None;
        }
        let ray = Vec2::new(
            f64::from((a * z + tx) / depth),
            f64::from((b * z + ty) / depth),
        );
        let px = self.target.project(ray);
        // Saturates for what is far outside.
        Some((
            [(px.x + 0.5).floor() as i32, (px.y + 0.5).floor() as i32],
            depth,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Lens;
    use stillpoint_geometry::{BrownConrady, so3};

    fn optics(width: u32, height: u32, k: [f64; 4]) -> Optics {
        let lens = Lens::Brown(BrownConrady::default());
        Optics {
            width,
            height,
            k,
            lens,
        }
    }

    #[test]
    fn a_plane_is_where_the_colour_camera_sees_it() {
        let depth = optics(64, 48, [60.0, 60.0, 31.5, 23.5]);
        let colour = optics(96, 72, [90.0, 91.0, 48.0, 35.0]);
        let pose = Se3::new(
            so3::exp(&Vec3::new(0.01, -0.02, 0.03)),
            Vec3::new(0.05, 0.01, 0.02),
        );
        // The plane n p = d in the depth camera.
        let (n, d) = (Vec3::new(0.3, 0.1, 1.0), 2.0);
        let z = |x: usize, y: usize| {
            let r = depth.ray(Vec2::new(x as f64, y as f64));
            (d / n.dot(&Vec3::new(r.x, r.y, 1.0))) as f32
        };
        let data = (0..48)
            .flat_map(|y| (0..64).map(move |x| (x, y)))
            .map(|(x, y)| z(x, y));
        let image = DepthImage::from_vec(64, 48, data.collect()).unwrap();
        let found = Registration::new(&depth, &colour, &pose)
            .register(&image)
            .unwrap();
        let (m, e) = (
            pose.rotation * n,
            d + (pose.rotation * n).dot(&pose.translation),
        );
        let mut holes = 0;
        for y in 10..62 {
            for x in 12..84 {
                let r = colour.ray(Vec2::new(x as f64, y as f64));
                let expected = e / m.dot(&Vec3::new(r.x, r.y, 1.0));
                match found.at(x, y) {
                    0.0 => holes += 1,
                    z => assert!(
                        (f64::from(z) - expected).abs() < 0.02,
                        "{x} {y}: {z} {expected}"
                    ),
                }
            }
        }
        assert_eq!(holes, 0);
    }

    #[test]
    fn the_nearer_surface_wins() {
        let camera = optics(8, 6, [10.0, 10.0, 3.5, 2.5]);
        let mut data = vec![4.0; 48];
        data[2 * 8 + 5] = 1.0;
        let image = DepthImage::from_vec(8, 6, data).unwrap();
        let pose = Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(-0.2, 0.0, 0.0));
        let found = Registration::new(&camera, &camera, &pose)
            .register(&image)
            .unwrap();
        // Two pixels to the left at 1 m, half a pixel at 4 m.
        assert_eq!(found.at(3, 2), 1.0);
        let other = DepthImage::from_vec(6, 8, vec![1.0; 48]).unwrap();
        assert!(
            Registration::new(&camera, &camera, &pose)
                .register(&other)
                .is_none()
        );
    }
}

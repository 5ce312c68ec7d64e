//! Registers depth images to the colour camera.

use crate::optics::{Lens, Optics};
use stillpoint_geometry::{Se3, Vec2, Vec3};
use stillpoint_imaging::DepthImage;

/// Registers depth images of one camera to another. Each pixel is a square patch at its depth: two opposite corners are projected, the area
/// between them is filled, and the nearest surface wins. This leaves no holes where the colour camera has more pixels.
#[derive(Debug)]
pub(crate) struct Registration {
    depth_size: (usize, usize),
    size: (usize, usize),
    /// Rays through the corners of the depth camera's pixels, rotated to the colour camera: x, y and z, one row and column more than it has
    /// pixels.
    corners: [Vec<f32>; 3],
    /// From the depth camera's centre, m.
    translation: [f32; 3],
    target: Target,
}

/// The colour camera in single precision, which suffices for a thousandth of a pixel.
#[derive(Clone, Copy, Debug)]
struct Target {
    /// fx, fy, cx, cy, px.
    k: [f32; 4],
    /// k1, k2, k3, p1, p2; `None` without distortion.
    lens: Option<[f32; 5]>,
}

/// Maximum reprojection error of a pixel's ray, px: far above that of a converged inverse.
const MAX_ERROR: f64 = 1e-2;

/// Projected patches of a row of depth pixels: the pixels of their two corners, and their depth, m.
#[derive(Clone, Debug, Default)]
struct Patches {
    from: [Vec<i32>; 2],
    to: [Vec<i32>; 2],
    depth: Vec<f32>,
}

impl Target {
    fn new(optics: &Optics) -> Self {
        // Images of any other lens are rectified first.
        let lens = match optics.lens {
            Lens::Brown(b) if !b.is_zero() => Some([b.k1, b.k2, b.k3, b.p1, b.p2]),
            _ => None,
        };
        Self {
            k: optics.k.map(|v| v as f32),
            lens: lens.map(|l| l.map(|v| v as f32)),
        }
    }

    /// The pixel of the point (x, y, 1), column and row.
    #[inline(always)]
    fn pixel<const DISTORTS: bool>(
        &self,
        [k1, k2, k3, p1, p2]: [f32; 5],
        [x, y]: [f32; 2],
    ) -> [i32; 2] {
        let [fx, fy, cx, cy] = self.k;
        let (mut u, mut v) = (x, y);
        if DISTORTS {
            let (r2, xy) = (x * x + y * y, x * y);
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            u = x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * x * x);
            v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * xy;
        }
        [nearest(fx * u + cx), nearest(fy * v + cy)]
    }
}

/// The nearest integer; far outside of every image for large values and NaN. Vectorises, unlike a cast: floats from 2^23 on are integers,
/// whose mantissas hold them.
#[inline(always)]
fn nearest(v: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    let within = if v > -1e6 { v } else { -1e6 };
    let within = if within < 1e6 { within } else { 1e6 };
    (within + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}

impl Registration {
    pub(crate) fn new(depth: &Optics, colour: &Optics, colour_from_depth: &Se3) -> Self {
        let (width, height) = (depth.width as usize, depth.height as usize);
        let rotation = colour_from_depth.rotation_matrix();
        let mut corners: [Vec<f32>; 3] = Default::default();
        for i in 0..(width + 1) * (height + 1) {
            let (x, y) = (i % (width + 1), i / (width + 1));
            let px = Vec2::new(x as f64 - 0.5, y as f64 - 0.5);
            let mut ray = depth.ray(px);
            // Corners of a fisheye image may correspond to no ray; depth there is dropped.
            if (depth.project(ray) - px).norm() > MAX_ERROR {
                ray = Vec2::new(f64::NAN, f64::NAN);
            }
            let turned = rotation * Vec3::new(ray.x, ray.y, 1.0);
            for (list, value) in corners.iter_mut().zip(turned.iter()) {
                list.push(*value as f32);
            }
        }
        let t = colour_from_depth.translation;
        Self {
            depth_size: (width, height),
            size: (colour.width as usize, colour.height as usize),
            corners,
            translation: [t.x as f32, t.y as f32, t.z as f32],
            target: Target::new(colour),
        }
    }

    pub(crate) fn depth_size(&self) -> (usize, usize) {
        self.depth_size
    }

    /// The registered depth image; `None` for an input of another size.
    pub(crate) fn register(&self, depth: &DepthImage) -> Option<DepthImage> {
        let (width, height) = self.depth_size;
        if (depth.width(), depth.height()) != (width, height) {
            return None;
        }
        let mut out = vec![f32::INFINITY; self.size.0 * self.size.1];
        let mut patches = Patches::new(width);
        for (y, row) in depth.data().chunks_exact(width).enumerate() {
            match self.target.lens {
                Some(lens) => self.project::<true>(lens, y, row, &mut patches),
                None => self.project::<false>([0.0; 5], y, row, &mut patches),
            }
            self.splat(&patches, &mut out);
        }
        // Pixels without depth are infinite, which the image converts to no measurement.
        DepthImage::from_vec(self.size.0, self.size.1, out).ok()
    }

    /// Projects the patches of row `y`. A missing patch gets a corner left of the image.
    fn project<const DISTORTS: bool>(
        &self,
        lens: [f32; 5],
        y: usize,
        row: &[f32],
        patches: &mut Patches,
    ) {
        let width = row.len();
        let first = y * (width + 1);
        let below = first + width + 2;
        let [x, y, z] = &self.corners;
        let [tx, ty, tz] = self.translation;
        let [x0, y0] = &mut patches.from;
        let [x1, y1] = &mut patches.to;
        let (x0, y0) = (&mut x0[..width], &mut y0[..width]);
        let (x1, y1) = (&mut x1[..width], &mut y1[..width]);
        let depth = &mut patches.depth[..width];
        // Slices of equal length remove bounds checks from the loop.
        let (ax, bx) = (&x[first..first + width], &x[below..below + width]);
        let (ay, by) = (&y[first..first + width], &y[below..below + width]);
        let (az, bz) = (&z[first..first + width], &z[below..below + width]);
        for i in 0..width {
            let z = row[i];
            let a = [ax[i] * z + tx, ay[i] * z + ty, az[i] * z + tz];
            let b = [bx[i] * z + tx, by[i] * z + ty, bz[i] * z + tz];
            // One division for both.
            let inverse = 1.0 / (a[2] * b[2]);
            let (wa, wb) = (inverse * b[2], inverse * a[2]);
            let from = self.target.pixel::<DISTORTS>(lens, [a[0] * wa, a[1] * wa]);
            let to = self.target.pixel::<DISTORTS>(lens, [b[0] * wb, b[1] * wb]);
            let there = (z > 0.0) & (a[2] > 0.0) & (b[2] > 0.0);
            x0[i] = if there { from[0].min(to[0]) } else { -1 };
            x1[i] = from[0].max(to[0]);
            y0[i] = from[1].min(to[1]);
            y1[i] = from[1].max(to[1]);
            // The patch has the depth of its centre.
            depth[i] = 0.5 * (a[2] + b[2]);
        }
    }

    fn splat(&self, patches: &Patches, out: &mut [f32]) {
        let (w, h) = (self.size.0 as i32, self.size.1 as i32);
        let [x0, y0] = &patches.from;
        let [x1, y1] = &patches.to;
        let corners = x0.iter().zip(y0).zip(x1.iter().zip(y1));
        for (((&x0, &y0), (&x1, &y1)), &depth) in corners.zip(&patches.depth) {
            if x0 < 0 || y0 < 0 || x1 >= w || y1 >= h {
                continue;
            }
            for y in y0..=y1 {
                let row = (y * w) as usize;
                for cell in &mut out[row + x0 as usize..=row + x1 as usize] {
                    *cell = if depth < *cell { depth } else { *cell };
                }
            }
        }
    }
}

impl Patches {
    fn new(width: usize) -> Self {
        let list = || vec![0; width];
        Self {
            from: [list(), list()],
            to: [list(), list()],
            depth: vec![0.0; width],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::so3;

    fn optics(width: u32, height: u32, k: [f64; 4]) -> Optics {
        let lens = Lens::Brown(stillpoint_geometry::BrownConrady::default());
        Optics {
            width,
            height,
            k,
            lens,
        }
    }

    #[test]
    fn registered_plane_matches_the_colour_camera() {
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
    fn coordinates_round_to_the_nearest_pixel() {
        for (v, expected) in [(0.4, 0), (0.6, 1), (-0.4, 0), (-0.6, -1), (639.7, 640)] {
            assert_eq!(nearest(v), expected, "{v}");
        }
        for far in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e20] {
            assert!(nearest(far).abs() >= 1_000_000, "{far}");
        }
    }

    #[test]
    fn nearer_surface_wins() {
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

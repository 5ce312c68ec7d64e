//! A grid of image cells with one depth each: their rays, and projection of points into them.

use crate::sensor::DepthNoise;
use std::array::from_fn;
use stillpoint_geometry::{Camera, Vec2};
use stillpoint_imaging::CoarseDepth;

/// Side of a cell, px. Chosen: 3 cm at 2 m in 640x480, so that a hand is more than a cell.
pub(super) const CELL_PX: usize = 8;
/// Step of the table from undistorted pixels to cells, px: half of a cell (`CELL_PX`).
const TABLE_STEP: f32 = 4.0;
/// Index for points outside the raw image.
pub(super) const NONE: u16 = u16::MAX;

/// Extent of the table beyond each side of the raw image, in image widths and heights. A lens whose undistorted image
/// is wider sees its border at over 70 degrees (2.5 widths aside, at a Kinect's focal length of 0.82 widths); points
/// there are in no cell. Chosen: it bounds the size of the table.
const TABLE_REACH: f64 = 2.0;

/// The rectangle of undistorted pixels that the table covers: min x, min y, max x, max y.
fn table_bounds(camera: &Camera) -> [f64; 4] {
    let [x0, y0, x1, y1] = camera.undistorted_bounds();
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    [
        x0.max(-TABLE_REACH * w),
        y0.max(-TABLE_REACH * h),
        x1.min((1.0 + TABLE_REACH) * w),
        y1.min((1.0 + TABLE_REACH) * h),
    ]
}

/// Rays of all cells of a camera, and a lookup table from undistorted pixels to cells.
#[derive(Clone)]
pub(super) struct Cells {
    pub(super) width: usize,
    pub(super) height: usize,
    /// (x/z, y/z) of the centre of each cell, row by row.
    rays: Vec<[f32; 2]>,
    /// Pinhole: fx, fy, cx, cy.
    pinhole: [f32; 4],
    /// Cell at each grid point of undistorted pixels.
    table: Vec<u16>,
    /// Likewise without the border cells of the image. Both tables end with an entry for points outside.
    inner_table: Vec<u16>,
    table_origin: [f32; 2],
    table_size: [usize; 2],
    /// Whether a cell has all eight neighbours.
    is_inner: Vec<bool>,
    noise: DepthNoise,
}

impl Cells {
    pub(super) fn new(camera: &Camera, noise: DepthNoise) -> Self {
        let (width, height) = (
            camera.width as usize / CELL_PX,
            camera.height as usize / CELL_PX,
        );
        let size = CELL_PX as f64;
        let middle = |i: usize| (i as f64 + 0.5) * size - 0.5;
        let mut rays = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let ray = camera.ray(camera.undistort(Vec2::new(middle(x), middle(y))));
                rays.push([ray.x as f32, ray.y as f32]);
            }
        }
        let [x0, y0, x1, y1] = table_bounds(camera);
        let step = f64::from(TABLE_STEP);
        let table_size = [x1 - x0, y1 - y0].map(|d| (d / step) as usize + 1);
        let mut table = Vec::with_capacity(table_size[0] * table_size[1]);
        for j in 0..table_size[1] {
            for i in 0..table_size[0] {
                let px = Vec2::new(x0 + (i as f64 + 0.5) * step, y0 + (j as f64 + 0.5) * step);
                let raw = camera.distort(px);
                // A distortion model folds back far outside the image: only points that undistort to themselves count.
                let back = camera.undistort(raw);
                let (u, v) = ((raw.x + 0.5) / size, (raw.y + 0.5) / size);
                let inside = u >= 0.0
                    && v >= 0.0
                    && u < width as f64
                    && v < height as f64
                    && (back - px).norm() < 1.0;
                table.push(if inside {
                    (v as usize * width + u as usize) as u16
                } else {
                    NONE
                });
            }
        }
        let is_inner = |cell: usize| {
            let (x, y) = (cell % width, cell / width);
            x > 0 && y > 0 && x + 1 < width && y + 1 < height
        };
        let inner = |cell: &u16| {
            let keep = *cell != NONE && is_inner(usize::from(*cell));
            if keep { *cell } else { NONE }
        };
        table.push(NONE);
        Self {
            width,
            height,
            inner_table: table.iter().map(inner).collect(),
            rays,
            pinhole: [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32),
            table,
            table_origin: [x0 as f32, y0 as f32],
            table_size,
            is_inner: (0..width * height).map(is_inner).collect(),
            noise,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.width * self.height
    }

    /// (x/z, y/z) of the centre of each cell, row by row.
    pub(super) fn rays(&self) -> &[[f32; 2]] {
        &self.rays
    }

    /// The cell of a point in camera coordinates.
    #[cfg(test)]
    pub(super) fn project(&self, p: [f32; 3]) -> Option<usize> {
        let [entry] = self.entries(&p.map(|v| [v]));
        let cell = self.table[entry as usize];
        (cell != NONE).then_some(usize::from(cell))
    }

    pub(super) fn all(&self) -> &[u16] {
        &self.table
    }

    /// Table of the cells with all eight neighbours.
    pub(super) fn inner(&self) -> &[u16] {
        &self.inner_table
    }

    /// Table indices of points in camera coordinates; the last index for points behind the camera or outside.
    #[inline(always)]
    pub(super) fn entries<const L: usize>(&self, [x, y, z]: &[[f32; L]; 3]) -> [u32; L] {
        let [fx, fy, cx, cy] = self.pinhole;
        let [x0, y0] = self.table_origin;
        let [width, height] = self.table_size.map(|n| n as f32);
        let i: [f32; L] = from_fn(|l| (fx * x[l] / z[l] + cx - x0) / TABLE_STEP);
        let j: [f32; L] = from_fn(|l| (fy * y[l] / z[l] + cy - y0) / TABLE_STEP);
        let is_inside: [bool; L] = from_fn(|l| {
            (z[l] > 0.05) & (i[l] >= 0.0) & (j[l] >= 0.0) & (i[l] < width) & (j[l] < height)
        });
        // Signed 32 bits suffice, and convert fastest.
        let column: [i32; L] = from_fn(|l| (if is_inside[l] { i[l] } else { 0.0 }) as i32);
        let row: [i32; L] = from_fn(|l| (if is_inside[l] { j[l] } else { 0.0 }) as i32);
        let (stride, beside) = (self.table_size[0] as u32, self.table.len() as u32 - 1);
        from_fn(|l| {
            let entry = row[l] as u32 * stride + column[l] as u32;
            if is_inside[l] { entry } else { beside }
        })
    }

    /// The cell at a raw pixel; pixels in an incomplete cell at the border go to the last one.
    pub(super) fn at(&self, u: f32, v: f32) -> usize {
        let size = CELL_PX as f32;
        let x = (((u + 0.5) / size).max(0.0) as usize).min(self.width.saturating_sub(1));
        let y = (((v + 0.5) / size).max(0.0) as usize).min(self.height.saturating_sub(1));
        y * self.width + x
    }

    /// Tolerance between two depths of one surface beyond its own slope, m: sensor noise at four sigma, calibration,
    /// and the error of a predicted pose.
    #[inline]
    pub(super) fn depth_tolerance(&self, z: f32) -> f32 {
        0.03 + 0.01 * z + 4.0 * self.noise.sigma_f32(z)
    }

    /// Calls `f` for the existing cells among the 3x3 around a cell, row by row.
    #[inline]
    pub(super) fn for_each_around(&self, cell: usize, mut f: impl FnMut(usize)) {
        if self.is_inner[cell] {
            for row in [cell - self.width, cell, cell + self.width] {
                f(row - 1);
                f(row);
                f(row + 1);
            }
            return;
        }
        let (x, y) = (cell % self.width, cell / self.width);
        for row in y.saturating_sub(1)..(y + 2).min(self.height) {
            for column in x.saturating_sub(1)..(x + 2).min(self.width) {
                f(row * self.width + column);
            }
        }
    }
}

pub(super) fn coarse(depth: &stillpoint_imaging::DepthImage) -> CoarseDepth {
    CoarseDepth::new(depth, CELL_PX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::{BrownConrady, Vec3};

    /// The strongly distorting lens of a Kinect's colour camera.
    fn bent() -> Camera {
        Camera {
            distortion: BrownConrady {
                k1: 0.2624,
                k2: -0.9531,
                p1: -0.0054,
                p2: 0.0026,
                k3: 1.1633,
            },
            ..Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3])
        }
    }

    fn straight() -> Camera {
        Camera::pinhole(640, 480, [535.0, 535.0, 319.5, 239.5])
    }

    /// Distance of a raw pixel outside a cell, px.
    fn outside(cells: &Cells, cell: usize, raw: Vec2) -> f64 {
        let corner = |i: usize| (i * CELL_PX) as f64 - 0.5;
        let off = |v: f64, i: usize| (corner(i) - v).max(v - corner(i + 1)).max(0.0);
        let (x, y) = (cell % cells.width, cell / cells.width);
        off(raw.x, x).max(off(raw.y, y))
    }

    #[test]
    fn projection_table_agrees_with_the_camera_model() {
        for camera in [straight(), bent()] {
            let cells = Cells::new(&camera, DepthNoise::default());
            let mut seen = 0;
            for (i, j, k) in (0..90).flat_map(|i| (0..70).flat_map(move |j| [(i, j, 1), (i, j, 4)]))
            {
                let z = f64::from(k);
                let ray = [f64::from(i) / 45.0 - 1.0, f64::from(j) / 35.0 - 1.0];
                let p = Vec3::new(0.62 * ray[0] * z, 0.5 * ray[1] * z, z);
                let raw = camera.project_distorted(&p);
                let found = cells.project([p.x, p.y, p.z].map(|v| v as f32));
                // Half a step of the table both ways, stretched by the lens.
                if let Some(cell) = found {
                    assert!(outside(&cells, cell, raw) < 3.0, "{raw:?} in cell {cell}");
                    seen += 1;
                }
                let (u, v) = (raw.x.min(639.0 - raw.x), raw.y.min(479.0 - raw.y));
                let back = (camera.undistort(raw) - camera.project(&p)).norm() < 0.1;
                assert!(found.is_some() || u.min(v) < 4.0 || !back, "{raw:?} lost");
                assert!(found.is_none() || u.min(v) > -4.0, "{raw:?} is outside");
            }
            assert!(seen > 5000, "{seen}");
        }
    }

    #[test]
    fn table_size_is_bounded_for_any_lens() {
        let forgotten = BrownConrady {
            k3: 0.0,
            ..bent().distortion
        };
        let lens = |k1, k2, k3| BrownConrady {
            k1,
            k2,
            k3,
            ..BrownConrady::default()
        };
        let far = [
            lens(-0.5, 0.0, 0.0),
            lens(1e100, 0.0, 0.0),
            lens(0.0, 0.0, -1e300),
            lens(f64::NAN, 0.0, 0.0),
        ];
        for distortion in far.into_iter().chain([forgotten]) {
            let camera = Camera {
                distortion,
                ..bent()
            };
            let [x0, y0, x1, y1] = table_bounds(&camera);
            let inside = x0 >= -1280.0 && y0 >= -960.0 && x1 <= 1920.0 && y1 <= 1440.0;
            assert!(inside, "{distortion:?}: {x0} {y0} {x1} {y1}");
        }
        let endless = Camera {
            distortion: lens(1e100, 0.0, 0.0),
            ..bent()
        };
        assert!(Cells::new(&endless, DepthNoise::default()).table.len() < 1_000_000);
    }

    #[test]
    fn lens_distortion_changes_the_projection() {
        // Ensures that the lens model has an effect in the test above.
        let (bent, straight) = (bent(), bent().rectified());
        let p = Vec3::new(-0.55, -0.42, 1.0);
        let gap = (bent.project_distorted(&p) - straight.project(&p)).norm();
        assert!(gap > 8.0, "{gap} px");
    }

    #[test]
    fn cell_ray_projects_back_into_its_cell() {
        for camera in [straight(), bent()] {
            let cells = Cells::new(&camera, DepthNoise::default());
            assert_eq!(cells.rays().len(), cells.count());
            for (cell, [x, y]) in cells.rays().iter().enumerate() {
                for z in [0.4, 1.0, 5.0] {
                    assert_eq!(cells.project([x * z, y * z, z]), Some(cell));
                }
            }
        }
    }

    #[test]
    fn points_outside_the_view_have_no_cell() {
        let cells = Cells::new(&bent(), DepthNoise::default());
        for p in [[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.04]] {
            assert_eq!(cells.project(p), None);
        }
        for x in [-50.0, -3.0, -1.5, 1.5, 3.0, 50.0] {
            assert_eq!(cells.project([x, 0.0, 1.0]), None);
            assert_eq!(cells.project([0.0, x, 1.0]), None);
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(cells.project([bad, 0.0, 1.0]), None);
            assert_eq!(
                cells.project([0.0, 0.0, bad]).filter(|_| bad.is_nan()),
                None
            );
        }
    }

    #[test]
    fn partial_border_cells_belong_to_the_last_cell() {
        let cells = Cells::new(
            &Camera::pinhole(44, 29, [40.0, 40.0, 21.5, 14.0]),
            DepthNoise::default(),
        );
        assert_eq!((cells.width, cells.height), (5, 3));
        assert_eq!(cells.at(-0.5, -0.5), 0);
        assert_eq!((cells.at(7.4, 0.0), cells.at(7.6, 0.0)), (0, 1));
        assert_eq!(cells.at(0.0, 7.6), 5);
        assert_eq!(cells.at(43.0, 28.0), 14);
        let around = |cell| {
            let mut found = Vec::new();
            cells.for_each_around(cell, |c| found.push(c));
            found
        };
        assert_eq!(around(0), [0, 1, 5, 6]);
        assert_eq!(around(7), [1, 2, 3, 6, 7, 8, 11, 12, 13]);
        assert_eq!(around(14), [8, 9, 13, 14]);
        let inner = |cell: &usize| {
            let [x, y] = cells.rays()[*cell];
            let [entry] = cells.entries(&[[x], [y], [1.0]]);
            usize::from(cells.inner()[entry as usize]) == *cell
        };
        let inner: Vec<usize> = (0..15).filter(inner).collect();
        assert_eq!(inner, [6, 7, 8]);
    }
}

//! The image as cells with one depth each: their rays, and where points fall among them.

use stillpoint_geometry::{Camera, Vec2};
use stillpoint_imaging::CoarseDepth;

/// Side of a cell, px.
pub(super) const CELL_PX: usize = 8;
/// Step of the table from undistorted pixels to cells, px: half a cell.
const TABLE_STEP: f32 = 4.0;
/// No cell: outside the raw image.
const NONE: u16 = u16::MAX;

/// Rays of all cells of a camera, and the table back from undistorted pixels to cells.
pub(super) struct Cells {
    pub(super) width: usize,
    pub(super) height: usize,
    /// (x/z, y/z) of the middle of each cell, row by row.
    rays: Vec<[f32; 2]>,
    /// Pinhole: fx, fy, cx, cy.
    pinhole: [f32; 4],
    /// Cell at each point of the table's grid over undistorted pixels.
    table: Vec<u16>,
    table_origin: [f32; 2],
    table_size: [usize; 2],
}

impl Cells {
    pub(super) fn new(camera: &Camera) -> Self {
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
        let [x0, y0, x1, y1] = camera.undistorted_bounds();
        let step = f64::from(TABLE_STEP);
        let table_size = [x1 - x0, y1 - y0].map(|d| (d / step) as usize + 1);
        let mut table = Vec::with_capacity(table_size[0] * table_size[1]);
        for j in 0..table_size[1] {
            for i in 0..table_size[0] {
                let px = Vec2::new(x0 + (i as f64 + 0.5) * step, y0 + (j as f64 + 0.5) * step);
                let raw = camera.distort(px);
                // A lens model bends back far outside the image: only points that undistort to where they came from count.
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
        Self {
            width,
            height,
            rays,
            pinhole: [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32),
            table,
            table_origin: [x0 as f32, y0 as f32],
            table_size,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.width * self.height
    }

    /// (x/z, y/z) of the middle of each cell, row by row.
    pub(super) fn rays(&self) -> &[[f32; 2]] {
        &self.rays
    }

    /// The cell in which a point in camera coordinates appears.
    pub(super) fn project(&self, [x, y, z]: [f32; 3]) -> Option<usize> {
        if z <= 0.05 {
            return None;
        }
        let [fx, fy, cx, cy] = self.pinhole;
        let i = (fx * x / z + cx - self.table_origin[0]) / TABLE_STEP;
        let j = (fy * y / z + cy - self.table_origin[1]) / TABLE_STEP;
        let [width, height] = self.table_size;
        if !(i >= 0.0 && j >= 0.0 && i < width as f32 && j < height as f32) {
            return None;
        }
        let cell = self.table[j as usize * width + i as usize];
        (cell != NONE).then_some(usize::from(cell))
    }

    /// Whether all eight neighbours of a cell exist.
    pub(super) fn has_neighbours(&self, cell: usize) -> bool {
        let (x, y) = (cell % self.width, cell / self.width);
        x > 0 && y > 0 && x + 1 < self.width && y + 1 < self.height
    }

    /// The cell at a raw pixel, the last one where a remainder of the image has none.
    pub(super) fn at(&self, u: f32, v: f32) -> usize {
        let size = CELL_PX as f32;
        let x = (((u + 0.5) / size).max(0.0) as usize).min(self.width.saturating_sub(1));
        let y = (((v + 0.5) / size).max(0.0) as usize).min(self.height.saturating_sub(1));
        y * self.width + x
    }

    /// The existing cells among the 3x3 (`reach` 1) or 5x5 (`reach` 2) ... around a cell.
    pub(super) fn around(&self, cell: usize, reach: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (cell % self.width, cell / self.width);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
        let width = self.width;
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}

/// How much two depths of one surface may differ beyond its own slope, m: sensor noise at four sigma, calibration, and
/// the pose's own error, which is that of a prediction.
pub(super) fn depth_tolerance(z: f32) -> f32 {
    let sensor = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    0.03 + 0.01 * z + 4.0 * sensor
}

/// The coarse depth of a frame.
pub(super) fn coarse(depth: &stillpoint_imaging::DepthImage) -> CoarseDepth {
    CoarseDepth::new(depth, CELL_PX)
}

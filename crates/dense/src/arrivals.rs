//! Surfaces that appear in formerly free space, such as a person who sat down or an object that was put there.
//!
//! Decides per patch of the image whether the surface is withheld from the map. Tracking uses it at once, as it stands still; the map lives
//! longer than a person sits, and takes it in only after it has been seen for some time.

use crate::cells::{Cells, Vec3i};
use crate::observation::{MOVER_PX, Observation, PER_METRE};
use crate::pixels::Pixels;
use crate::volume::Volume;
use stillpoint_geometry::{Camera, Se3, Vec3};

/// A patch of the image, `MOVER_PX` pixels wide, whose surface is withheld.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Piece {
    x: usize,
    y: usize,
    /// Depth at its centre, in units of the observation.
    depth: u16,
}

#[derive(Default)]
pub(crate) struct Arrivals {
    pieces: Vec<Piece>,
    cells: Vec<[i32; 3]>,
}

impl Arrivals {
    /// Finds surfaces in cells that were certainly free and where the volume has no surface.
    pub(crate) fn find(
        &mut self,
        seen: &Observation,
        camera: &Camera,
        pose: &Se3,
        volume: &Volume,
        cells: &Cells,
    ) {
        self.pieces.clear();
        self.cells.clear();
        let limit = volume.limit();
        for y in 0..seen.height / MOVER_PX {
            for x in 0..seen.width / MOVER_PX {
                let [u, v] = [x, y].map(|k| MOVER_PX * k + MOVER_PX / 2);
                let depth = seen.depth[v * seen.width + u];
                if depth == 0 || depth > limit {
                    continue;
                }
                let z = f64::from(depth) / f64::from(PER_METRE);
                let ray = [
                    (u as f64 - camera.cx) / camera.fx,
                    (v as f64 - camera.cy) / camera.fy,
                ];
                let p = pose.transform(&Vec3::new(ray[0] * z, ray[1] * z, z));
                let at = Vec3i::from_fn(|i, _| (p[i] / cells.side).floor() as i32).into();
                if cells.waits(at) && !volume.has_surface_at(&p) {
                    self.pieces.push(Piece { x, y, depth });
                    self.cells.push(at);
                }
            }
        }
        self.cells.sort_unstable();
        self.cells.dedup();
    }

    pub(crate) fn cells(&self) -> &[[i32; 3]] {
        &self.cells
    }

    /// Clears the surface weight of these pixels; the space before them stays free. Pixels around a patch are included where they have its
    /// depth.
    pub(crate) fn take_out(&self, width: usize, height: usize, pixels: &mut Pixels) {
        for piece in &self.pieces {
            let near = f32::from(piece.depth) * 0.03 + 0.05 * PER_METRE;
            let range = |k: usize, end: usize| {
                (MOVER_PX * k).saturating_sub(MOVER_PX)..(MOVER_PX * (k + 2)).min(end)
            };
            for y in range(piece.y, height) {
                for pixel in &mut pixels.pixels[y * width..][range(piece.x, width)] {
                    let off = (*pixel & 0xffff) as f32 - f32::from(piece.depth);
                    if off.abs() < near {
                        *pixel &= !(0xff << 16);
                    }
                }
            }
        }
    }
}

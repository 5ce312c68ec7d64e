//! The dense map: surface and coarse grid with their queries.

use crate::arrivals::Arrivals;
use crate::block::SIDE;
use crate::cells::Cells;
use crate::config::DenseConfig;
use crate::mesh::{Mesh, MeshOptions};
use crate::observation::Observation;
use crate::touch::Stand;
use crate::volume::Volume;
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::Simd;

/// Surface and coarse grid of the static scene.
pub struct DenseMap {
    pub(crate) volume: Volume,
    pub(crate) cells: Cells,
    max_depth: f64,
    /// Of the last frame, hundredths of a second.
    last_stamp: Option<f64>,
    arrivals: Arrivals,
}

/// Maximum time that one frame adds to the observation of a new surface, hundredths of a second.
const MOST_ELAPSED: f64 = 50.0;

/// Value of a cell of the coarse grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupancy {
    /// Contains a surface.
    Occupied,
    /// Cameras saw through it.
    Free,
    /// Unobserved.
    Unknown,
}

impl Clone for DenseMap {
    fn clone(&self) -> Self {
        Self {
            volume: self.volume.clone(),
            cells: self.cells.clone(),
            max_depth: self.max_depth,
            last_stamp: self.last_stamp,
            arrivals: Arrivals::default(),
        }
    }

    fn clone_from(&mut self, source: &Self) {
        self.volume.clone_from(&source.volume);
        self.cells.blocks.clone_from(&source.cells.blocks);
        self.cells.side = source.cells.side;
        self.max_depth = source.max_depth;
        self.last_stamp = source.last_stamp;
        self.arrivals = Arrivals::default();
    }
}

impl DenseMap {
    pub(crate) fn new(config: &DenseConfig, simd: Simd) -> Self {
        Self {
            volume: Volume::new(config, simd),
            cells: Cells::new(config.cell),
            max_depth: config.max_depth,
            last_stamp: None,
            arrivals: Arrivals::default(),
        }
    }

    pub(crate) fn emptied(&self) -> Self {
        let config = DenseConfig {
            voxel: self.volume.voxel,
            cell: self.cells.side,
            max_depth: self.max_depth,
            ..DenseConfig::default()
        };
        Self::new(&config, self.volume.simd)
    }

    pub(crate) fn integrate(&mut self, seen: &Observation, camera: &Camera, pose: &Se3) {
        if pose.is_finite() && seen.width > 0 && seen.height > 0 {
            let elapsed = self.elapsed(seen.depth_stamp);
            let Self {
                volume,
                cells,
                arrivals,
                ..
            } = self;
            arrivals.find(seen, camera, pose, volume, cells);
            cells.arrive(arrivals.cells(), elapsed);
            volume.integrate(seen, camera, pose, arrivals);
            let stand = Stand {
                camera,
                world_from_camera: pose,
                block: 0.0,
                truncation: 0.0,
            };
            let pixels = self.volume.pixels();
            self.cells.integrate(seen, pixels, &stand, self.max_depth);
        }
    }

    /// Hundredths of a second since the previous frame: a difference of rounded stamps, so that rounding does not accumulate.
    fn elapsed(&mut self, stamp: f64) -> u16 {
        let now = (stamp * 100.0).round();
        let last = self.last_stamp.replace(now);
        last.map_or(0.0, |last| (now - last).abs().min(MOST_ELAPSED)) as u16
    }

    /// The surface as triangles.
    #[must_use]
    pub fn mesh(&self, options: &MeshOptions) -> Mesh {
        self.volume.mesh(options)
    }

    /// The signed distance from a world point (m) to the nearest surface along the cameras' rays, m: positive before it, negative behind.
    /// `None` beyond the truncation, and where unobserved.
    #[must_use]
    pub fn distance(&self, p: &Vec3) -> Option<f64> {
        self.volume.distance(p)
    }

    /// The coarse grid's value at a world point (m).
    #[must_use]
    pub fn occupancy(&self, p: &Vec3) -> Occupancy {
        let at = p / self.cells.side;
        if !at.iter().all(|v| v.abs() < 1e8) {
            return Occupancy::Unknown;
        }
        self.cell(at.map(|v| v.floor() as i32).into())
    }

    /// Number of frames with a moving object in the cell of a world point (m).
    #[must_use]
    pub fn crossed(&self, p: &Vec3) -> u16 {
        let at = p / self.cells.side;
        if !at.iter().all(|v| v.abs() < 1e8) {
            return 0;
        }
        self.cells.counts(at.map(|v| v.floor() as i32).into())[1]
    }

    /// Side of a voxel, m.
    #[must_use]
    pub fn voxel(&self) -> f64 {
        self.volume.voxel
    }

    /// Side of a cell of the coarse grid, m.
    #[must_use]
    pub fn cell_side(&self) -> f64 {
        self.cells.side
    }

    /// Number of blocks of 8x8x8 voxels.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.volume.blocks.len()
    }

    /// Memory held, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.volume.bytes() + self.cells.bytes()
    }

    /// A hash of every bit of surface and grid.
    #[must_use]
    pub fn digest(&self) -> u64 {
        let mut f = self.volume.digest();
        for (key, number) in self.cells.blocks.sorted() {
            let b = self.cells.blocks.get(number);
            let keys = key.0.iter().map(|k| *k as u64);
            let counts = b.free.iter().chain(&b.crossed).chain(&b.arrived);
            let counts = counts.map(|c| u64::from(*c));
            for v in keys.chain(counts) {
                f = (f ^ v).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
            }
        }
        f
    }

    pub(crate) fn max_depth(&self) -> f64 {
        self.max_depth
    }

    /// Calls `f` once with every occupied or free cell, by its index along each axis, in the order of z, y, x.
    pub(crate) fn for_each_known(&self, mut f: impl FnMut([i32; 3], Occupancy)) {
        let mut known = Vec::new();
        self.cells.for_each(|at, free, _| {
            if free > 0 {
                known.push(([at.z, at.y, at.x], true));
            }
        });
        self.for_each_crossing(|p| {
            let [x, y, z] = self.cell_of(&p);
            known.push(([z, y, x], false));
        });
        // Occupied sorts before free, and the first entry of each cell counts.
        known.sort_unstable();
        known.dedup_by_key(|k| k.0);
        for ([z, y, x], free) in known {
            let occupancy = if free {
                Occupancy::Free
            } else {
                Occupancy::Occupied
            };
            f([x, y, z], occupancy);
        }
    }

    pub(crate) fn cells_with_surface(&self) -> Vec<[i32; 3]> {
        let mut cells = Vec::new();
        self.for_each_crossing(|p| cells.push(self.cell_of(&p)));
        cells
    }

    /// Calls `f` with each point (m) where the surface crosses the line between two voxels.
    fn for_each_crossing(&self, mut f: impl FnMut(Vec3)) {
        for (key, number) in self.volume.blocks.sorted() {
            let base = key.xyz().map(|k| k * SIDE as i32);
            let block = self.volume.blocks.get(number);
            for i in 0..block.distance.len() {
                let at = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
                let at = std::array::from_fn(|k| base[k] + at[k] as i32);
                if block.weight[i] > 0 {
                    (0..3)
                        .filter_map(|axis| self.crossing(at, axis))
                        .for_each(&mut f);
                }
            }
        }
    }

    fn crossing(&self, at: [i32; 3], axis: usize) -> Option<Vec3> {
        let known = |at: [i32; 3]| {
            let (d, w, c) = self.volume.voxel_at(at)?;
            (w > 0 && (d >= 0 || c >> 24 >= 2)).then_some(d)
        };
        let a = known(at)?;
        let mut next = at;
        next[axis] += 1;
        let b = known(next)?;
        if (a < 0) == (b < 0) {
            return None;
        }
        let way = f64::from(a) / (f64::from(a) - f64::from(b));
        let mut p = Vec3::from(at.map(f64::from));
        p[axis] += way;
        Some(p * self.volume.voxel)
    }

    fn cell_of(&self, p: &Vec3) -> [i32; 3] {
        (p / self.cells.side).map(|v| v.floor() as i32).into()
    }

    pub(crate) fn cell(&self, at: [i32; 3]) -> Occupancy {
        if self.has_surface(at) {
            Occupancy::Occupied
        } else if self.cells.counts(at)[0] > 0 {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }

    /// Whether the surface crosses a line between two voxels within a cell.
    fn has_surface(&self, at: [i32; 3]) -> bool {
        let ratio = self.cells.side / self.volume.voxel;
        let range = |i: i32| {
            let low = (f64::from(i) * ratio).ceil() as i32;
            // A line begins at a voxel in the cell or the previous one; rounding decides for a voxel on the border of two cells.
            low - 1..((f64::from(i) + 1.0) * ratio).ceil() as i32 + 1
        };
        let [xs, ys, zs] = at.map(range);
        zs.into_iter().any(|z| {
            ys.clone().any(|y| {
                xs.clone().any(|x| {
                    let mut points = (0..3).filter_map(|axis| self.crossing([x, y, z], axis));
                    points.any(|p| self.cell_of(&p) == at)
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fuser;
    use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};

    /// Lists and queries agree.
    #[test]
    fn cell_lists_and_queries_agree() {
        let (w, h) = (80, 60);
        let camera = Camera::pinhole(w as u32, h as u32, [70.0, 70.0, 39.5, 29.5]);
        let mut fuser = Fuser::new(&DenseConfig::default(), &camera, Simd::detect()).unwrap();
        for k in 0..3 {
            let slope = |i: usize| 1.3 + 0.004 * (i % w) as f32 - 0.002 * (i / w) as f32;
            let frame = RgbdFrame {
                id: FrameId(k),
                stamp: 0.0,
                depth_stamp: 0.0,
                gray: GrayImage::new(w, h),
                colour: None,
                depth: DepthImage::from_vec(w, h, (0..w * h).map(slope).collect()).unwrap(),
            };
            let pose = Se3::new(
                Default::default(),
                Vec3::new(0.1 * f64::from(k), 0.03, -0.2),
            );
            fuser.add(&frame, &[], &pose);
        }
        let map = fuser.map();
        let (mut occupied, mut free) = (0, 0);
        map.for_each_known(|at, listed| {
            assert_eq!(map.cell(at), listed, "{at:?}");
            match listed {
                Occupancy::Occupied => occupied += 1,
                _ => free += 1,
            }
        });
        assert!(occupied > 100 && free > 1000, "{occupied} {free}");
    }
}

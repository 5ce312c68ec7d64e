//! The coarse grid: counts of frames in which cells were free, and crossed by moving objects.
//!
//! Occupied cells come from the volume; both together classify a cell as occupied, free or unknown.

use crate::block::{Blocks, Key, SIDE, VOXELS};
use crate::observation::{MOVER_PX, Observation, PER_METRE};
use crate::pixels::{GAP, NO_GAP, Pixels};
use crate::touch::{Stand, bounds, origin};
use stillpoint_geometry::{Vec3, nalgebra::Vector3};

/// A cell by its index along each axis.
pub(crate) type Vec3i = Vector3<i32>;

/// 8x8x8 cells, in the order of a block's voxels.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct CellBlock {
    /// Number of frames in which the whole depth of the cell was free.
    pub(crate) free: [u16; VOXELS],
    /// Number of frames with a moving object in the cell.
    pub(crate) crossed: [u16; VOXELS],
    /// Time for which a surface was seen that appeared in the free cell, since it was last free, hundredths of a second.
    pub(crate) arrived: [u16; VOXELS],
}

impl Default for CellBlock {
    fn default() -> Self {
        Self {
            free: [0; VOXELS],
            crossed: [0; VOXELS],
            arrived: [0; VOXELS],
        }
    }
}

#[derive(Clone)]
pub(crate) struct Cells {
    pub(crate) blocks: Blocks<CellBlock>,
    pub(crate) side: f64,
}

/// Number of free observations from which a cell counts as certainly free.
const SURELY_FREE: u16 = 4;
/// Time after which a surface in such a cell becomes part of the map, hundredths of a second. Seated people stay longer at times; standing
/// ones mostly leave earlier.
const STANDS: u16 = 1000;

/// The camera, and the step along each axis of the world.
struct View<'a> {
    pixels: &'a Pixels,
    camera: [f32; 4],
    size: [usize; 2],
    /// From a cell's centre to its farthest corner, m.
    margin: f32,
    farthest: f32,
}

impl Cells {
    pub(crate) fn new(side: f64) -> Self {
        Self {
            blocks: Blocks::default(),
            side,
        }
    }

    /// Integrates a frame: `pixels` are those of `seen`; uses surfaces up to `max_depth` m and the free space before them.
    pub(crate) fn integrate(
        &mut self,
        seen: &Observation,
        pixels: &Pixels,
        stand: &Stand<'_>,
        max_depth: f64,
    ) {
        let stand = Stand {
            block: SIDE as f64 * self.side,
            ..*stand
        };
        let farthest = pixels.farthest.iter().fold(0.0_f32, |m, z| m.max(*z));
        let farthest = farthest.min(max_depth as f32);
        if farthest > 0.0 {
            self.see(seen, pixels, &stand, farthest);
        }
        self.cross(seen, &stand);
    }

    fn see(&mut self, seen: &Observation, pixels: &Pixels, stand: &Stand<'_>, farthest: f32) {
        let Some([least, most]) = bounds(stand, [0.0, f64::from(farthest)]) else {
            return;
        };
        let c = stand.camera;
        let view = View {
            pixels,
            camera: [c.fx, c.fy, c.cx, c.cy].map(|v| v as f32),
            size: [seen.width, seen.height],
            margin: (0.87 * self.side) as f32,
            farthest,
        };
        let camera_from_world = stand.world_from_camera.inverse();
        let turn = camera_from_world.rotation_matrix() * self.side;
        let steps: [[f32; 3]; 3] = std::array::from_fn(|k| turn.column(k).map(|v| v as f32).into());
        let mut marks = [0_u64; SIDE];
        for z in least[2]..=most[2] {
            for y in least[1]..=most[1] {
                for x in least[0]..=most[0] {
                    let key = Key::new(x, y, z);
                    let middle = origin(key, self.side) + Vec3::repeat(0.5 * self.side);
                    let first = camera_from_world.transform(&middle);
                    if !view.may_see(&first, &turn) {
                        continue;
                    }
                    let first = first.map(|v| v as f32).into();
                    if view.free(first, &steps, &mut marks) {
                        let number = self.blocks.find_or_make(key);
                        let block = self.blocks.get_mut(number);
                        count(&mut block.free, &marks);
                        leave(&mut block.arrived, &marks);
                    }
                }
            }
        }
    }

    /// Counts the cells with moving objects, each once per frame.
    fn cross(&mut self, seen: &Observation, stand: &Stand<'_>) {
        let c = stand.camera;
        let w = seen.mover_width();
        let mut cells = Vec::new();
        for (i, z) in seen.movers.iter().enumerate().filter(|(_, z)| **z > 0) {
            let z = f64::from(*z) / f64::from(PER_METRE);
            let middle = |k: usize| (MOVER_PX * k) as f64 + 0.5 * (MOVER_PX as f64 - 1.0);
            let (u, v) = (middle(i % w), middle(i / w));
            let p = Vec3::new((u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z);
            let at = stand.world_from_camera.transform(&p) / self.side;
            cells.push(<[i32; 3]>::from(at.map(|v| v.floor() as i32)));
        }
        cells.sort_unstable();
        cells.dedup();
        for at in cells {
            let (key, index) = place(at);
            let number = self.blocks.find_or_make(key);
            let crossed = &mut self.blocks.get_mut(number).crossed[index];
            *crossed = crossed.saturating_add(1);
        }
    }

    /// Whether a surface in this cell is withheld: the cell was free, and the surface is too recent.
    pub(crate) fn waits(&self, at: [i32; 3]) -> bool {
        let (key, index) = place(at);
        let block = self.blocks.at(key);
        block.is_some_and(|b| b.free[index] >= SURELY_FREE && b.arrived[index] < STANDS)
    }

    /// Adds observation time, in hundredths of a second, to withheld surfaces in these cells.
    pub(crate) fn arrive(&mut self, cells: &[[i32; 3]], elapsed: u16) {
        for at in cells {
            let (key, index) = place(*at);
            let number = self.blocks.find_or_make(key);
            let arrived = &mut self.blocks.get_mut(number).arrived[index];
            *arrived = arrived.saturating_add(elapsed);
        }
    }

    /// Number of frames in which a cell was free, and crossed.
    pub(crate) fn counts(&self, at: [i32; 3]) -> [u16; 2] {
        let (key, index) = place(at);
        let block = self.blocks.at(key);
        block.map_or([0; 2], |b| [b.free[index], b.crossed[index]])
    }

    /// Calls `f` with each observed cell: its index along each axis, and the numbers of frames in which it was free, and crossed.
    pub(crate) fn for_each(&self, mut f: impl FnMut(Vec3i, u16, u16)) {
        for (key, number) in self.blocks.sorted() {
            let block = self.blocks.get(number);
            let base = key.xyz().map(|k| k.wrapping_mul(SIDE as i32));
            for i in 0..VOXELS {
                let (free, crossed) = (block.free[i], block.crossed[i]);
                if free > 0 || crossed > 0 {
                    let at = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
                    f(Vec3i::from_fn(|k, _| base[k] + at[k] as i32), free, crossed);
                }
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.blocks.bytes()
    }
}

/// The block of a cell, and its index in the block.
fn place(at: [i32; 3]) -> (Key, usize) {
    let side = SIDE as i32;
    let [x, y, z] = at.map(|v| v.div_euclid(side));
    let [i, j, k] = at.map(|v| v.rem_euclid(side) as usize);
    (Key::new(x, y, z), (k * SIDE + j) * SIDE + i)
}

fn count(counts: &mut [u16; VOXELS], marks: &[u64; SIDE]) {
    for (layer, bits) in counts.chunks_exact_mut(SIDE * SIDE).zip(marks) {
        for (i, count) in layer.iter_mut().enumerate() {
            *count = count.saturating_add((bits >> i & 1) as u16);
        }
    }
}

fn leave(arrived: &mut [u16; VOXELS], marks: &[u64; SIDE]) {
    for (layer, bits) in arrived.chunks_exact_mut(SIDE * SIDE).zip(marks) {
        for (i, count) in layer.iter_mut().enumerate() {
            *count *= 1 - (bits >> i & 1) as u16;
        }
    }
}

impl View<'_> {
    /// Whether any cell of a block may be in the image and near enough; `first` is the centre of its first one.
    fn may_see(&self, first: &Vec3, turn: &stillpoint_geometry::Mat3) -> bool {
        let half = (SIDE as f64 - 1.0) / 2.0;
        let middle = first + turn * Vec3::repeat(half);
        let radius = half * 3_f64.sqrt() * turn.column(0).norm();
        if middle.z + radius < 0.1 || middle.z - radius > f64::from(self.farthest) {
            return false;
        }
        // Distances to the four planes of the view frustum.
        let [fx, fy, cx, cy] = self.camera.map(f64::from);
        let [w, h] = self.size.map(|v| v as f64);
        let beside = |v: f64, f: f64, low: f64, high: f64| {
            let left = (f * v + low * middle.z) / (f * f + low * low).sqrt();
            let right = (high * middle.z - f * v) / (f * f + high * high).sqrt();
            left < -radius || right < -radius
        };
        !beside(middle.x, fx, cx, w - cx) && !beside(middle.y, fy, cy, h - cy)
    }

    /// Marks the free cells of a block; returns whether there are any.
    fn free(&self, first: [f32; 3], steps: &[[f32; 3]; 3], marks: &mut [u64; SIDE]) -> bool {
        let mut any = 0;
        let [fx, fy, cx, cy] = self.camera;
        let (last_u, last_v) = ((self.size[0] - 1) as f32, (self.size[1] - 1) as f32);
        for (z, layer) in marks.iter_mut().enumerate() {
            *layer = 0;
            for y in 0..SIDE {
                let row: [f32; 3] = std::array::from_fn(|i| {
                    first[i] + steps[1][i] * y as f32 + steps[2][i] * z as f32
                });
                for x in 0..SIDE {
                    let k = x as f32;
                    let p: [f32; 3] = std::array::from_fn(|i| row[i] + steps[0][i] * k);
                    let over_z = 1.0 / p[2];
                    let (u, v) = (p[0] * over_z * fx + cx + 0.5, p[1] * over_z * fy + cy + 0.5);
                    let inside = p[2] > 0.1
                        && p[2] < self.farthest
                        && u >= 0.0
                        && v >= 0.0
                        && u <= last_u
                        && v <= last_v;
                    if !inside {
                        continue;
                    }
                    let pixel = self.pixels.pixels[v as usize * self.size[0] + u as usize];
                    let (depth, gap) = (pixel & 0xffff, pixel >> 24);
                    let end = depth as f32 * (1.0 / PER_METRE) - gap as f32 * GAP;
                    let free = gap != NO_GAP && depth > 0 && end > p[2] + self.margin;
                    *layer |= u64::from(free) << (8 * y + x);
                }
            }
            any |= *layer;
        }
        any != 0
    }
}

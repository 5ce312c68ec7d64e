//! The coarse grid: which cells were seen to be free, and which were crossed by what moves.
//!
//! Answers in counts of frames. Where surfaces are, the volume knows better; both together say whether a cell is occupied, free or unknown.

use crate::block::{Blocks, Key, SIDE, VOXELS};
use crate::observation::{MOVER_PX, Observation, PER_METRE};
use crate::pixels::{GAP, NO_GAP, Pixels};
use crate::touch::{Stand, bounds, origin};
use stillpoint_geometry::{Vec3, nalgebra::Vector3};

/// A cell by its number along each axis.
pub(crate) type Vec3i = Vector3<i32>;

/// 8x8x8 cells, in the order of a block's voxels.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct CellBlock {
    /// Frames that saw all of the cell's depth to be free.
    pub(crate) free: [u16; VOXELS],
    /// Frames in which something that moves was in it.
    pub(crate) crossed: [u16; VOXELS],
    /// For how long a surface was seen in it that came when it was free, since it was free last, hundredths of a second.
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

/// The grid.
#[derive(Clone)]
pub(crate) struct Cells {
    pub(crate) blocks: Blocks<CellBlock>,
    /// Side of a cell, m.
    pub(crate) side: f64,
}

/// A cell was surely free that so many frames saw to be.
const SURELY_FREE: u16 = 4;
/// What came to stand in such a cell is part of the room when it was seen to stand for so long, hundredths of a second. Who sits down, sits for longer at
/// times; who waits does not, mostly.
const STANDS: u16 = 1000;

/// The camera and the motion of a step along each axis of the world.
struct View<'a> {
    pixels: &'a Pixels,
    camera: [f32; 4],
    size: [usize; 2],
    /// What lies between a cell's middle and its far corner, m.
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

    /// Takes what a frame saw: `pixels` are those of `seen`; surfaces to `max_depth` m count, and so does the space before them.
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

    /// Counts each cell once that something that moves is in.
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

    /// Whether a surface in this cell has to wait: the cell was free, and it has not stood there for long.
    pub(crate) fn waits(&self, at: [i32; 3]) -> bool {
        let (key, index) = place(at);
        let block = self.blocks.at(key);
        block.is_some_and(|b| b.free[index] >= SURELY_FREE && b.arrived[index] < STANDS)
    }

    /// Notes that surfaces waited in these cells for so many hundredths of a second more.
    pub(crate) fn arrive(&mut self, cells: &[[i32; 3]], elapsed: u16) {
        for at in cells {
            let (key, index) = place(*at);
            let number = self.blocks.find_or_make(key);
            let arrived = &mut self.blocks.get_mut(number).arrived[index];
            *arrived = arrived.saturating_add(elapsed);
        }
    }

    /// How often a cell was seen to be free, and crossed by what moves.
    pub(crate) fn counts(&self, at: [i32; 3]) -> [u16; 2] {
        let (key, index) = place(at);
        let block = self.blocks.at(key);
        block.map_or([0; 2], |b| [b.free[index], b.crossed[index]])
    }

    /// Calls `f` with each cell that something is known of: its number along each axis, in how many frames it was free, and in how many
    /// something that moves was in it.
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

    /// Memory held, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.blocks.bytes()
    }
}

/// The block of a cell, and its number in there.
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

/// What was in a cell that is free has left.
fn leave(arrived: &mut [u16; VOXELS], marks: &[u64; SIDE]) {
    for (layer, bits) in arrived.chunks_exact_mut(SIDE * SIDE).zip(marks) {
        for (i, count) in layer.iter_mut().enumerate() {
            *count *= 1 - (bits >> i & 1) as u16;
        }
    }
}

impl View<'_> {
    /// Whether any cell of a block can be in the image and near enough; `first` is the middle of its first one.
    fn may_see(&self, first: &Vec3, turn: &stillpoint_geometry::Mat3) -> bool {
        let half = (SIDE as f64 - 1.0) / 2.0;
        let middle = first + turn * Vec3::repeat(half);
        let radius = half * 3_f64.sqrt() * turn.column(0).norm();
        if middle.z + radius < 0.1 || middle.z - radius > f64::from(self.farthest) {
            return false;
        }
        // Distances to the four planes of the view.
        let [fx, fy, cx, cy] = self.camera.map(f64::from);
        let [w, h] = self.size.map(|v| v as f64);
        let beside = |v: f64, f: f64, low: f64, high: f64| {
            let left = (f * v + low * middle.z) / (f * f + low * low).sqrt();
            let right = (high * middle.z - f * v) / (f * f + high * high).sqrt();
            left < -radius || right < -radius
        };
        !beside(middle.x, fx, cx, w - cx) && !beside(middle.y, fy, cy, h - cy)
    }

    /// Marks the cells of a block that are free; whether there is one.
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

//! Finds the blocks that a frame updates.
//!
//! Those within the truncation of a surface, and existing ones that the camera sees through. A bit set over the box around the view frustum
//! collects the first, to avoid thousands of hash look-ups of the same block.

use crate::block::{Blocks, Key, SIDE};
use crate::observation::{Observation, PER_METRE};
use crate::pixels::{Pixels, TILE};
use stillpoint_geometry::{Camera, Se3, Vec3};

#[derive(Clone, Copy)]
pub(crate) struct Stand<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) world_from_camera: &'a Se3,
    pub(crate) block: f64,
    /// m.
    pub(crate) truncation: f64,
}

/// A bit set over a box of blocks.
#[derive(Default)]
pub(crate) struct Marks {
    least: [i32; 3],
    size: [usize; 3],
    bits: Vec<u64>,
}

/// Maximum number of bits: 8 m of view in blocks of 4 cm, for any direction.
const MOST_BITS: usize = 1 << 28;

impl Marks {
    /// Marks every block that contains a surface, or is within the truncation of one.
    pub(crate) fn mark(
        &mut self,
        stand: &Stand<'_>,
        seen: &Observation,
        pixels: &Pixels,
    ) -> Option<()> {
        let range = pixels.range?;
        self.clear(stand, range)?;
        let camera = stand.camera;
        let to_world = stand.world_from_camera.rotation_matrix() / stand.block;
        let origin = stand.world_from_camera.translation / stand.block;
        let least = Vec3::from_fn(|i, _| f64::from(self.least[i]));
        let origin = (origin - least).map(|v| v as f32);
        let axes: [[f32; 3]; 3] =
            std::array::from_fn(|k| to_world.column(k).map(|v| v as f32).into());
        let every = stride(stand, range[1]);
        // A step of half a block misses none.
        let half_steps = (2.0 * stand.truncation / stand.block).ceil().max(1.0) as i32;
        let step = stand.truncation as f32 / half_steps as f32;
        let (fx, fy) = (1.0 / camera.fx as f32, 1.0 / camera.fy as f32);
        // Half of the gap between two rays, in blocks per metre of depth.
        let gap = (0.5 * every as f64 / (camera.fx * stand.block)) as f32;
        for v in (every / 2..seen.height).step_by(every) {
            let y = (v as f32 - camera.cy as f32) * fy;
            let row: [f32; 3] = std::array::from_fn(|i| axes[1][i] * y + axes[2][i]);
            for u in (every / 2..seen.width).step_by(every) {
                let pixel = pixels.pixels[v * seen.width + u];
                if pixel >> 16 & 255 == 0 {
                    continue;
                }
                let depth = (pixel & 0xffff) as f32 * (1.0 / PER_METRE);
                let x = (u as f32 - camera.cx as f32) * fx;
                let ray: [f32; 3] = std::array::from_fn(|i| axes[0][i] * x + row[i]);
                // A cube of voxels at the surface may extend into the next block, and so may the surface between two rays.
                let reach = 1.0 / SIDE as f32 + gap * depth;
                let at: [f32; 3] = std::array::from_fn(|i| origin[i] + ray[i] * depth);
                for corner in 0..8 {
                    let off = |i: usize| if corner >> i & 1 == 1 { reach } else { -reach };
                    self.set(std::array::from_fn(|i| at[i] + off(i)));
                }
                for k in -half_steps..=half_steps {
                    let z = depth + step * k as f32;
                    let at: [f32; 3] = std::array::from_fn(|i| origin[i] + ray[i] * z);
                    self.set(at);
                }
            }
        }
        Some(())
    }

    /// Clears the bits, for the box around everything seen; `None` if it is unbounded.
    fn clear(&mut self, stand: &Stand<'_>, [near, far]: [f32; 2]) -> Option<()> {
        let depths = [
            (f64::from(near) - stand.truncation).max(0.0),
            f64::from(far) + stand.truncation,
        ];
        let [least, most] = bounds(stand, depths)?;
        self.least = least;
        self.size = std::array::from_fn(|i| (most[i] - least[i] + 1) as usize);
        let bits = self
            .size
            .iter()
            .try_fold(1_usize, |n, s| n.checked_mul(*s))?;
        if bits > MOST_BITS {
            return None;
        }
        self.bits.clear();
        self.bits.resize(bits.div_ceil(64), 0);
        Some(())
    }

    #[inline(always)]
    fn set(&mut self, at: [f32; 3]) {
        // Only rounding gives negative numbers, which the cast turns to zero.
        let [x, y, z] = at.map(|v| v as usize);
        let [w, h, d] = self.size;
        if x < w && y < h && z < d {
            let bit = (z * h + y) * w + x;
            self.bits[bit / 64] |= 1 << (bit % 64);
        }
    }

    fn has(&self, key: Key) -> bool {
        let at = key.xyz();
        let [x, y, z] = std::array::from_fn(|i| at[i].wrapping_sub(self.least[i]) as usize);
        let [w, h, d] = self.size;
        if x >= w || y >= h || z >= d {
            return false;
        }
        let bit = (z * h + y) * w + x;
        self.bits[bit / 64] >> (bit % 64) & 1 == 1
    }

    pub(crate) fn list(&self, out: &mut Vec<Key>) {
        let [w, h, _] = self.size;
        for (i, word) in self.bits.iter().enumerate() {
            let mut word = *word;
            while word != 0 {
                let bit = 64 * i + word.trailing_zeros() as usize;
                word &= word - 1;
                let (x, y, z) = (bit % w, bit / w % h, bit / w / h);
                out.push(Key::new(
                    self.least[0] + x as i32,
                    self.least[1] + y as i32,
                    self.least[2] + z as i32,
                ));
            }
        }
    }

    /// Existing unmarked blocks that some pixel sees through.
    pub(crate) fn seen_through(
        &self,
        stand: &Stand<'_>,
        pixels: &Pixels,
        blocks: &Blocks,
        out: &mut Vec<Key>,
    ) {
        let farthest = pixels.farthest.iter().fold(0.0_f32, |m, z| m.max(*z));
        let Some(around) = bounds(stand, [0.0, f64::from(farthest)]) else {
            return;
        };
        let camera_from_world = stand.world_from_camera.inverse();
        for (_, key) in blocks.within(around) {
            if !self.has(key) && sees_through(stand, &camera_from_world, pixels, key) {
                out.push(key);
            }
        }
    }
}

/// Pixels between rays: at most a third of a block at the farthest surface, and few enough not to miss thin objects.
fn stride(stand: &Stand<'_>, farthest: f32) -> usize {
    let px = stand.block * stand.camera.fx / (3.0 * f64::from(farthest));
    (px as usize).clamp(1, 8)
}

/// The key range of the blocks around the view frustum between two depths.
pub(crate) fn bounds(stand: &Stand<'_>, depths: [f64; 2]) -> Option<[[i32; 3]; 2]> {
    let c = stand.camera;
    let (w, h) = (f64::from(c.width), f64::from(c.height));
    let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for z in depths {
        for (u, v) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
            let p = Vec3::new((u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z);
            let p = stand.world_from_camera.transform(&p) / stand.block;
            (least, most) = (least.inf(&p), most.sup(&p));
        }
    }
    let fits = |v: f64| v.abs() < 1e8;
    if !(least.iter().all(|v| fits(*v)) && most.iter().all(|v| fits(*v))) {
        return None;
    }
    Some([
        std::array::from_fn(|i| least[i].floor() as i32),
        std::array::from_fn(|i| most[i].floor() as i32),
    ])
}

/// Whether some pixel may see through all or a part of a block.
fn sees_through(stand: &Stand<'_>, camera_from_world: &Se3, pixels: &Pixels, key: Key) -> bool {
    let middle = key.xyz().map(|k| (f64::from(k) + 0.5) * stand.block);
    let p = camera_from_world.transform(&Vec3::from(middle));
    let radius = 0.87 * stand.block;
    let nearest = p.z - radius;
    if p.z + radius <= 0.0 {
        return false;
    }
    let c = stand.camera;
    let z = nearest.max(0.1);
    let tile = |centre: f64, f: f64, middle: f64, size: u32| {
        let tiles = (f64::from(size) / TILE as f64).ceil();
        // Both ends of the bounding sphere, at the depth that projects them farther out.
        let ends = [centre - radius, centre + radius];
        let of = |v: f64, middle: f64| {
            let (near, far) = (v / z, v / (p.z + radius).max(z));
            [f * near + middle, f * far + middle]
        };
        let all = [of(ends[0], middle), of(ends[1], middle)];
        let low = all[0][0].min(all[0][1]) / TILE as f64;
        let high = all[1][0].max(all[1][1]) / TILE as f64;
        (high >= 0.0 && low < tiles).then(|| {
            let end = (tiles - 1.0).max(0.0);
            (low.clamp(0.0, end) as usize, high.clamp(0.0, end) as usize)
        })
    };
    let (Some(across), Some(down)) = (
        tile(p.x, c.fx, c.cx, c.width),
        tile(p.y, c.fy, c.cy, c.height),
    ) else {
        return false;
    };
    let needed = (nearest + stand.truncation) as f32;
    (down.0..=down.1).any(|y| {
        let row = &pixels.farthest[y * pixels.tiles_across..][..pixels.tiles_across];
        row[across.0..=across.1].iter().any(|z| *z > needed)
    })
}

pub(crate) fn origin(key: Key, voxel: f64) -> Vec3 {
    Vec3::from(key.xyz().map(|k| f64::from(k) * SIDE as f64 * voxel))
}

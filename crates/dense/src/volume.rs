//! The surface as a truncated signed distance field, in sparse blocks.
//!
//! Integrates frames with known poses; independent of events and maps. A changed pose requires a new volume.

use crate::arrivals::Arrivals;
use crate::block::{Blocks, FULL, Key, SIDE};
use crate::config::DenseConfig;
use crate::observation::{Observation, PER_METRE};
use crate::pixels::{Pixels, weight_at};
use crate::touch::{Marks, Stand, origin};
use crate::voxels::{Placed, Rule, Sight, update};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::Simd;

pub(crate) struct Volume {
    pub(crate) blocks: Blocks,
    /// m.
    pub(crate) voxel: f64,
    /// m.
    pub(crate) truncation: f64,
    max_depth: f32,
    rule: Rule,
    pub(crate) simd: Simd,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    pixels: Pixels,
    marks: Marks,
    /// Blocks within the truncation of a surface.
    keys: Vec<Key>,
    /// Other blocks that some pixel sees through.
    through: Vec<Key>,
}

impl Clone for Volume {
    fn clone(&self) -> Self {
        Self {
            blocks: self.blocks.clone(),
            scratch: Scratch::default(),
            ..*self
        }
    }

    fn clone_from(&mut self, source: &Self) {
        let (mut blocks, scratch) = (
            std::mem::take(&mut self.blocks),
            std::mem::take(&mut self.scratch),
        );
        blocks.clone_from(&source.blocks);
        *self = Self {
            blocks,
            scratch,
            ..*source
        };
    }
}

impl Volume {
    pub(crate) fn new(config: &DenseConfig, simd: Simd) -> Self {
        let truncation = config.truncation();
        Self {
            blocks: Blocks::default(),
            voxel: config.voxel,
            truncation,
            max_depth: config.max_depth as f32,
            rule: Rule::new(config.voxel, truncation),
            simd,
            scratch: Scratch::default(),
        }
    }

    pub(crate) fn integrate(
        &mut self,
        seen: &Observation,
        camera: &Camera,
        pose: &Se3,
        arrivals: &Arrivals,
    ) {
        if !pose.is_finite() || seen.width == 0 || seen.height == 0 {
            return;
        }
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.pixels.fill(seen, camera, self.max_depth, self.simd);
        arrivals.take_out(seen.width, seen.height, &mut scratch.pixels);
        let stand = Stand {
            camera,
            world_from_camera: pose,
            block: SIDE as f64 * self.voxel,
            truncation: self.truncation,
        };
        scratch.keys.clear();
        if scratch.marks.mark(&stand, seen, &scratch.pixels).is_some() {
            let Scratch {
                pixels,
                marks,
                keys,
                through,
            } = &mut scratch;
            marks.list(keys);
            through.clear();
            marks.seen_through(&stand, pixels, &self.blocks, through);
            self.update_all(seen, &stand, &scratch);
        }
        self.scratch = scratch;
    }

    fn update_all(&mut self, seen: &Observation, stand: &Stand<'_>, scratch: &Scratch) {
        let camera = stand.camera;
        let sight = Sight {
            pixels: &scratch.pixels.pixels,
            colours: &seen.colour,
            width: seen.width,
            height: seen.height,
            colour_width: seen.colour_width(),
            camera: [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32),
            rule: self.rule,
        };
        let camera_from_world = stand.world_from_camera.inverse();
        let turn = camera_from_world.rotation_matrix() * self.voxel;
        let steps = std::array::from_fn(|k| turn.column(k).map(|v| v as f32).into());
        for key in scratch.keys.iter().chain(&scratch.through) {
            let first = camera_from_world.transform(&origin(*key, self.voxel));
            let middle = first + turn * Vec3::repeat(SIDE as f64 / 2.0);
            let placed = Placed {
                first: first.map(|v| v as f32).into(),
                steps,
                // Seeing through counts four times as much as seeing a surface.
                clear_weight: (4.0 * weight_at(middle.z as f32)).round(),
            };
            let before = self.blocks.len();
            let number = self.blocks.find_or_make(*key);
            let is_new = self.blocks.len() > before;
            let block = self.blocks.get_mut(number);
            let learned = update(&sight, &placed, block, self.simd);
            // Removes a new block without updates.
            if is_new && !learned {
                self.blocks.remove(number);
            }
        }
        self.give_back(seen, stand, scratch);
    }

    /// Removes blocks without a surface in or near them: all eight corners are seen through, by more than a block.
    fn give_back(&mut self, seen: &Observation, stand: &Stand<'_>, scratch: &Scratch) {
        let camera_from_world = stand.world_from_camera.inverse();
        let side = SIDE as f64 * self.voxel;
        for key in &scratch.through {
            let Some(number) = self.blocks.find(*key) else {
                continue;
            };
            let first = origin(*key, self.voxel);
            let through = |corner: usize| {
                let step = Vec3::from_fn(|k, _| side * (corner >> k & 1) as f64);
                let p = camera_from_world.transform(&(first + step));
                let free = scratch.pixels.free_to(stand.camera, seen.width, &p);
                free.is_some_and(|z| z > p.z + self.truncation + side)
            };
            if self.blocks.get(number).is_outside() && (0..8).all(through) {
                self.blocks.remove(number);
            }
        }
    }

    /// The signed distance at a world point, m, by trilinear interpolation; positive on the cameras' side. `None` if one of the eight
    /// voxels was never near a surface.
    pub(crate) fn distance(&self, p: &Vec3) -> Option<f64> {
        let at = p / self.voxel;
        if !at.iter().all(|v| v.abs() < 1e8) {
            return None;
        }
        let low = at.map(f64::floor);
        let part = at - low;
        let low = low.map(|v| v as i32);
        let mut sum = 0.0;
        for corner in 0..8 {
            let step = [corner & 1, corner >> 1 & 1, corner >> 2];
            let (d, w, _) = self.voxel_at(std::array::from_fn(|i| low[i] + step[i]))?;
            if w == 0 {
                return None;
            }
            let share = |i: usize| if step[i] == 1 { part[i] } else { 1.0 - part[i] };
            sum += f64::from(d) * share(0) * share(1) * share(2);
        }
        Some(sum / f64::from(FULL) * self.truncation)
    }

    pub(crate) fn limit(&self) -> u16 {
        (self.max_depth * PER_METRE) as u16
    }

    /// Whether there is a surface within half the truncation of a point, m.
    pub(crate) fn has_surface_at(&self, p: &Vec3) -> bool {
        let at = (p / self.voxel).map(|v| (v + 0.5).floor() as i32);
        let voxel = self.voxel_at(at.into());
        voxel.is_some_and(|(d, w, _)| w > 0 && f32::from(d).abs() < 0.5 * FULL)
    }

    /// Distance, weight and colour of a voxel by its index along each axis.
    pub(crate) fn voxel_at(&self, at: [i32; 3]) -> Option<(i16, u16, u32)> {
        let side = SIDE as i32;
        let [x, y, z] = at.map(|v| v.div_euclid(side));
        let block = self.blocks.at(Key::new(x, y, z))?;
        let [i, j, k] = at.map(|v| v.rem_euclid(side) as usize);
        let index = (k * SIDE + j) * SIDE + i;
        Some((
            block.distance[index],
            block.weight[index],
            block.colour[index],
        ))
    }

    pub(crate) fn pixels(&self) -> &Pixels {
        &self.scratch.pixels
    }

    pub(crate) fn bytes(&self) -> usize {
        self.blocks.bytes() + self.scratch.pixels.pixels.capacity() * 4
    }

    /// A hash of every bit of every block.
    pub(crate) fn digest(&self) -> u64 {
        let mut f = 0xcbf2_9ce4_8422_2325_u64;
        let mut take = |v: u64| f = (f ^ v).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
        for (key, number) in self.blocks.sorted() {
            key.0.iter().for_each(|k| take(*k as u64));
            let b = self.blocks.get(number);
            for i in 0..b.distance.len() {
                take(b.distance[i] as u64 & 0xffff | u64::from(b.weight[i]) << 16);
                take(u64::from(b.colour[i]));
            }
        }
        f
    }
}

#[cfg(test)]
pub(crate) mod tests;

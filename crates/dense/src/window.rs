//! A block with its neighbourhood, and extrapolation of distances by one voxel.

use crate::block::{Block, Key, SIDE};
use crate::volume::Volume;

/// Number of voxels before the first cube of a block, and after its last one.
pub(crate) const MARGIN: usize = 2;
/// Corners along a side of a block's cubes, and along a side of the window.
const CORNERS: usize = SIDE + 1;
pub(crate) const WIDE: usize = CORNERS + 2 * MARGIN;
const ALL: usize = WIDE * WIDE * WIDE;

/// A block with its neighbourhood; the block's first voxel is at `MARGIN`.
pub(crate) struct Window {
    pub(crate) distance: [i16; ALL],
    pub(crate) weight: [u16; ALL],
    pub(crate) colour: [u32; ALL],
    pub(crate) measured: [bool; ALL],
    /// Seen through and never near a surface.
    pub(crate) empty: [bool; ALL],
    known: [bool; ALL],
}

pub(crate) fn wide([x, y, z]: [usize; 3]) -> usize {
    (z * WIDE + y) * WIDE + x
}

/// Block offset and voxel index of a window index along an axis.
fn apart(i: usize) -> (i32, usize) {
    let from = i as i32 - MARGIN as i32;
    let side = SIDE as i32;
    (from.div_euclid(side), from.rem_euclid(side) as usize)
}

impl Window {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self {
            distance: [0; ALL],
            weight: [0; ALL],
            colour: [0; ALL],
            measured: [false; ALL],
            empty: [false; ALL],
            known: [false; ALL],
        })
    }

    /// Fills it; false if the surface does not cross it.
    pub(crate) fn fill(&mut self, volume: &Volume, key: Key, min_seen: u32) -> bool {
        let around: [Option<&Block>; 27] = std::array::from_fn(|n| {
            let off = [n % 3, n / 3 % 3, n / 9].map(|v| v as i32 - 1);
            volume.blocks.at(key.moved(off[0], off[1], off[2]))
        });
        let (mut inside, mut outside) = (false, false);
        self.measured.fill(false);
        self.empty.fill(false);
        for z in 0..WIDE {
            let (bz, vz) = apart(z);
            for y in 0..WIDE {
                let (by, vy) = apart(y);
                for x in 0..WIDE {
                    let (bx, vx) = apart(x);
                    let Some(block) = around[((bz + 1) * 9 + (by + 1) * 3 + bx + 1) as usize]
                    else {
                        continue;
                    };
                    let (from, to) = ((vz * SIDE + vy) * SIDE + vx, wide([x, y, z]));
                    let known = block.is_known(from, min_seen);
                    self.measured[to] = known;
                    self.empty[to] = block.is_empty_space(from);
                    self.distance[to] = block.distance[from];
                    self.weight[to] = block.weight[from];
                    self.colour[to] = block.colour[from];
                    inside |= known && block.distance[from] < 0;
                    outside |= known && block.distance[from] >= 0;
                }
            }
        }
        self.known = self.measured;
        inside && outside
    }

    /// Extrapolates distances by one voxel along straight lines, except into seen-through space: at the border of the measured space, cubes
    /// have corners that no ray came near.
    pub(crate) fn extend(&mut self) {
        let corners = MARGIN..MARGIN + CORNERS;
        for z in corners.clone() {
            for y in corners.clone() {
                for x in corners.clone() {
                    let at = wide([x, y, z]);
                    if !self.measured[at] && !self.empty[at] {
                        self.guess(at);
                    }
                }
            }
        }
    }

    fn guess(&mut self, at: usize) {
        let (mut sum, mut count, mut colour) = (0, 0, 0);
        for step in [1, WIDE, WIDE * WIDE] {
            for (near, next) in [(at + step, at + 2 * step), (at - step, at - 2 * step)] {
                let [a, b] = [near, next].map(|i| i32::from(self.distance[i]));
                let lies = a.abs().max(b.abs()) < i32::from(i16::MAX);
                if self.measured[near] && self.measured[next] && lies {
                    (sum, count) = (sum + 2 * a - b, count + 1);
                    colour = if colour & 0xff_ffff == 0 {
                        self.colour[near]
                    } else {
                        colour
                    };
                }
            }
        }
        if count > 0 {
            let full = i32::from(i16::MAX);
            self.distance[at] = (sum / count).clamp(-full, full) as i16;
            self.colour[at] = colour;
            self.known[at] = true;
        }
    }

    /// The case of a cube; `None` if one of its corners is unknown.
    pub(crate) fn case(&self, at: [usize; 3]) -> Option<u8> {
        let (mut case, mut measured) = (0, 0_u8);
        for corner in 0..8 {
            let i = wide(std::array::from_fn(|k| MARGIN + at[k] + (corner >> k & 1)));
            if !self.known[i] {
                return None;
            }
            case |= u8::from(self.distance[i] < 0) << corner;
            measured |= u8::from(self.measured[i]) << corner;
        }
        // Requires that measured corners alone show a crossing.
        (measured & case != 0 && measured & !case != 0 && measured.count_ones() >= 4)
            .then_some(case)
    }
}

//! Marching cubes over the blocks of a volume.

use super::table::{EDGE_STARTS, Table};
use super::{Mesh, MeshOptions};
use crate::block::{Block, Key, KeyMap, SIDE, VOXELS};
use crate::volume::Volume;

/// Voxels before the first cube of a block, and behind its last one, that are looked at.
const MARGIN: usize = 2;
/// Corners along a side of a block's cubes, and all that is looked at.
const CORNERS: usize = SIDE + 1;
const WIDE: usize = CORNERS + 2 * MARGIN;
const ALL: usize = WIDE * WIDE * WIDE;
/// No corner of the mesh lies on this edge yet.
const NONE: u32 = u32::MAX;

/// A block and what borders on it; the block's first voxel is at `MARGIN`.
struct Window {
    distance: [i16; ALL],
    colour: [u32; ALL],
    measured: [bool; ALL],
    /// Seen through and nothing else.
    empty: [bool; ALL],
    known: [bool; ALL],
}

fn wide([x, y, z]: [usize; 3]) -> usize {
    (z * WIDE + y) * WIDE + x
}

/// From the first voxel of a block to one of a window along an axis: blocks, and voxels in there.
fn apart(i: usize) -> (i32, usize) {
    let from = i as i32 - MARGIN as i32;
    let side = SIDE as i32;
    (from.div_euclid(side), from.rem_euclid(side) as usize)
}

impl Window {
    /// Fills it; false where the surface does not run through.
    fn fill(&mut self, volume: &Volume, key: Key, min_seen: u32) -> bool {
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
                    self.colour[to] = block.colour[from];
                    inside |= known && block.distance[from] < 0;
                    outside |= known && block.distance[from] >= 0;
                }
            }
        }
        self.known = self.measured;
        inside && outside
    }

    /// Carries distances on by one voxel, along straight lines, but not to where the camera saw through: what was measured ends somewhere within the
    /// cubes at its border, whose other corners no ray came near.
    fn extend(&mut self) {
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

    /// The mean over all directions in which two voxels are measured.
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

    /// The case of a cube; none where one of its corners is not known.
    fn case(&self, at: [usize; 3]) -> Option<u8> {
        let (mut case, mut measured) = (0, 0_u8);
        for corner in 0..8 {
            let i = wide(std::array::from_fn(|k| MARGIN + at[k] + (corner >> k & 1)));
            if !self.known[i] {
                return None;
            }
            case |= u8::from(self.distance[i] < 0) << corner;
            measured |= u8::from(self.measured[i]) << corner;
        }
        // The surface was measured to run through the cube.
        (measured & case != 0 && measured & !case != 0 && measured.count_ones() >= 4)
            .then_some(case)
    }
}

/// Numbers of the corners on the edges that begin at a block's voxels: `3 voxel + axis`.
type Edges = Box<[u32; 3 * VOXELS]>;

struct Extraction {
    voxel: f64,
    edges: KeyMap<Edges>,
    mesh: Mesh,
}

impl Volume {
    /// The surface, by blocks in the order of their keys.
    pub(crate) fn mesh(&self, options: &MeshOptions) -> Mesh {
        let table = Table::new();
        let mut extraction = Extraction {
            voxel: self.voxel,
            edges: KeyMap::default(),
            mesh: Mesh::default(),
        };
        let mut window = Box::new(Window {
            distance: [0; ALL],
            colour: [0; ALL],
            measured: [false; ALL],
            empty: [false; ALL],
            known: [false; ALL],
        });
        for key in self.with_those_before() {
            if window.fill(self, key, u32::from(options.min_seen.max(1))) {
                window.extend();
                extraction.march(key, &window, &table);
            }
        }
        let mut mesh = extraction.mesh;
        mesh.remove_islands(options.min_area);
        mesh.set_normals();
        mesh
    }

    /// The keys of all blocks and of those just before them, in which the surface may be carried on.
    fn with_those_before(&self) -> Vec<Key> {
        let all = self.blocks.sorted().into_iter().flat_map(|(key, _)| {
            (0..8).map(move |n| {
                let before = |k: usize| -(n >> k & 1);
                key.moved(before(0), before(1), before(2))
            })
        });
        let mut all: Vec<Key> = all.collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

impl Extraction {
    fn march(&mut self, key: Key, window: &Window, table: &Table) {
        for z in 0..SIDE {
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let Some(case) = window.case([x, y, z]) else {
                        continue;
                    };
                    for triangle in table.triangles(case) {
                        let corners =
                            triangle.map(|e| self.corner(key, window, [x, y, z], usize::from(e)));
                        self.mesh.triangles.push(corners);
                    }
                }
            }
        }
    }

    /// The number of the corner on an edge of a cube, which is made if it is the first to be asked for.
    fn corner(&mut self, key: Key, window: &Window, cube: [usize; 3], edge: usize) -> u32 {
        let (start, axis) = (EDGE_STARTS[edge], edge / 4);
        let from: [usize; 3] = std::array::from_fn(|k| cube[k] + (start >> k & 1));
        let [x, y, z] = from.map(|v| (v / SIDE) as i32);
        let at = from.map(|v| v % SIDE);
        let slot = 3 * ((at[2] * SIDE + at[1]) * SIDE + at[0]) + axis;
        let edges = self.edges.entry(key.moved(x, y, z));
        let edges = edges.or_insert_with(|| Box::new([NONE; 3 * VOXELS]));
        if edges[slot] != NONE {
            return edges[slot];
        }
        let number = self.mesh.positions.len() as u32;
        edges[slot] = number;
        let mut to = from;
        to[axis] += 1;
        let (a, b) = (wide(from.map(|v| v + MARGIN)), wide(to.map(|v| v + MARGIN)));
        let (da, db) = (f64::from(window.distance[a]), f64::from(window.distance[b]));
        let way = da / (da - db);
        let base = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        self.mesh.positions.push(std::array::from_fn(|k| {
            let along = if k == axis { way } else { 0.0 };
            ((base[k] + from[k] as f64 + along) * self.voxel) as f32
        }));
        // One that no pixel coloured takes after the other.
        let rgb = |i: usize| Some(window.colour[i]).filter(|c| c & 0xff_ffff != 0);
        let (ca, cb) = (rgb(a).or(rgb(b)), rgb(b).or(rgb(a)));
        let (ca, cb) = (ca.unwrap_or(0), cb.unwrap_or(0));
        self.mesh.colours.push(std::array::from_fn(|k| {
            let channel = |c: u32| f64::from(c >> (8 * k) & 255);
            (channel(ca) + (channel(cb) - channel(ca)) * way + 0.5) as u8
        }));
        number
    }
}

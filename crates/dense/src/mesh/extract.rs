//! Marching cubes over the blocks of a volume.

use super::table::{EDGE_STARTS, Table};
use super::{Mesh, MeshOptions};
use crate::block::{Block, Key, SIDE, VOXELS};
use crate::volume::Volume;

/// Voxels along a side of a block with the first ones of its neighbours.
const WIDE: usize = SIDE + 1;
/// No corner of the mesh lies on this edge yet.
const NONE: u32 = u32::MAX;

/// A block and what borders on it.
struct Window {
    distance: [i16; WIDE * WIDE * WIDE],
    colour: [u32; WIDE * WIDE * WIDE],
    known: [bool; WIDE * WIDE * WIDE],
}

fn wide([x, y, z]: [usize; 3]) -> usize {
    (z * WIDE + y) * WIDE + x
}

impl Window {
    /// Fills it; false where the surface does not run through.
    fn fill(&mut self, around: &[Option<&Block>; 8], min_seen: u32) -> bool {
        let (mut inside, mut outside) = (false, false);
        self.known.fill(false);
        for z in 0..WIDE {
            for y in 0..WIDE {
                for x in 0..WIDE {
                    let neighbour = (x / SIDE) | ((y / SIDE) << 1) | ((z / SIDE) << 2);
                    let Some(block) = around[neighbour] else {
                        continue;
                    };
                    let from = ((z % SIDE) * SIDE + y % SIDE) * SIDE + x % SIDE;
                    let to = wide([x, y, z]);
                    let known = block.is_known(from, min_seen);
                    self.known[to] = known;
                    self.distance[to] = block.distance[from];
                    self.colour[to] = block.colour[from];
                    inside |= known && block.distance[from] < 0;
                    outside |= known && block.distance[from] >= 0;
                }
            }
        }
        inside && outside
    }

    /// The case of a cube; none where one of its corners is not known.
    fn case(&self, at: [usize; 3]) -> Option<u8> {
        let mut case = 0;
        for corner in 0..8 {
            let i = wide(std::array::from_fn(|k| at[k] + (corner >> k & 1)));
            if !self.known[i] {
                return None;
            }
            case |= u8::from(self.distance[i] < 0) << corner;
        }
        Some(case)
    }
}

/// Numbers of the corners on the edges that begin at a block's voxels: `3 voxel + axis`.
type Edges = Box<[u32; 3 * VOXELS]>;

struct Extraction<'a> {
    volume: &'a Volume,
    edges: Vec<Option<Edges>>,
    mesh: Mesh,
}

impl Volume {
    /// The surface, by blocks in the order of their keys.
    pub(crate) fn mesh(&self, options: &MeshOptions) -> Mesh {
        let (table, sorted) = (Table::new(), self.blocks.sorted());
        let numbers = sorted.iter().map(|(_, n)| n + 1).max().unwrap_or(0);
        let mut extraction = Extraction {
            volume: self,
            edges: vec![None; numbers],
            mesh: Mesh::default(),
        };
        let mut window = Box::new(Window {
            distance: [0; WIDE * WIDE * WIDE],
            colour: [0; WIDE * WIDE * WIDE],
            known: [false; WIDE * WIDE * WIDE],
        });
        for (key, _) in &sorted {
            let around = std::array::from_fn(|n| neighbour(self, *key, n));
            let around = around.map(|n| n.map(|n| self.blocks.get(n)));
            if window.fill(&around, u32::from(options.min_seen.max(1))) {
                extraction.march(*key, &window, &table);
            }
        }
        let mut mesh = extraction.mesh;
        mesh.remove_islands(options.min_area);
        mesh.set_normals();
        mesh
    }
}

/// The number of the block that is next along the axes of the set bits.
fn neighbour(volume: &Volume, key: Key, bits: usize) -> Option<usize> {
    let bit = |k: usize| (bits >> k & 1) as i32;
    volume.blocks.find(key.moved(bit(0), bit(1), bit(2)))
}

impl Extraction<'_> {
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
        let bits = (0..3).map(|k| (from[k] / SIDE) << k).sum();
        let at = from.map(|v| v % SIDE);
        let slot = 3 * ((at[2] * SIDE + at[1]) * SIDE + at[0]) + axis;
        // The cube's corners are known, so the blocks that they are in are there.
        let owner = neighbour(self.volume, key, bits).unwrap_or(0);
        let edges = self.edges[owner].get_or_insert_with(|| Box::new([NONE; 3 * VOXELS]));
        if edges[slot] != NONE {
            return edges[slot];
        }
        let number = self.mesh.positions.len() as u32;
        edges[slot] = number;
        let mut to = from;
        to[axis] += 1;
        let (a, b) = (wide(from), wide(to));
        let (da, db) = (f64::from(window.distance[a]), f64::from(window.distance[b]));
        let way = da / (da - db);
        let base = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        self.mesh.positions.push(std::array::from_fn(|k| {
            let along = if k == axis { way } else { 0.0 };
            ((base[k] + from[k] as f64 + along) * self.volume.voxel) as f32
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

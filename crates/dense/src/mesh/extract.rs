//! Marching cubes over the blocks of a volume.

use super::table::{EDGE_STARTS, Table};
use super::{Mesh, MeshOptions};
use crate::block::{Key, KeyMap, SIDE, VOXELS};
use crate::volume::Volume;
use crate::window::{MARGIN, Window, wide};

const NONE: u32 = u32::MAX;

/// Vertex indices on the edges that begin at a block's voxels: `3 voxel + axis`.
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
        let mut window = Window::new();
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

    /// The keys of all blocks and of their lower neighbours, into which the surface may be extrapolated.
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

    /// The index of the vertex on an edge of a cube, which is created on first use.
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
        // A voxel without colour takes that of the other.
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

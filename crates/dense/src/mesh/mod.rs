//! The surface as triangles.

mod coarse;
mod extract;
mod glb;
mod islands;
mod ply;
mod table;

use stillpoint_geometry::Vec3;

/// Triangles with shared vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// m, world.
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors out of the surface, towards the cameras.
    pub normals: Vec<[f32; 3]>,
    /// Red, green, blue.
    pub colours: Vec<[u8; 3]>,
    /// Vertices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Which surfaces a mesh contains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Minimum number of frames that saw a surface, minus those that saw through it.
    pub min_seen: u8,
    /// Connected components with less area are left out, m^2.
    pub min_area: f64,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            min_seen: 2,
            min_area: 0.01,
        }
    }
}

impl Mesh {
    /// Sets the normals: at each vertex the mean of its triangles, weighted by area.
    fn set_normals(&mut self) {
        let mut sums = vec![Vec3::zeros(); self.positions.len()];
        for t in &self.triangles {
            let n = self.area_vector(t);
            t.iter().for_each(|i| sums[*i as usize] += n);
        }
        let unit = |n: &Vec3| {
            let length = n.norm();
            // A triangle without area has no normal; any unit vector satisfies readers.
            let n = if length > 0.0 { n / length } else { Vec3::z() };
            [n.x as f32, n.y as f32, n.z as f32]
        };
        self.normals = sums.iter().map(unit).collect();
    }

    /// Normal of a triangle, with twice its area as length.
    fn area_vector(&self, t: &[u32; 3]) -> Vec3 {
        let [a, b, c] = t.map(|i| self.position(i));
        (b - a).cross(&(c - a))
    }

    /// A vertex, m.
    #[must_use]
    pub fn position(&self, i: u32) -> Vec3 {
        Vec3::from(self.positions[i as usize].map(f64::from))
    }

    /// Area of all triangles, m^2.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.triangles
            .iter()
            .map(|t| 0.5 * self.area_vector(t).norm())
            .sum()
    }
}

//! Mesh simplification for display.

use super::Mesh;
use std::collections::BTreeMap;
use stillpoint_geometry::Vec3;

impl Mesh {
    /// A mesh with at most this many triangles, or an equal one: vertices within a cube are merged, with the smallest sufficient cubes.
    /// Vertex clustering: Rossignac, Borrel, Geometric Modeling in Computer Graphics, 1993.
    #[must_use]
    pub fn with_triangles(&self, most: usize) -> Self {
        if self.triangles.len() <= most {
            return self.clone();
        }
        // A surface has about two triangles per cube of this side.
        let mut side = (2.0 * self.area() / most.max(1) as f64).sqrt().max(1e-3);
        loop {
            let coarse = self.clustered(side);
            if coarse.triangles.len() <= most {
                return coarse;
            }
            side *= 1.2;
        }
    }

    /// One vertex with its colour for each cube of this side (m): the first, so that the result is reproducible.
    #[must_use]
    pub fn thinned(&self, side: f64) -> Vec<([f32; 3], [u8; 3])> {
        let mut taken = BTreeMap::new();
        for (p, colour) in self.positions.iter().zip(&self.colours) {
            let cube = p.map(|x| (f64::from(x) / side).floor() as i64);
            taken.entry(cube).or_insert((*p, *colour));
        }
        taken.into_values().collect()
    }

    fn clustered(&self, side: f64) -> Self {
        let mut numbers: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        let mut sums: Vec<(Vec3, [u32; 3], u32)> = Vec::new();
        let mut renamed = Vec::with_capacity(self.positions.len());
        for (i, colour) in self.colours.iter().enumerate() {
            let p = self.position(i as u32);
            let cube: [i64; 3] = (p / side).map(|v| v.floor() as i64).into();
            let number = *numbers.entry(cube).or_insert(sums.len() as u32);
            if number as usize == sums.len() {
                sums.push((Vec3::zeros(), [0; 3], 0));
            }
            let (sum, rgb, count) = &mut sums[number as usize];
            *sum += p;
            (0..3).for_each(|k| rgb[k] += u32::from(colour[k]));
            *count += 1;
            renamed.push(number);
        }
        let triangles = self
            .triangles
            .iter()
            .map(|t| t.map(|i| renamed[i as usize]));
        let whole = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let mut triangles: Vec<[u32; 3]> = triangles.filter(whole).map(least_first).collect();
        triangles.sort_unstable();
        triangles.dedup();
        let mut mesh = Self {
            positions: sums
                .iter()
                .map(|(p, _, n)| (p / f64::from(*n)).map(|v| v as f32).into())
                .collect(),
            colours: sums
                .iter()
                .map(|(_, rgb, n)| rgb.map(|c| (c / n) as u8))
                .collect(),
            triangles,
            normals: Vec::new(),
        };
        mesh.set_normals();
        mesh
    }
}

fn least_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `n` x `n` small ones, red on the left and blue on the right.
    fn square(n: u32) -> Mesh {
        let at = |i: u32| [i % (n + 1), i / (n + 1)];
        let corners = (n + 1) * (n + 1);
        let mut mesh = Mesh {
            positions: (0..corners)
                .map(|i| at(i).map(|v| v as f32 / n as f32))
                .map(|[x, y]| [x, y, 0.0])
                .collect(),
            colours: (0..corners)
                .map(|i| {
                    if 2 * at(i)[0] <= n {
                        [200, 0, 0]
                    } else {
                        [0, 0, 200]
                    }
                })
                .collect(),
            ..Mesh::default()
        };
        for y in 0..n {
            for x in 0..n {
                let i = y * (n + 1) + x;
                mesh.triangles.push([i, i + 1, i + n + 1]);
                mesh.triangles.push([i + 1, i + n + 2, i + n + 1]);
            }
        }
        mesh.set_normals();
        mesh
    }

    #[test]
    fn simplified_mesh_keeps_its_shape() {
        let fine = square(100);
        let coarse = fine.with_triangles(1000);
        assert!(
            (300..=1000).contains(&coarse.triangles.len()),
            "{}",
            coarse.triangles.len()
        );
        assert!(
            (coarse.area() - fine.area()).abs() < 0.15,
            "{}",
            coarse.area()
        );
        assert!(coarse.normals.iter().all(|n| n[2] > 0.99));
        for (p, c) in coarse.positions.iter().zip(&coarse.colours) {
            let [red, _, blue] = c;
            assert!(if p[0] < 0.4 {
                red > blue
            } else {
                p[0] < 0.6 || blue > red
            });
        }
        assert_eq!(fine.with_triangles(20_000), fine);
        assert!(fine.with_triangles(0).triangles.is_empty());
    }
}

//! The floor plan for robot navigation: occupied, free or unknown cells, in the format of ROS 2's map_server.

use crate::cells::Vec3i;
use crate::floor::Floor;
use crate::mesh::MeshOptions;
use crate::world::{DenseMap, Occupancy};
use std::io::{Result, Write};
use stillpoint_geometry::Vec3;

/// The height range that matters to a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanOptions {
    /// Lower end above the floor, m: lower objects are driven over.
    pub low: f64,
    /// Upper end, m: higher objects are driven under.
    pub high: f64,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            low: 0.1,
            high: 1.5,
        }
    }
}

/// The plan, in the axes of [`Floor::level_from_world`]; row 0 is at the smallest y.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
    /// Side of a cell, m.
    pub resolution: f64,
    /// x and y of the outer corner of the first cell, m.
    pub origin: [f64; 2],
    /// Row by row.
    pub cells: Vec<Occupancy>,
    /// Number of frames in which something moved there, at any height of the range; at most 65535.
    pub crossed: Vec<u16>,
    /// The floor below it.
    pub floor: Floor,
}

/// Maximum number of cells along a side.
const MOST: f64 = 20_000.0;
/// Grey values of map_server's trinary mode.
const SHADES: [(Occupancy, u8); 3] = [
    (Occupancy::Occupied, 0),
    (Occupancy::Free, 254),
    (Occupancy::Unknown, 205),
];

impl DenseMap {
    /// The plan above a floor; `None` if nothing is known, or beyond a kilometre.
    #[must_use]
    pub fn plan(&self, floor: &Floor, options: &PlanOptions) -> Option<Plan> {
        let turn = floor.level_from_world();
        let side = self.cells.side;
        let mesh = self.mesh(&MeshOptions::default());
        let corners: Vec<Vec3> = (0..mesh.positions.len() as u32)
            .map(|i| turn * mesh.position(i))
            .collect();
        let middle = |at: &Vec3i| at.map(|v| (f64::from(v) + 0.5) * side);
        let mut known = corners.clone();
        self.cells.for_each(|at, _, _| {
            known.push(turn * middle(&at));
        });
        let far = f64::INFINITY;
        let bounds = known.iter().fold([far, far, -far, -far], |b, p| {
            [b[0].min(p.x), b[1].min(p.y), b[2].max(p.x), b[3].max(p.y)]
        });
        let first = [bounds[0], bounds[1]].map(|v| (v / side).floor());
        let last = [bounds[2], bounds[3]].map(|v| (v / side).floor());
        let size = [last[0] - first[0] + 1.0, last[1] - first[1] + 1.0];
        if !size.iter().all(|s| (1.0..=MOST).contains(s)) {
            return None;
        }
        let (width, height) = (size[0] as usize, size[1] as usize);
        let mut plan = Plan {
            width,
            height,
            resolution: side,
            origin: first.map(|v| v * side),
            cells: vec![Occupancy::Unknown; width * height],
            crossed: vec![0; width * height],
            floor: *floor,
        };
        let band = options.low..=options.high;
        self.cells.for_each(|at, free, crossed| {
            let p = turn * middle(&at);
            let Some(i) = plan
                .index(&p)
                .filter(|_| band.contains(&(p.z - floor.offset)))
            else {
                return;
            };
            if free >= 2 {
                plan.cells[i] = Occupancy::Free;
            }
            plan.crossed[i] = plan.crossed[i].max(crossed);
        });
        for p in corners
            .iter()
            .filter(|p| band.contains(&(p.z - floor.offset)))
        {
            if let Some(i) = plan.index(p) {
                plan.cells[i] = Occupancy::Occupied;
            }
        }
        Some(plan)
    }
}

impl Plan {
    fn index(&self, p: &Vec3) -> Option<usize> {
        let at =
            [p.x - self.origin[0], p.y - self.origin[1]].map(|v| (v / self.resolution).floor());
        let inside =
            at[0] >= 0.0 && at[1] >= 0.0 && at[0] < self.width as f64 && at[1] < self.height as f64;
        inside.then(|| at[1] as usize * self.width + at[0] as usize)
    }

    /// The value at a point of the world (m), by its vertical projection; unknown outside.
    #[must_use]
    pub fn at(&self, p: &Vec3) -> Occupancy {
        let i = self.index(&(self.floor.level_from_world() * p));
        i.map_or(Occupancy::Unknown, |i| self.cells[i])
    }

    /// Distance from the centre of each cell to that of the nearest occupied one, m, row by row; infinite if there is none. Exact, by two
    /// passes of parabolas (Felzenszwalb, Huttenlocher, Theory of Computing 2012).
    #[must_use]
    pub fn distances(&self) -> Vec<f32> {
        let occupied: Vec<bool> = self
            .cells
            .iter()
            .map(|c| *c == Occupancy::Occupied)
            .collect();
        distances(&occupied, self.width, self.resolution)
    }

    /// Writes map_server's image: black occupied, white free, grey unknown; the row of the largest y first.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_pgm(&self, mut to: impl Write) -> Result<()> {
        write!(to, "P5\n{} {}\n255\n", self.width, self.height)?;
        let shade = |c: &Occupancy| {
            let found = SHADES.iter().find(|s| s.0 == *c);
            found.map_or(205, |s| s.1)
        };
        for row in self.cells.chunks(self.width).rev() {
            to.write_all(&row.iter().map(shade).collect::<Vec<u8>>())?;
        }
        Ok(())
    }

    /// Writes the crossed counts as a 16-bit image with the layout of [`Plan::write_pgm`].
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_crossed(&self, to: impl Write) -> Result<()> {
        self.write_16(to, &self.crossed)
    }

    /// Writes [`Plan::distances`] as a 16-bit image, mm; 65535 where they are larger.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_distances(&self, to: impl Write) -> Result<()> {
        let millimetres = |d: &f32| (1000.0 * d + 0.5).min(65535.0) as u16;
        let values: Vec<u16> = self.distances().iter().map(millimetres).collect();
        self.write_16(to, &values)
    }

    fn write_16(&self, mut to: impl Write, values: &[u16]) -> Result<()> {
        write!(to, "P5\n{} {}\n65535\n", self.width, self.height)?;
        for row in values.chunks(self.width).rev() {
            let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_be_bytes()).collect();
            to.write_all(&bytes)?;
        }
        Ok(())
    }

    /// map_server's YAML file for the image `image`.
    #[must_use]
    pub fn yaml(&self, image: &str) -> String {
        format!(
            "image: {image}\nmode: trinary\nresolution: {}\norigin: [{}, {}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
            self.resolution, self.origin[0], self.origin[1]
        )
    }
}

/// Distance from the centre of each cell to that of the nearest set one, m; see [`Plan::distances`]. Cells have a side of `side` m.
pub(crate) fn distances(set: &[bool], width: usize, side: f64) -> Vec<f32> {
    let zero = |s: &bool| if *s { 0.0 } else { f64::INFINITY };
    let mut squares: Vec<f64> = set.iter().map(zero).collect();
    let (w, h) = (width, set.len() / width.max(1));
    let mut line = Vec::new();
    for y in 0..h {
        line.clear();
        line.extend_from_slice(&squares[y * w..(y + 1) * w]);
        transform(&line, |x, d| squares[y * w + x] = d);
    }
    for x in 0..w {
        line.clear();
        line.extend((0..h).map(|y| squares[y * w + x]));
        transform(&line, |y, d| squares[y * w + x] = d);
    }
    let metres = |d: f64| (d.sqrt() * side) as f32;
    squares.into_iter().map(metres).collect()
}

/// Distance transform along a line, of squared distances.
fn transform(values: &[f64], mut set: impl FnMut(usize, f64)) {
    // The lower envelope of parabolas, with the start of each.
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for (i, value) in values.iter().enumerate().filter(|v| v.1.is_finite()) {
        let at = |k: usize| k as f64 * k as f64;
        loop {
            let Some((k, begin)) = lowest.last().copied() else {
                lowest.push((i, f64::NEG_INFINITY));
                break;
            };
            let meet = (value + at(i) - values[k] - at(k)) / (2.0 * (i as f64 - k as f64));
            if meet > begin {
                lowest.push((i, meet));
                break;
            }
            lowest.pop();
        }
    }
    let mut next = 0;
    for x in 0..values.len() {
        if lowest.is_empty() {
            return;
        }
        while lowest.get(next + 1).is_some_and(|l| l.1 < x as f64) {
            next += 1;
        }
        let (k, d) = (lowest[next].0, x as f64 - lowest[next].0 as f64);
        set(x, d * d + values[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plan(width: usize, occupied: &[bool]) -> Plan {
        let cell = |o: &bool| {
            if *o {
                Occupancy::Occupied
            } else {
                Occupancy::Free
            }
        };
        Plan {
            width,
            height: occupied.len() / width,
            resolution: 0.05,
            origin: [-1.0, 2.0],
            cells: occupied.iter().map(cell).collect(),
            crossed: vec![300; occupied.len()],
            floor: Floor {
                up: Vec3::z(),
                offset: 0.0,
            },
        }
    }

    proptest! {
        #[test]
        fn distance_transform_equals_brute_force(width in 1_usize..9, bits in prop::collection::vec(prop::bool::weighted(0.2), 9..80)) {
            let bits = &bits[..bits.len() / width * width];
            let plan = plan(width, bits);
            let found = plan.distances();
            for (i, d) in found.iter().enumerate() {
                let far = |k: usize| {
                    let dx = (k % width) as f64 - (i % width) as f64;
                    let dy = (k / width) as f64 - (i / width) as f64;
                    0.05 * (dx * dx + dy * dy).sqrt()
                };
                let all = (0..bits.len()).filter(|k| bits[*k]).map(far);
                let expected = all.fold(f64::INFINITY, f64::min);
                prop_assert!(f64::from(*d) == expected || (f64::from(*d) - expected).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn plan_files_follow_the_map_server_format() {
        let plan = plan(3, &[true, false, false, false, false, false]);
        let mut image = Vec::new();
        plan.write_pgm(&mut image).unwrap();
        assert_eq!(image, b"P5\n3 2\n255\n\xfe\xfe\xfe\x00\xfe\xfe");
        assert!(
            plan.yaml("a.pgm").starts_with(
                "image: a.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1, 2, 0.0]\n"
            )
        );
        let mut image = Vec::new();
        plan.write_crossed(&mut image).unwrap();
        assert_eq!(&image[..15], b"P5\n3 2\n65535\n\x01\x2c");
        assert_eq!(plan.at(&Vec3::new(-0.98, 2.01, 9.0)), Occupancy::Occupied);
        assert_eq!(plan.at(&Vec3::new(-0.98, 2.2, 9.0)), Occupancy::Unknown);
    }
}

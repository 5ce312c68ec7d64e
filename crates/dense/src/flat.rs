//! A floor plan in given axes, for consumers that do not rotate grids.

use crate::plan::Plan;
use crate::world::Occupancy;
use stillpoint_geometry::{Se3, Vec3};

/// A plan in the axes of a frame with z up, as in ROS's `OccupancyGrid`.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatPlan {
    /// Cells along x.
    pub width: usize,
    /// Side of a cell, m.
    pub resolution: f64,
    /// Outer corner of the first cell, m.
    pub origin: Vec3,
    /// Row by row, from the smallest y: 100 occupied, 0 free, -1 unknown.
    pub cells: Vec<i8>,
}

impl Plan {
    /// The plan in the axes of `map`, where z is up: each cell takes the value of the plan's cell at its centre.
    #[must_use]
    pub fn in_axes_of(&self, map_from_world: &Se3) -> FlatPlan {
        let side = self.resolution;
        let world_from_level = self.floor.level_from_world().transpose();
        let at = |i: f64, j: f64| {
            let [x, y] = self.origin;
            let level = Vec3::new(x + i * side, y + j * side, self.floor.offset);
            map_from_world.transform(&(world_from_level * level))
        };
        let (w, h) = (self.width as f64, self.height as f64);
        let corners = [at(0.0, 0.0), at(w, 0.0), at(0.0, h), at(w, h)];
        let low = |k: usize| corners.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        let high = |k: usize| {
            corners
                .iter()
                .map(|c| c[k])
                .fold(f64::NEG_INFINITY, f64::max)
        };
        // Aligned to multiples of the cell side, so that grids of one run match.
        let first = [0, 1].map(|k| (low(k) / side).floor());
        let cells_along = [0, 1].map(|k| ((high(k) / side).ceil() - first[k]).max(1.0) as usize);
        let height = corners.iter().map(|c| c.z).sum::<f64>() / 4.0;
        let world_from_map = map_from_world.inverse();
        let mut cells = Vec::with_capacity(cells_along[0] * cells_along[1]);
        for j in 0..cells_along[1] {
            for i in 0..cells_along[0] {
                let p = Vec3::new(
                    (first[0] + i as f64 + 0.5) * side,
                    (first[1] + j as f64 + 0.5) * side,
                    height,
                );
                cells.push(match self.at(&world_from_map.transform(&p)) {
                    Occupancy::Occupied => 100,
                    Occupancy::Free => 0,
                    Occupancy::Unknown => -1,
                });
            }
        }
        FlatPlan {
            width: cells_along[0],
            resolution: side,
            origin: Vec3::new(first[0] * side, first[1] * side, height),
            cells,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Floor;
    use stillpoint_geometry::Mat3;

    #[test]
    fn flat_plan_is_in_the_map_axes() {
        // A camera that looks along x of the map, with y down: the floor is 1 m below.
        let up = -Vec3::y();
        let floor = Floor { up, offset: -1.0 };
        let mut plan = Plan {
            width: 40,
            height: 20,
            resolution: 0.1,
            origin: [-1.0, -1.0],
            cells: vec![Occupancy::Free; 800],
            crossed: vec![0; 800],
            floor,
        };
        plan.cells[5 * 40 + 7] = Occupancy::Occupied;
        // x of the map is the camera's z, y its -x, z its -y.
        let turn = Mat3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let map_from_world = Se3::from_matrix(&turn, Vec3::zeros());
        let flat = plan.in_axes_of(&map_from_world);
        assert!((flat.origin.z + 1.0).abs() < 1e-9);
        let occupied: Vec<usize> = (0..flat.cells.len())
            .filter(|i| flat.cells[*i] == 100)
            .collect();
        assert!((1..=2).contains(&occupied.len()), "{occupied:?}");
        // The same cell, computed in both ways.
        let level = Vec3::new(-1.0 + 0.75, -1.0 + 0.55, -1.0);
        let expected = map_from_world.transform(&(floor.level_from_world().transpose() * level));
        let (i, j) = (occupied[0] % flat.width, occupied[0] / flat.width);
        let found = flat.origin + Vec3::new(i as f64 + 0.5, j as f64 + 0.5, 0.0) * 0.1;
        assert!((found - expected).norm() < 0.11, "{found} {expected}");
        assert_eq!(flat.cells.iter().filter(|c| **c == 0).count(), 799);
    }
}

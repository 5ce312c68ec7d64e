//! Merges two dense maps: resamples the second at the voxels and cells of the first, then averages both.
//!
//! The result is in the frame of the first. Unknown space stays unknown. The caller provides the rigid transform between the maps.

mod grid;
mod surface;

use crate::config::DenseConfig;
use crate::world::DenseMap;
use stillpoint_geometry::Se3;

/// Maximum ratio of the second map's voxel and cell size to the first's: each of its blocks becomes a cube of that many.
const COARSEST: f64 = 4.0;

/// Why two dense maps cannot be merged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "expected {what} of {least:.3} to {most:.3} m beside those of {own} m, found {found} m; merge the maps the other way round, or fuse one of them again with the same size (--voxel)"
)]
pub struct DenseMergeError {
    what: &'static str,
    /// m.
    own: f64,
    /// m.
    least: f64,
    /// m.
    most: f64,
    /// m.
    found: f64,
}

impl DenseMap {
    /// The map transformed by the rigid motion `to_from_world`. Distances are interpolated between voxels that were seen near a surface;
    /// the identity gives an equal map.
    #[must_use]
    pub fn moved(&self, to_from_world: &Se3) -> Self {
        self.resampled(to_from_world, self.emptied())
    }

    /// Merges another map, with the rigid motion `self_from_other`. Its surface is resampled and averaged by weight; counts of cells are
    /// added. Space occupied in either map stays occupied.
    ///
    /// # Errors
    /// Voxel or cell sizes that differ too much; this map stays unchanged.
    pub fn absorb(&mut self, other: &Self, self_from_other: &Se3) -> Result<(), DenseMergeError> {
        self.check_sizes_of(other)?;
        let moved = other.resampled(self_from_other, self.emptied());
        surface::average(&mut self.volume, &moved.volume);
        grid::sum(&mut self.cells, &moved.cells);
        Ok(())
    }

    /// Resamples the map to the voxels and cells of an empty one.
    fn resampled(&self, to_from_world: &Se3, mut to: Self) -> Self {
        if to_from_world.is_finite() {
            surface::resample(&self.volume, &mut to.volume, to_from_world);
            grid::resample(self, &mut to, to_from_world);
        }
        to
    }

    /// Corners of a cube that the surface crosses are up to its diagonal away: a smaller truncation of the other map would leave holes.
    fn check_sizes_of(&self, other: &Self) -> Result<(), DenseMergeError> {
        let diagonal = 3_f64.sqrt() * self.voxel();
        let finest = DenseConfig {
            voxel: 0.0,
            ..DenseConfig::default()
        };
        let any = finest.truncation() >= diagonal;
        let least = if any { 0.0 } else { diagonal / 4.0 };
        let sizes = [
            ("voxels", least, self.voxel(), other.voxel()),
            ("cells", 0.0, self.cell_side(), other.cell_side()),
        ];
        for (what, least, own, found) in sizes {
            let most = COARSEST * own;
            if found < least || found > most {
                return Err(DenseMergeError {
                    what,
                    own,
                    least,
                    most,
                    found,
                });
            }
        }
        Ok(())
    }
}

/// Maximum distance from the origin that is kept, in voxels or cells.
const FARTHEST: f64 = 1e8;

/// Maps voxel indices of one grid to those of another: `numbers x + first`. The same computation for every voxel ensures that each falls
/// between the same eight voxels of the other grid, whichever block is processed.
struct Steps {
    columns: [[f64; 3]; 3],
    first: [f64; 3],
}

impl Steps {
    /// From a grid of this side (m) to another one.
    fn new(side: f64, to_side: f64, to_from: &Se3) -> Self {
        // For equal sides the quotient is exactly 1.
        let turn = to_from.rotation_matrix() * (side / to_side);
        Self {
            columns: std::array::from_fn(|k| turn.column(k).into_owned().into()),
            first: (to_from.translation / to_side).into(),
        }
    }

    fn at(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = &self.columns;
        std::array::from_fn(|i| a[i] * x + b[i] * y + c[i] * z + self.first[i])
    }

    /// Minimum and maximum index along each axis that an 8-cube with this first corner can reach; `None` far away.
    fn reach(&self, first: [f64; 3]) -> Option<[[i32; 3]; 2]> {
        let far = f64::INFINITY;
        let mut bounds = [[far; 3], [-far; 3]];
        for corner in 0..8 {
            let side = |k: usize| first[k] + 8.0 * f64::from(corner >> k & 1);
            for (i, v) in self.at([side(0), side(1), side(2)]).into_iter().enumerate() {
                bounds[0][i] = bounds[0][i].min(v);
                bounds[1][i] = bounds[1][i].max(v);
            }
        }
        let near = bounds.iter().flatten().all(|v| v.abs() < FARTHEST);
        // Margin for rounding.
        let [least, most] = bounds;
        near.then(|| {
            [
                least.map(|v| (v - 1e-3).floor() as i32),
                most.map(|v| (v + 1e-3).ceil() as i32),
            ]
        })
    }
}

/// Calls `f` with every index in a box (inclusive), z outermost.
fn for_each_between([least, most]: [[i32; 3]; 2], mut f: impl FnMut([i32; 3])) {
    for z in least[2]..=most[2] {
        for y in least[1]..=most[1] {
            for x in least[0]..=most[0] {
                f([x, y, z]);
            }
        }
    }
}

#[cfg(test)]
mod tests;

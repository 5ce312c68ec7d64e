//! Two dense maps as one: the second is sampled at the voxels and cells of the first, then both are averaged.
//!
//! Answers: what both saw, in the axes of the first. Nothing is sharpened, and nothing is made up where the second map knows nothing. Which
//! rigid motion lies between the two, others have to know.

mod grid;
mod surface;

use crate::config::DenseConfig;
use crate::world::DenseMap;
use stillpoint_geometry::Se3;

/// Voxels and cells of the second map are at most so many times as large as those of the first: each of its blocks becomes the cube of that many.
const COARSEST: f64 = 4.0;

/// Why two dense maps do not become one.
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
    /// The map in other axes, `to_from_world` being the rigid motion to them. Distances are interpolated between voxels that were seen near a surface; by the
    /// identity it is the same map.
    #[must_use]
    pub fn moved(&self, to_from_world: &Se3) -> Self {
        self.resampled(to_from_world, self.emptied())
    }

    /// Takes what another map knows, `self_from_other` being the rigid motion from its world. Its surface is sampled at the voxels of this map
    /// and averaged by weights, as frames are; counts of cells are summed. What is occupied in either stays so.
    ///
    /// # Errors
    /// Voxels or cells of the two differ too much; this map is as it was.
    pub fn absorb(&mut self, other: &Self, self_from_other: &Se3) -> Result<(), DenseMergeError> {
        self.check_sizes_of(other)?;
        let moved = other.resampled(self_from_other, self.emptied());
        surface::average(&mut self.volume, &moved.volume);
        grid::sum(&mut self.cells, &moved.cells);
        Ok(())
    }

    /// Samples the map at the voxels and cells of one in which nothing is yet.
    fn resampled(&self, to_from_world: &Se3, mut to: Self) -> Self {
        if to_from_world.is_finite() {
            surface::resample(&self.volume, &mut to.volume, to_from_world);
            grid::resample(self, &mut to, to_from_world);
        }
        to
    }

    /// The corners of a cube that a surface runs through are up to its diagonal away from it: if the other map's truncation were less, the surface would
    /// have holes.
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

/// Farther than this from the origin, in voxels or cells, nothing is kept.
const FARTHEST: f64 = 1e8;

/// How numbers of voxels of one grid are those of another: `numbers x + first`. It is asked for every voxel in the same way, so that each falls between the
/// same eight voxels of the other grid, whatever block is looked at.
struct Steps {
    columns: [[f64; 3]; 3],
    first: [f64; 3],
}

impl Steps {
    /// From a grid of this side (m) to another one.
    fn new(side: f64, to_side: f64, to_from: &Se3) -> Self {
        // Of equal sides the quotient is 1, and nothing is rounded.
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

    /// The least and the largest number along each axis that a cube of 8 can reach, whose first corner has this number; none far away.
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
        // What rounding may have lost.
        let [least, most] = bounds;
        near.then(|| {
            [
                least.map(|v| (v - 1e-3).floor() as i32),
                most.map(|v| (v + 1e-3).ceil() as i32),
            ]
        })
    }
}

/// Calls `f` with every number between two, both included, z outermost.
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

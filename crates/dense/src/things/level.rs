//! Finds horizontal surfaces and the floor in the reduced depth images.

use super::look::{Placed, tolerance};
use super::own::owners;
use crate::floor::Floor;
use crate::mesh::Mesh;
use stillpoint_geometry::Vec3;

/// Side of a patch, in points of the reduced image: its mean is four times as exact as a point, and it is wide enough for a slope.
const PATCH: usize = 4;
/// Maximum number of views used: more add nothing.
const MOST_LOOKS: usize = 60;
/// Maximum depth that is used, m.
const FAR: f64 = 5.0;

/// The floor in some views; `about_up` as for [`Floor::find`].
pub(crate) fn floor(looks: &[&Placed<'_>], about_up: &Vec3) -> Option<Floor> {
    let mut mesh = Mesh::default();
    let every = looks.len().div_ceil(MOST_LOOKS).max(1);
    for placed in looks.iter().step_by(every) {
        add(placed, &mut mesh);
    }
    Floor::find(&mesh, about_up)
}

/// Height of a table top above the floor, m: 0.72 to 0.76 by EN 527 for desks, 0.71 to 0.76 for dining tables.
const TABLE: f64 = 0.74;
/// Distance within which points are on a level, m.
const ON: f64 = 0.05;
/// Minimum share of points at table top height, among those in the boxes of tables, for the found floor to be the real one.
const TOPS: f64 = 0.2;
/// Tolerance of table top heights, m.
const TOP: f64 = 0.12;

/// Corrects a table top that was taken for the floor: then the boxes of tables have no points at table height above it.
pub(crate) fn below_tables(floor: Floor, looks: &[&Placed<'_>]) -> Floor {
    let (mut on, mut tops) = (0_usize, 0_usize);
    for placed in looks {
        let owners = owners(placed);
        for (i, owner) in owners.iter().enumerate() {
            let Some(k) = usize::from(*owner).checked_sub(1) else {
                continue;
            };
            if placed.look.sightings[k].class.name() != "dining table" {
                continue;
            }
            let Some(p) = placed.in_camera(i) else {
                continue;
            };
            let height = floor.height(&placed.world_from_camera.transform(&p));
            on += usize::from(height.abs() < ON);
            tops += usize::from((height - TABLE).abs() < TOP);
        }
    }
    let stand = tops as f64 >= TOPS * on as f64;
    Floor {
        offset: floor.offset - if stand { 0.0 } else { TABLE },
        ..floor
    }
}

/// Adds the surface of a view, in patches.
fn add(placed: &Placed<'_>, mesh: &mut Mesh) {
    let grid = placed.grid;
    let (w, h) = (grid.columns / PATCH, grid.rows / PATCH);
    let mut corners: Vec<Option<(u32, f64)>> = Vec::with_capacity(w * h);
    for k in 0..w * h {
        let mean = patch(placed, [k % w, k / w]);
        corners.push(mean.map(|(p, z)| {
            let p = placed.world_from_camera.transform(&p);
            mesh.positions.push(p.map(|v| v as f32).into());
            (mesh.positions.len() as u32 - 1, z)
        }));
    }
    for k in 0..(w * h).saturating_sub(w) {
        if k % w + 1 == w {
            continue;
        }
        // Counter-clockwise as seen from the camera.
        for t in [[k, k + w, k + 1], [k + 1, k + w, k + w + 1]] {
            let [Some(a), Some(b), Some(c)] = t.map(|i| corners[i]) else {
                continue;
            };
            let depths = [a.1, b.1, c.1];
            let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
            let most = depths.iter().copied().fold(0.0, f64::max);
            if most - least < 0.15 * most {
                mesh.triangles.push([a.0, b.0, c.0]);
            }
        }
    }
}

/// The centre of a patch in the camera, and its depth; `None` across an edge or with missing depth.
fn patch(placed: &Placed<'_>, [x, y]: [usize; 2]) -> Option<(Vec3, f64)> {
    let (mut sum, mut least, mut most) = (Vec3::zeros(), f64::INFINITY, 0.0_f64);
    for j in 0..PATCH {
        for i in 0..PATCH {
            let at = (y * PATCH + j) * placed.grid.columns + x * PATCH + i;
            let p = placed.in_camera(at)?;
            sum += p;
            (least, most) = (least.min(p.z), most.max(p.z));
        }
    }
    let mean = sum / (PATCH * PATCH) as f64;
    let flat = most - least < 2.0 * tolerance(mean.z) && mean.z < FAR;
    flat.then_some((mean, mean.z))
}

//! The detections that points are compared with, and the object size by their boxes.

use super::assign::Sights;
use super::look::Placed;
use super::own::Seen;
use stillpoint_geometry::Vec3;

/// Side of the point cells as a share of an object's size, and its bounds, m.
const CELL: f64 = 1.0 / 24.0;
pub(crate) const CELLS: [f64; 2] = [0.005, 0.03];
/// Maximum number of detections that points are compared with: more add nothing.
pub(crate) const MOST_COMPARED: usize = 24;
pub(crate) struct Frames<'a> {
    pub(crate) compared: Vec<Seen>,
    pub(crate) boxes: Vec<Option<[f32; 4]>>,
    pub(crate) sights: &'a Sights<'a>,
}

impl<'a> Frames<'a> {
    pub(crate) fn new(seen: &[Seen], sights: &'a Sights<'a>) -> Self {
        let every = seen.len().div_ceil(MOST_COMPARED).max(1);
        let compared: Vec<Seen> = seen.iter().step_by(every).copied().collect();
        let measured = compared.iter().map(|(l, s)| sights.measured[*l][*s]);
        Self {
            boxes: measured.collect(),
            compared,
            sights,
        }
    }

    pub(crate) fn sides(&self, at: &Vec3) -> Vec<f64> {
        let side = |(l, s): &Seen| {
            let placed = &self.sights.looks[*l];
            longer(&placed.look.sightings[*s].bounds) / placed.grid.camera.fx * placed.depth(at)
        };
        self.compared.iter().map(side).collect()
    }
}

fn longer(bounds: &[f32; 4]) -> f64 {
    f64::from((bounds[2] - bounds[0]).max(bounds[3] - bounds[1]))
}

/// Side of the cells for an object of the boxes' size, m.
pub(crate) fn cell(seen: &[Seen], looks: &[Placed<'_>]) -> f64 {
    let size = |(l, s): &Seen| {
        let sighting = &looks[*l].look.sightings[*s];
        let z = 0.5 * f64::from(sighting.depths[0] + sighting.depths[1]);
        longer(&sighting.bounds) / looks[*l].grid.camera.fx * z
    };
    let largest = seen.iter().map(size).fold(0.0, f64::max);
    (CELL * largest).clamp(CELLS[0], CELLS[1])
}

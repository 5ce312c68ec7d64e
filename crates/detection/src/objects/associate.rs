//! Which detection is of which object.

use super::measurement::Measurement;
use super::occlusion::Occlusion;
use super::track::Track;
use super::view::View;
use pathfinding::kuhn_munkres::kuhn_munkres;
use pathfinding::matrix::Matrix;

/// Integer units of one of benefit: the library needs a total order and exact sums.
const UNITS: f64 = 1e6;
/// What no sum of benefits outweighs.
const FORBIDDEN: i64 = -1_000_000_000_000;
/// Head start of a confirmed object over one that was seen once, so that a false alarm does not take its detection.
const CONFIRMED: f64 = 0.2;

/// For each track its detection and that detection's index: the assignment of the greatest sum of benefits (Kuhn 1955, Munkres 1957) among the pairs that
/// pass the gates. Of the surfaces in a box, those of objects in front are taken away.
pub(super) fn associate(
    tracks: &[Track],
    view: &View,
    measurements: &[Measurement],
    share: f64,
) -> Vec<Option<(usize, Measurement)>> {
    if tracks.is_empty() || measurements.is_empty() {
        return vec![None; tracks.len()];
    }
    let occlusion = Occlusion::new(tracks, view);
    let own = |track: &Track, m: &Measurement| Measurement {
        modes: occlusion.surfaces(track, view, m),
        ..m.clone()
    };
    // Each track has a column of its own that stands for no detection.
    let columns = measurements.len() + tracks.len();
    let mut weights = Matrix::new(tracks.len(), columns, FORBIDDEN);
    for (i, track) in tracks.iter().enumerate() {
        weights[(i, measurements.len() + i)] = 0;
        for (j, m) in measurements.iter().enumerate() {
            if let Some(fit) = track.fit(view, &own(track, m), share) {
                let bonus = if track.confirmed() { CONFIRMED } else { 0.0 };
                // Any match is better than none.
                weights[(i, j)] = ((1.0 + fit.benefit + bonus) * UNITS) as i64;
            }
        }
    }
    let (_, assigned) = kuhn_munkres(&weights);
    tracks
        .iter()
        .zip(assigned)
        .map(|(track, j)| measurements.get(j).map(|m| (j, own(track, m))))
        .collect()
}

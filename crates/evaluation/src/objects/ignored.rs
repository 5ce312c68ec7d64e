//! Ignored tracks: on objects that exist but are not in the list of moving ones.

use super::{TrackFrame, iou};
use stillpoint_geometry::assign;

/// Overlap from which a found box matches the truth, before it may be ignored: that of MOTChallenge.
const TRUE: f64 = 0.5;
/// Fraction of a found box inside an ignored one from which it is ignored.
const INSIDE: f64 = 0.5;
/// Intersection over union with an ignored box from which it is ignored.
const SAME: f64 = 0.3;

/// The frame without found boxes in ignored regions. Boxes that match the truth always count. As in MOTChallenge the assignment to the
/// truth comes first.
pub(super) fn without_ignored(frame: &TrackFrame) -> TrackFrame {
    let mut kept = frame.clone();
    if frame.ignored.is_empty() {
        return kept;
    }
    let overlap = |t: usize, d: usize| iou(&frame.truth[t].bounds, &frame.found[d].bounds);
    let values: Vec<Vec<f64>> = (0..frame.truth.len())
        .map(|t| {
            (0..frame.found.len())
                .map(|d| {
                    if overlap(t, d) >= TRUE {
                        overlap(t, d)
                    } else {
                        0.0
                    }
                })
                .collect()
        })
        .collect();
    let mut right = vec![false; frame.found.len()];
    for (t, d) in assign(&values).into_iter().enumerate() {
        if let Some(d) = d.filter(|&d| values[t][d] > 0.0) {
            right[d] = true;
        }
    }
    let mut d = 0;
    kept.found.retain(|f| {
        d += 1;
        right[d - 1] || !frame.ignored.iter().any(|b| covers(b, &f.bounds))
    });
    kept
}

fn covers(place: &[f64; 4], found: &[f64; 4]) -> bool {
    let cut = [
        found[0].max(place[0]),
        found[1].max(place[1]),
        found[2].min(place[2]),
        found[3].min(place[3]),
    ];
    // The overlap of a box and its own part is the fraction of the part.
    let inside = cut[0] < cut[2] && cut[1] < cut[3] && iou(&cut, found) >= INSIDE;
    inside || iou(place, found) >= SAME
}

#[cfg(test)]
mod tests {
    use super::super::TrackedBox;
    use super::*;

    fn at(id: u32, bounds: [f64; 4]) -> TrackedBox {
        TrackedBox {
            id,
            bounds,
            motion: None,
        }
    }

    #[test]
    fn only_tracks_on_ignored_objects_are_removed() {
        let place = [100.0, 100.0, 200.0, 300.0];
        let frame = TrackFrame {
            truth: vec![at(1, [110.0, 100.0, 200.0, 300.0])],
            found: vec![
                at(1, [112.0, 100.0, 200.0, 300.0]),
                at(2, [100.0, 105.0, 198.0, 300.0]),
                at(3, [180.0, 100.0, 280.0, 300.0]),
                at(4, [120.0, 150.0, 150.0, 200.0]),
            ],
            ignored: vec![place],
            ..TrackFrame::default()
        };
        let ids = |f: TrackFrame| f.found.iter().map(|b| b.id).collect::<Vec<_>>();
        assert_eq!(ids(without_ignored(&frame)), [1, 3]);
        let nothing = TrackFrame {
            ignored: Vec::new(),
            ..frame
        };
        assert_eq!(ids(without_ignored(&nothing)), [1, 2, 3, 4]);
    }
}

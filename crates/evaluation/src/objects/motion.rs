//! Errors of position and velocity, and summaries of tracks without truth.

use super::{TrackFrame, share};
use crate::Statistics;
use std::collections::BTreeMap;
use stillpoint_geometry::Se3;

/// Errors of right boxes for which both motions are known; `None` if there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionErrors {
    /// Difference of the speeds, m/s.
    pub speed: Option<Statistics>,
    /// Length of the difference of the velocities, m/s; requires the transform between both worlds.
    pub velocity: Option<Statistics>,
    /// Distance of the positions, m; requires the same.
    pub position: Option<Statistics>,
}

pub(super) fn errors(
    frames: &[TrackFrame],
    matches: &[Vec<(usize, usize)>],
    truth_from_found: Option<&Se3>,
) -> MotionErrors {
    let (mut speed, mut velocity, mut position) = (Vec::new(), Vec::new(), Vec::new());
    for (frame, pairs) in frames.iter().zip(matches) {
        for &(t, d) in pairs {
            let (Some(truth), Some(found)) = (frame.truth[t].motion, frame.found[d].motion) else {
                continue;
            };
            speed.push((truth.velocity.norm() - found.velocity.norm()).abs());
            if let Some(pose) = truth_from_found {
                let turned = pose.rotation * found.velocity;
                velocity.push((truth.velocity - turned).norm());
                position.push((truth.position - pose.transform(&found.position)).norm());
            }
        }
    }
    MotionErrors {
        speed: Statistics::of(&speed),
        velocity: Statistics::of(&velocity),
        position: Statistics::of(&position),
    }
}

/// A track in a frame, without truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackState {
    /// Time, s.
    pub stamp: f64,
    /// Id of the track.
    pub id: u32,
    /// Speed, m/s, if known.
    pub speed: Option<f64>,
    /// Whether it is assumed at rest.
    pub parked: bool,
}

/// Summary of tracks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackSummary {
    /// Number of tracks.
    pub ids: usize,
    /// Tracks summed over the frames.
    pub track_frames: usize,
    /// Speeds, m/s.
    pub speed: Option<Statistics>,
    /// Fraction of the speeds above the limit, 0 to 1.
    pub too_fast: f64,
    /// Fraction of the track-frames that are parked, 0 to 1.
    pub parked: f64,
    /// Number of tracks that were ever parked.
    pub ever_parked: usize,
    /// Visible time of a track from its first frame to the first in which it is parked, s.
    pub seconds_to_park: Option<Statistics>,
}

/// Summarises tracks; `limit` is the speed (m/s) above which it is too fast. The rows are in order of time.
#[must_use]
pub fn track_summary(rows: &[TrackState], limit: f64) -> TrackSummary {
    let speed: Vec<f64> = rows.iter().filter_map(|r| r.speed).collect();
    let (mut here, mut parked) = (BTreeMap::new(), BTreeMap::new());
    let mut before = f64::NAN;
    for frame in rows.chunk_by(|a, b| a.stamp == b.stamp) {
        for r in frame {
            // The last frame that contained it, and its visible time.
            let (last, seconds) = here.entry(r.id).or_insert((r.stamp, 0.0));
            if *last == before {
                *seconds += r.stamp - before;
            }
            *last = r.stamp;
            if r.parked {
                parked.entry(r.id).or_insert(*seconds);
            }
        }
        before = frame[0].stamp;
    }
    let seconds: Vec<f64> = parked.into_values().collect();
    let of = |count: usize, all: usize| share(count as f64, all as f64);
    TrackSummary {
        ids: here.len(),
        track_frames: rows.len(),
        too_fast: of(speed.iter().filter(|s| **s > limit).count(), speed.len()),
        speed: Statistics::of(&speed),
        parked: of(rows.iter().filter(|r| r.parked).count(), rows.len()),
        ever_parked: seconds.len(),
        seconds_to_park: Statistics::of(&seconds),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_are_summarised() {
        let row = |stamp, id, speed, parked| TrackState {
            stamp,
            id,
            speed,
            parked,
        };
        let rows = [
            row(1.0, 7, None, false),
            row(1.0, 8, Some(3.0), false),
            row(1.5, 7, Some(0.25), true),
            row(2.0, 7, Some(0.5), true),
            row(2.0, 8, Some(1.0), false),
        ];
        let s = track_summary(&rows, 2.5);
        assert_eq!((s.ids, s.track_frames, s.ever_parked), (2, 5, 1));
        assert_eq!((s.too_fast, s.parked), (0.25, 0.4));
        assert_eq!(s.speed.unwrap().median, 0.75);
        assert_eq!(s.seconds_to_park.unwrap().max, 0.5);
        assert_eq!(track_summary(&[], 2.5), TrackSummary::default());
    }

    #[test]
    fn time_out_of_sight_does_not_count_for_parking() {
        let row = |stamp, id, parked| TrackState {
            stamp,
            id,
            speed: None,
            parked,
        };
        let mut rows = Vec::new();
        for i in 0..40 {
            let stamp = f64::from(i) * 0.25;
            rows.push(row(stamp, 1, false));
            // Visible for a second, away for five, back for half a second when it is parked.
            if !(4..24).contains(&i) {
                rows.push(row(stamp, 2, i >= 26));
            }
        }
        let s = track_summary(&rows, 2.5);
        assert_eq!((s.ever_parked, s.seconds_to_park.unwrap().max), (1, 1.25));
    }
}

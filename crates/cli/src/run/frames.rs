//! What became of every frame: `frames.csv`, the stretches in which tracking was lost, and the pieces of map.

use crate::run::summary::{LostStretch, PieceJson};
use std::collections::BTreeMap;
use stillpoint::datasets::StampedPose;
use stillpoint::imaging::FrameId;
use stillpoint::map::{MapView, PieceId};
use stillpoint::slam::{FrameReport, Outcome, Trajectory, TrajectoryEntry};

/// Fewer landmarks may agree on a pose by chance: such poses are not written.
pub(crate) const MIN_INLIERS: u32 = 30;

/// What became of a frame.
#[derive(Clone, Debug, PartialEq)]
enum State {
    /// It began a piece of map.
    Begun,
    /// Its pose was measured.
    Tracked,
    /// The camera was found again.
    Relocalised,
    /// No pose was found, and why.
    Lost(String),
}

impl State {
    fn name(&self) -> &'static str {
        match self {
            Self::Begun => "initialised",
            Self::Tracked => "tracked",
            Self::Relocalised => "relocalised",
            Self::Lost(_) => "lost",
        }
    }
}

/// A line of `frames.csv`.
#[derive(Clone, Debug)]
struct Line {
    frame: FrameId,
    stamp: f64,
    state: State,
    /// The piece of map that its pose was in when it was measured.
    piece: Option<PieceId>,
    inliers: u32,
    is_keyframe: bool,
}

/// All frames of a run, in order.
#[derive(Default)]
pub(crate) struct Frames(Vec<Line>);

/// Poses of one piece of map, in its own frame of reference.
pub(crate) struct Piece {
    pub(crate) id: PieceId,
    /// Keyframes in the final map.
    pub(crate) keyframes: usize,
    /// Final poses of the tracked frames.
    pub(crate) final_poses: Vec<StampedPose>,
    /// Poses as known at each frame, of those that were in this piece then.
    pub(crate) online_poses: Vec<StampedPose>,
}

impl Frames {
    /// Takes a frame's report.
    pub(crate) fn take(&mut self, report: &FrameReport) {
        let inliers = report.counts.inliers;
        let state = match report.outcome {
            Outcome::Lost { reason, .. } => State::Lost(reason.to_string()),
            Outcome::Initialised => State::Begun,
            _ if inliers < MIN_INLIERS => State::Lost(format!("fewer than {MIN_INLIERS} inliers")),
            Outcome::Tracked => State::Tracked,
            Outcome::Relocalised { .. } => State::Relocalised,
        };
        let lost = matches!(state, State::Lost(_));
        self.0.push(Line {
            frame: report.frame,
            stamp: report.stamp,
            state,
            piece: report.piece.filter(|_| !lost),
            inliers,
            is_keyframe: report.is_keyframe,
        });
    }

    /// The stretches of frames without a pose: why, how long, and what ended them.
    pub(crate) fn lost(&self) -> Vec<LostStretch> {
        let mut stretches: Vec<LostStretch> = Vec::new();
        let mut open: Option<f64> = None;
        for line in &self.0 {
            match (&line.state, open, stretches.last_mut()) {
                (State::Lost(_), Some(_), Some(stretch)) => stretch.last = line.frame.0,
                (State::Lost(reason), ..) => {
                    open = Some(line.stamp);
                    stretches.push(LostStretch {
                        first: line.frame.0,
                        last: line.frame.0,
                        reason: reason.clone(),
                        seconds: 0.0,
                        then: "the end".into(),
                    });
                }
                (state, Some(since), Some(stretch)) => {
                    stretch.seconds = line.stamp - since;
                    stretch.then = match state {
                        State::Begun => "a map began",
                        _ => "found again",
                    }
                    .into();
                    open = None;
                }
                _ => {}
            }
        }
        if let (Some(since), Some(stretch), Some(line)) =
            (open, stretches.last_mut(), self.0.last())
        {
            stretch.seconds = line.stamp - since;
        }
        stretches
    }

    /// The poses by piece of the final map; the piece with most frames first, which is the one that a trajectory is of.
    pub(crate) fn pieces(&self, trajectory: &Trajectory, view: &MapView) -> Vec<Piece> {
        let mut by_piece: BTreeMap<PieceId, Vec<(TrajectoryEntry, StampedPose)>> = BTreeMap::new();
        for (entry, world_from_camera) in trajectory.resolve(view) {
            // Until the map holds it, a keyframe is a piece of its own.
            let piece = view.piece_of(entry.pose.reference);
            let piece = piece.unwrap_or(PieceId(entry.pose.reference.0));
            if entry.inliers >= MIN_INLIERS {
                let pose = StampedPose {
                    stamp: entry.stamp,
                    world_from_camera,
                };
                by_piece.entry(piece).or_default().push((entry, pose));
            }
        }
        let keyframes: BTreeMap<PieceId, usize> = view.pieces().into_iter().collect();
        let mut pieces: Vec<Piece> = by_piece
            .into_iter()
            .map(|(id, poses)| Piece {
                id,
                keyframes: keyframes.get(&id).copied().unwrap_or(0),
                online_poses: poses
                    .iter()
                    .filter(|(entry, _)| self.piece_at(entry.frame) == Some(id))
                    .map(|(entry, _)| StampedPose {
                        stamp: entry.stamp,
                        world_from_camera: entry.pose.online_world_from_camera,
                    })
                    .collect(),
                final_poses: poses.into_iter().map(|(_, pose)| pose).collect(),
            })
            .collect();
        // Stable: of two with as many frames the older one.
        pieces.sort_by_key(|p| std::cmp::Reverse(p.final_poses.len()));
        pieces
    }

    /// The piece that a frame's pose was in when it was measured.
    fn piece_at(&self, frame: FrameId) -> Option<PieceId> {
        let at = self.0.binary_search_by_key(&frame, |l| l.frame).ok()?;
        self.0[at].piece
    }

    /// The text of `frames.csv`. `final_piece` says which piece a piece has become part of.
    pub(crate) fn to_csv(&self, trajectory: &Trajectory, view: &MapView) -> String {
        let entries = trajectory.entries();
        let mut text =
            String::from("frame,stamp,state,piece,final_piece,inliers,keyframe,reason\n");
        for line in &self.0 {
            let entry = entries.binary_search_by_key(&line.frame, |e| e.frame).ok();
            let last = entry.and_then(|i| view.piece_of(entries[i].pose.reference));
            let id = |piece: Option<PieceId>| piece.map_or_else(String::new, |p| p.to_string());
            let reason = match &line.state {
                State::Lost(reason) => reason,
                _ => "",
            };
            text += &format!(
                "{},{:.6},{},{},{},{},{},{reason}\n",
                line.frame,
                line.stamp,
                line.state.name(),
                id(line.piece),
                id(last.or(line.piece).filter(|_| line.piece.is_some())),
                line.inliers,
                u8::from(line.is_keyframe),
            );
        }
        text
    }
}

/// The pieces of a map as `summary.json` has them, each with the file of its poses.
pub(crate) fn describe(pieces: &[Piece]) -> Vec<PieceJson> {
    pieces
        .iter()
        .enumerate()
        .map(|(i, piece)| PieceJson {
            id: piece.id.0,
            frames: piece.final_poses.len(),
            keyframes: piece.keyframes,
            trajectory: file_name(i, piece.id),
        })
        .collect()
}

/// The file of the poses of a piece: the first is the run's trajectory.
pub(crate) fn file_name(number: usize, id: PieceId) -> String {
    if number == 0 {
        "trajectory.txt".to_owned()
    } else {
        format!("trajectory_piece_{id}.txt")
    }
}

/// Whether a file of this name holds the poses of a further piece.
pub(crate) fn is_piece_file(name: &str) -> bool {
    let id = name.strip_prefix("trajectory_piece_");
    let id = id.and_then(|rest| rest.strip_suffix(".txt"));
    id.is_some_and(|id| id.parse::<u32>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::slam::{FrameCounts, LostReason, Segments};

    fn report(frame: u32, outcome: Outcome, piece: Option<u32>, inliers: u32) -> FrameReport {
        FrameReport {
            frame: FrameId(frame),
            stamp: f64::from(frame) / 10.0,
            outcome,
            world_from_camera: None,
            verdicts: [].into(),
            segments: Segments::default(),
            objects: [].into(),
            counts: FrameCounts {
                inliers,
                ..FrameCounts::default()
            },
            is_keyframe: frame == 0,
            piece: piece.map(PieceId),
            map_version: 0,
        }
    }

    fn frames() -> Frames {
        let lost = |since: u32, reason| Outcome::Lost {
            since: FrameId(since),
            reason,
        };
        let found = Outcome::Relocalised {
            since: FrameId(2),
            with: stillpoint::map::KeyframeId(0),
        };
        let mut frames = Frames::default();
        let dark = LostReason::FewFeatures;
        for r in [
            report(0, Outcome::Initialised, Some(0), 200),
            report(1, Outcome::Tracked, Some(0), 150),
            report(2, lost(2, dark), None, 0),
            report(3, lost(2, dark), None, 0),
            report(4, found, Some(0), 80),
            report(5, Outcome::Tracked, Some(0), 12),
            report(6, Outcome::Initialised, Some(6), 180),
            report(7, lost(7, LostReason::FewMatches), None, 0),
        ] {
            frames.take(&r);
        }
        frames
    }

    #[test]
    fn losses_have_a_reason_a_length_and_an_end() {
        let lost = frames().lost();
        let told: Vec<_> = lost
            .iter()
            .map(|l| (l.first, l.last, l.then.as_str()))
            .collect();
        assert_eq!(
            told,
            [
                (2, 3, "found again"),
                (5, 5, "a map began"),
                (7, 7, "the end")
            ]
        );
        assert!((lost[0].seconds - 0.2).abs() < 1e-9, "{}", lost[0].seconds);
        assert_eq!(lost[0].reason, "too few keypoints in the image");
        assert_eq!(lost[1].reason, "fewer than 30 inliers");
    }

    #[test]
    fn every_frame_has_a_line() {
        let csv = frames().to_csv(&Trajectory::default(), &MapView::default());
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines.len(), 9);
        assert_eq!(lines[1], "0,0.000000,initialised,0,0,200,1,");
        assert_eq!(
            lines[3],
            "2,0.200000,lost,,,0,0,too few keypoints in the image"
        );
        assert_eq!(lines[5], "4,0.400000,relocalised,0,0,80,0,");
        assert_eq!(lines[7], "6,0.600000,initialised,6,6,180,0,");
    }
}

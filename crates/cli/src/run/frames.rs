//! Outcome of every frame: `frames.csv`, and the intervals in which tracking was lost.

use crate::run::submaps::{Submap, by_submap, is_posed};
use crate::run::summary::{LostStretch, StillStretch};
use std::collections::BTreeMap;
use stillpoint::datasets::StampedPose;
use stillpoint::imaging::{FrameId, Standstill, Still};
use stillpoint::map::{MapView, SubmapId};
use stillpoint::slam::{FrameReport, FrameState, Outcome, Trajectory};

/// Loss reason of a frame whose pose was revoked.
const WITHDRAWN: &str = "its pose rode on what moves and was withdrawn";

#[derive(Clone, Debug)]
struct Line {
    frame: FrameId,
    stamp: f64,
    state: FrameState,
    /// Whether it started a map.
    begins: bool,
    loss: String,
    /// Its submap when the pose was measured.
    submap: Option<SubmapId>,
    inliers: u32,
    is_keyframe: bool,
    /// Which of its images repeat the previous ones.
    still: Option<Standstill>,
}

#[derive(Clone, Default)]
pub(crate) struct Frames(Vec<Line>);

impl Frames {
    pub(crate) fn take(&mut self, report: &FrameReport) {
        let state = report.state();
        self.0.push(Line {
            frame: report.frame,
            stamp: report.stamp,
            state,
            begins: report.outcome == Outcome::Initialised,
            loss: report.loss().unwrap_or_default(),
            submap: report.submap.filter(|_| state != FrameState::Lost),
            inliers: report.counts.inliers,
            is_keyframe: report.is_keyframe,
            still: report.still,
        });
    }

    /// Updates the states from the final trajectory: the first frames of a map may have been tracked again, so that others of them have
    /// poses.
    pub(crate) fn settle(&mut self, trajectory: &Trajectory) {
        let entries = trajectory.entries();
        for line in &mut self.0 {
            let at = entries.binary_search_by_key(&line.frame, |e| e.frame);
            let posed = at.is_ok_and(|i| is_posed(&entries[i]));
            let lost = line.state == FrameState::Lost;
            if lost && posed {
                (line.state, line.loss) = (FrameState::Undecided, String::new());
            } else if !lost && !posed {
                (line.state, line.loss) = (FrameState::Lost, WITHDRAWN.into());
            }
        }
    }

    /// Number of frames with a pose that were tracked while it was undecided which regions move.
    pub(crate) fn undecided(&self) -> usize {
        let undecided = |l: &&Line| l.state == FrameState::Undecided;
        self.0.iter().filter(undecided).count()
    }

    /// The intervals without a pose, with reason, duration, and how they ended.
    pub(crate) fn lost(&self) -> Vec<LostStretch> {
        let mut stretches: Vec<LostStretch> = Vec::new();
        let mut open: Option<f64> = None;
        for line in &self.0 {
            match (line.state, open, stretches.last_mut()) {
                (FrameState::Lost, Some(_), Some(stretch)) => stretch.last = line.frame.0,
                (FrameState::Lost, ..) => {
                    open = Some(line.stamp);
                    stretches.push(LostStretch {
                        first: line.frame.0,
                        last: line.frame.0,
                        reason: line.loss.clone(),
                        seconds: 0.0,
                        then: "the end".into(),
                    });
                }
                (_, Some(since), Some(stretch)) => {
                    stretch.seconds = line.stamp - since;
                    let then = ["found again", "a map began"][usize::from(line.begins)];
                    stretch.then = then.into();
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

    pub(crate) fn still(&self) -> Vec<StillStretch> {
        let mut stretches: Vec<StillStretch> = Vec::new();
        let mut open: Option<(Still, FrameId)> = None;
        for line in &self.0 {
            let Some(still) = line.still else {
                open = None;
                continue;
            };
            let what = (still.what, still.since);
            if open.replace(what) != Some(what) {
                stretches.push(StillStretch {
                    what: still.what.into(),
                    first: line.frame.0,
                    ..StillStretch::default()
                });
            }
            if let Some(stretch) = stretches.last_mut() {
                stretch.last = line.frame.0;
                stretch.frames = still.frames;
                stretch.seconds = still.seconds;
            }
        }
        stretches
    }

    /// The poses by submap of the final map, in the order of [`by_submap`].
    pub(crate) fn submaps(&self, trajectory: &Trajectory, view: &MapView) -> Vec<Submap> {
        let keyframes: BTreeMap<SubmapId, usize> = view.submaps().into_iter().collect();
        by_submap(trajectory, view)
            .into_iter()
            .map(|(id, poses)| Submap {
                id,
                keyframes: keyframes.get(&id).copied().unwrap_or(0),
                online_poses: poses
                    .iter()
                    .filter(|(entry, _)| self.submap_at(entry.frame) == Some(id))
                    .map(|(entry, _)| StampedPose {
                        stamp: entry.stamp,
                        world_from_camera: entry.pose.online_world_from_camera,
                    })
                    .collect(),
                frames: poses.iter().map(|(entry, _)| entry.frame).collect(),
                final_poses: poses.into_iter().map(|(_, pose)| pose).collect(),
            })
            .collect()
    }

    /// The submap of a frame's pose when it was measured.
    fn submap_at(&self, frame: FrameId) -> Option<SubmapId> {
        let at = self.0.binary_search_by_key(&frame, |l| l.frame).ok()?;
        self.0[at].submap
    }

    /// The text of `frames.csv`. `view` resolves merged submaps.
    pub(crate) fn to_csv(&self, trajectory: &Trajectory, view: &MapView) -> String {
        let entries = trajectory.entries();
        let mut text =
            String::from("frame,stamp,state,submap,final_submap,inliers,keyframe,reason\n");
        for line in &self.0 {
            let entry = entries.binary_search_by_key(&line.frame, |e| e.frame).ok();
            let last = entry.and_then(|i| view.submap_of(entries[i].pose.reference));
            let id = |submap: Option<SubmapId>| submap.map_or_else(String::new, |p| p.to_string());
            let reason = match (line.state, line.still) {
                (FrameState::Lost, _) => line.loss.clone(),
                (_, Some(still)) => format!("{} stands still", still.what.name()),
                _ => String::new(),
            };
            text += &format!(
                "{},{:.6},{},{},{},{},{},{reason}\n",
                line.frame,
                line.stamp,
                line.state.name(),
                id(line.submap),
                id(last.or(line.submap).filter(|_| line.submap.is_some())),
                line.inliers,
                u8::from(line.is_keyframe),
            );
        }
        text
    }
}

#[cfg(test)]
mod tests;

//! The verdict on a run, in one sentence: coverage, accuracy, and the worst problem with its remedy.

use super::model::RunData;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use stillpoint_slam::{FrameState, LostReason};

/// Error of the final poses from which a result counts as off, m, if [`OFF_SHARE`] is exceeded too.
const OFF: f64 = 0.05;
/// Error as a share of the camera's path from which a result counts as off: good odometry drifts by about 1 % (KITTI's table, Geiger et al.
/// 2012).
const OFF_SHARE: f64 = 0.01;
/// Share of frames without a pose, unreadable or dropped, from which a result counts as incomplete; chosen.
const MUCH: f64 = 0.1;
/// Share of the images that must show a number of people at once, chosen: a higher number in a single image may be an error of the
/// detector.
const SHOWN: f64 = 0.05;

/// Severity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Concern {
    /// No problem.
    #[default]
    None,
    /// The result is worse than it could be.
    Some,
    /// The result should not be used as it is.
    Grave,
}

/// Verdict on a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// Severity.
    pub concern: Concern,
    /// One sentence.
    pub text: String,
}

struct Problem {
    concern: Concern,
    text: String,
}

fn problem(concern: Concern, text: String) -> Option<Problem> {
    Some(Problem { concern, text })
}

impl RunData {
    /// Sets the verdict, from all other data of the report.
    pub fn judge(&mut self) {
        let facts = Facts::of(self);
        // The most severe one; of equals the first, as it explains the later ones.
        let worst = facts.problems().into_iter().rev().max_by_key(|p| p.concern);
        let (concern, end) = worst.map_or_else(
            || (Concern::None, "nothing to worry about".to_owned()),
            |p| (p.concern, p.text),
        );
        let known = [facts.coverage(), facts.accuracy()];
        let known: Vec<String> = known.into_iter().filter(|s| !s.is_empty()).collect();
        self.verdict = Verdict {
            concern,
            text: format!("{}; {end}.", known.join("; ")),
        };
    }
}

struct Facts<'a> {
    run: &'a RunData,
    frames: usize,
    tracked: usize,
    missed: usize,
    /// RMSE against the ground truth, m, and whether the camera moved.
    error: Option<(f64, bool)>,
    way: f64,
    people: usize,
}

impl<'a> Facts<'a> {
    fn of(run: &'a RunData) -> Self {
        let f = &run.frames;
        let poses = f.pose.0.chunks_exact(7);
        let posed: Vec<[f64; 3]> = poses
            .map(|p| [0, 1, 2].map(|k| f64::from(p[k])))
            .filter(|p| p.iter().all(|x| x.is_finite()))
            .collect();
        let step = |w: &[[f64; 3]]| -> f64 {
            let squares = (0..3).map(|k| (w[1][k] - w[0][k]).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let count = |name: &str| count(&run.summary, name);
        Self {
            run,
            frames: count("/frames").unwrap_or(f.id.0.len()),
            tracked: count("/tracked").unwrap_or(posed.len()),
            missed: count("/skipped").unwrap_or(0) + count("/live/dropped").unwrap_or(0),
            error: error(&run.summary),
            way: posed.windows(2).map(step).sum(),
            people: people(run),
        }
    }

    fn filter_is_off(&self) -> bool {
        let mut lines = self.run.config.lines();
        let in_filter = lines.by_ref().any(|l| l.trim() == "[static_filter]");
        let mut own = lines.take_while(|l| !l.starts_with('['));
        in_filter && own.any(|l| l.split('#').next().unwrap_or(l).trim() == "preset = \"off\"")
    }

    fn coverage(&self) -> String {
        let frames = match (self.tracked, self.frames) {
            (_, 0) => "No frame was read".to_owned(),
            (0, n) => format!("Tracked none of {n} frames"),
            (t, n) if t == n && self.missed == 0 => format!("Tracked all {n} frames"),
            (t, n) => format!("Tracked {t} of {} frames", n + self.missed),
        };
        match self.people {
            0 => frames,
            1 => frames + " with a person in view",
            n => frames + &format!(" among up to {n} people"),
        }
    }

    fn accuracy(&self) -> String {
        match self.error {
            Some((rmse, true)) => format!("{:.1} mm from the truth", 1e3 * rmse),
            Some((rmse, false)) => format!("drifted {:.1} mm while it stood still", 1e3 * rmse),
            None => {
                let mut sigmas: Vec<f32> = self.run.frames.sigma_mm.0.clone();
                sigmas.retain(|s| s.is_finite());
                sigmas.sort_unstable_by(f32::total_cmp);
                let Some(sigma) = sigmas.get(sigmas.len() / 2) else {
                    return String::new();
                };
                format!("certain to {sigma:.1} mm by its own reckoning, as no truth is known")
            }
        }
    }

    /// The problems found; of two equally severe ones the first explains the other.
    fn problems(&self) -> Vec<Problem> {
        [
            self.without_pose(),
            self.far_off(),
            self.ridden(),
            self.lost(),
            self.parted(),
            self.unread(),
            self.dropped(),
            self.undecided(),
            self.detector(),
            self.interrupted(),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn without_pose(&self) -> Option<Problem> {
        if self.frames > 0 && self.tracked > 0 {
            return None;
        }
        let reason = self.losses().first().map(|l| l.reason.clone());
        let text = match reason {
            Some(reason) => format!("{reason}: {}", remedy(&reason)),
            None => "check that the recording holds colour and depth images".to_owned(),
        };
        problem(Concern::Grave, text)
    }

    fn far_off(&self) -> Option<Problem> {
        let (rmse, _) = self.error?;
        if rmse < OFF || rmse < OFF_SHARE * self.way {
            return None;
        }
        let why = if self.filter_is_off() {
            "that is far off, and the static filter was off: set static_filter.preset to \"default\""
        } else {
            "that is far off: check the camera's calibration and look at the frame of the largest error"
        };
        problem(Concern::Grave, why.to_owned())
    }

    /// Without ground truth the error is unknown.
    fn ridden(&self) -> Option<Problem> {
        if self.error.is_some() || self.people == 0 || !self.filter_is_off() {
            return None;
        }
        let text = "the static filter was off among people, so poses may follow them: set static_filter.preset to \"default\"";
        problem(Concern::Some, text.to_owned())
    }

    fn lost(&self) -> Option<Problem> {
        let losses = self.losses();
        let longest = losses
            .iter()
            .rev()
            .max_by(|a, b| a.seconds.total_cmp(&b.seconds))?;
        let lost = self.frames.saturating_sub(self.tracked);
        let much = lost as f64 > MUCH * self.frames as f64;
        let concern = if much { Concern::Grave } else { Concern::Some };
        let Loss {
            first,
            last,
            seconds,
            reason,
            then,
        } = longest;
        let frames = if first == last {
            format!("frame {first}")
        } else {
            format!("frames {first} to {last}")
        };
        let longest = match losses.len() {
            1 => String::new(),
            n => format!(", the longest of {n} losses"),
        };
        let then = match then.as_str() {
            "" | "the end" => String::new(),
            other => format!(", then {other}"),
        };
        let help = remedy(reason);
        let text = format!("no pose in {frames} ({seconds:.1} s{longest}: {reason}){then}: {help}");
        problem(concern, text)
    }

    fn parted(&self) -> Option<Problem> {
        let submaps = self.run.summary.get("submaps")?.as_array()?;
        let apart = submaps.iter().skip(1).filter_map(|s| count(s, "/frames"));
        let frames: usize = apart.sum();
        if frames == 0 {
            return None;
        }
        let much = frames as f64 > MUCH * self.frames as f64;
        let concern = if much { Concern::Grave } else { Concern::Some };
        let text = format!(
            "{frames} frames are in a map of their own: end such a walk at a place that was seen before"
        );
        problem(concern, text)
    }

    fn unread(&self) -> Option<Problem> {
        let skipped = count(&self.run.summary, "/skipped").filter(|n| *n > 0)?;
        let much = skipped as f64 > MUCH * (self.frames + skipped) as f64;
        let concern = if much { Concern::Grave } else { Concern::Some };
        problem(
            concern,
            format!("{skipped} frames could not be read: check the recording with doctor"),
        )
    }

    fn dropped(&self) -> Option<Problem> {
        let dropped = count(&self.run.summary, "/live/dropped").filter(|n| *n > 0)?;
        let much = dropped as f64 > MUCH * (self.frames + dropped) as f64;
        let concern = if much { Concern::Grave } else { Concern::Some };
        problem(
            concern,
            format!("{dropped} frames came faster than they were tracked: --budget-ms keeps up"),
        )
    }

    /// It stayed undecided which regions move for nearly the whole run.
    fn undecided(&self) -> Option<Problem> {
        let states = &self.run.frames.state.0;
        let undecided = states
            .iter()
            .filter(|s| **s == FrameState::Undecided as u8)
            .count();
        if undecided * 2 <= states.len() || undecided == 0 {
            return None;
        }
        let text = format!("in {undecided} frames it is undecided who moves: record for longer");
        problem(Concern::Some, text)
    }

    fn detector(&self) -> Option<Problem> {
        let failed = count(&self.run.summary, "/detector/failed_frames").filter(|n| *n > 0)?;
        let text = format!("the detector failed on {failed} frames: try its model with detect");
        problem(Concern::Some, text)
    }

    fn interrupted(&self) -> Option<Problem> {
        let interrupted = self.run.summary.get("interrupted")?.as_bool()?;
        interrupted.then(|| Problem {
            concern: Concern::Some,
            text: "the run was interrupted: this is what there was until then".to_owned(),
        })
    }

    fn losses(&self) -> Vec<Loss> {
        let lost = self.run.summary.get("lost");
        lost.and_then(|l| serde_json::from_value(l.clone()).ok())
            .unwrap_or_default()
    }
}

/// An interval of frames without a pose, from `summary.json`.
#[derive(Deserialize)]
struct Loss {
    first: u32,
    last: u32,
    #[serde(default)]
    seconds: f64,
    reason: String,
    #[serde(default)]
    then: String,
}

fn count(value: &Value, pointer: &str) -> Option<usize> {
    let n = value.pointer(pointer)?.as_u64()?;
    usize::try_from(n).ok()
}

fn error(summary: &Value) -> Option<(f64, bool)> {
    let rmse = |name: &str| {
        summary
            .pointer(&format!("/accuracy/final/{name}/rmse"))?
            .as_f64()
    };
    let moving = rmse("ate").map(|e| (e, true));
    moving.or_else(|| rmse("drift").map(|e| (e, false)))
}

/// Number of people visible at once: the maximum that a sufficient share of the images shows.
fn people(run: &RunData) -> usize {
    let objects = &run.objects;
    let is_person = |class: &u8| {
        let name = objects.classes.get(usize::from(*class));
        name.is_some_and(|n| n == "person")
    };
    let mut rows: Vec<u32> = objects
        .frame
        .0
        .iter()
        .zip(&objects.class.0)
        .filter(|(_, class)| is_person(class))
        .map(|(frame, _)| *frame)
        .collect();
    rows.sort_unstable();
    let mut counts: Vec<usize> = rows.chunk_by(|a, b| a == b).map(<[u32]>::len).collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    let enough = (SHOWN * run.pictures.frame.0.len() as f64) as usize;
    counts.get(enough).copied().unwrap_or(0)
}

fn remedy(reason: &str) -> &'static str {
    let helps = [
        (
            LostReason::FewFeatures,
            "light the room, and turn the camera to more texture",
        ),
        (
            LostReason::FewDepths,
            "keep surfaces within reach of the depth sensor in view",
        ),
        (
            LostReason::FewMatches,
            "move more slowly, or go back to a place that was seen",
        ),
        (
            LostReason::FewInliers,
            "move more slowly, and keep what stands still in view",
        ),
        (
            LostReason::AgainstGyro,
            "check how the gyroscope is mounted and timed",
        ),
        (
            LostReason::AgainstOdometry,
            "check how the wheels are calibrated and timed",
        ),
        (
            LostReason::Repeated,
            "check why the camera or its driver repeats images",
        ),
    ];
    helps
        .iter()
        .find(|(known, _)| known.to_string() == reason)
        .map_or("look at the first of these frames", |(_, help)| help)
}

#[cfg(test)]
mod tests;

//! Shared parts of experiments: simulated scenes and their scores, seeds and bounds.

pub(crate) mod process;
pub(crate) mod spans;

use crate::Failure;
use crate::origin::cores;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use stillpoint::datasets::StampedPose;
use stillpoint::detection::{
    BoundingBox, ClassId, Detection, Detector, ScriptRow, ScriptedDetector,
};
use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::geometry::{Se3, Vec3, align_umeyama};
use stillpoint::imaging::{FrameSource, RgbdFrame};
use stillpoint::simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint::slam::{Event, Outcome, System};

/// A simulated scene; `None` for its own length.
pub(crate) fn scene(name: &str, seed: u64, frames: Option<usize>) -> Result<Simulator, Failure> {
    Ok(Simulator::new(&SimulatorConfig {
        scene: name.to_owned(),
        seed,
        frames,
        ..SimulatorConfig::default()
    })?)
}

pub(crate) fn script(
    simulator: &Simulator,
    noise: &DetectionNoise,
) -> Result<Vec<ScriptRow>, Failure> {
    let said = (0..simulator.len()).flat_map(|i| simulator.detections(i, noise));
    let row = |d: stillpoint::simulator::ScriptedDetection| {
        let class = ClassId::from_name(d.class)
            .ok_or_else(|| format!("expected a class of COCO, found {:?}", d.class))?;
        let bounds = BoundingBox {
            x0: d.x0,
            y0: d.y0,
            x1: d.x1,
            y1: d.y1,
        };
        Ok(ScriptRow {
            stamp: d.stamp,
            detection: Detection {
                class,
                score: d.score,
                bounds,
            },
        })
    };
    said.map(row).collect()
}

pub(crate) fn scripted(script: &[ScriptRow]) -> Result<Box<dyn Detector>, Failure> {
    Ok(Box::new(ScriptedDetector::new(
        "simulated",
        script.to_vec(),
    )?))
}

pub(crate) fn timed((stamp, world_from_camera): (f64, Se3)) -> TimedPose {
    TimedPose {
        stamp,
        world_from_camera,
    }
}

pub(crate) fn truth(simulator: &Simulator) -> Vec<TimedPose> {
    simulator.ground_truth().into_iter().map(timed).collect()
}

pub(crate) fn final_poses(system: &System) -> Vec<TimedPose> {
    let poses = system.corrected_trajectory().into_iter();
    poses.map(|(e, pose)| timed((e.stamp, pose))).collect()
}

/// The poses of a run relative to its map, without smoothing.
pub(crate) fn map_poses(system: &System) -> Vec<TimedPose> {
    let view = system.view();
    let resolved = system.trajectory().resolve(&view);
    resolved.map(|(e, pose)| timed((e.stamp, pose))).collect()
}

/// From the map's frame to the simulator's: by the positions of all frames, or by the first pose if the camera hardly moved.
pub(crate) fn world_from_map(simulator: &Simulator, poses: &[(f64, Se3)]) -> Se3 {
    let Some((stamp, first)) = poses.first() else {
        return Se3::identity();
    };
    let exact = |stamp: f64| simulator.world_from_camera(stamp).translation;
    let found: Vec<Vec3> = poses.iter().map(|p| p.1.translation).collect();
    let truth: Vec<Vec3> = poses.iter().map(|p| exact(p.0)).collect();
    let reach = truth.iter().map(|t| (t - truth[0]).norm());
    match align_umeyama(&found, &truth, false) {
        Ok(aligned) if reach.fold(0.0, f64::max) >= 0.2 => aligned.target_from_source,
        _ => simulator.world_from_camera(*stamp) * first.inverse(),
    }
}

pub(crate) fn ate_mm(truth: &[TimedPose], poses: &[TimedPose]) -> Result<f64, Failure> {
    let report = evaluate(truth, poses, &EvalOptions::default())?;
    Ok(1e3 * report.ate.statistics.rmse)
}

/// The interpolated true pose at a time.
pub(crate) fn pose_at(truth: &[StampedPose], stamp: f64) -> Option<Se3> {
    let after = truth.partition_point(|p| p.stamp < stamp);
    let (a, b) = (truth.get(after.checked_sub(1)?)?, truth.get(after)?);
    let share = (stamp - a.stamp) / (b.stamp - a.stamp);
    Some(a.world_from_camera.interpolate(&b.world_from_camera, share))
}

pub(crate) fn lost(events: &[Event]) -> usize {
    let frames = events.iter().filter_map(Event::as_frame);
    let lost = frames.filter(|f| matches!(f.report.outcome, Outcome::Lost { .. }));
    lost.count()
}

/// The next readable frame of a recording.
pub(crate) fn next_readable(source: &mut dyn FrameSource) -> Result<Option<RgbdFrame>, Failure> {
    loop {
        match source.next_frame() {
            None => return Ok(None),
            Some(Ok(frame)) => return Ok(Some(frame)),
            Some(Err(e)) if e.recoverable => {}
            Some(Err(e)) => return Err(e.into()),
        }
    }
}

/// Results in the order of seeds, on all cores. Not for measuring times.
pub(crate) fn each_seed<T: Send>(
    seeds: u64,
    run: impl Fn(u64) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    let count = usize::try_from(seeds)?;
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(count));
    let work = || {
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= count {
                return;
            }
            // Boxed errors are not `Send`; their texts are.
            let result = run(seed as u64).map_err(|e| e.to_string());
            if result.is_err() {
                next.store(count, Ordering::Relaxed);
            }
            let mut done = done.lock().unwrap_or_else(|e| e.into_inner());
            done.push((seed, result));
        }
    };
    std::thread::scope(|scope| {
        (0..cores().min(count)).for_each(|_| drop(scope.spawn(work)));
    });
    let mut done = done.into_inner().unwrap_or_else(|e| e.into_inner());
    done.sort_by_key(|(seed, _)| *seed);
    let results = done.into_iter();
    results.map(|(_, result)| Ok(result?)).collect()
}

pub(crate) fn verdict(met: bool) -> &'static str {
    if met { "met" } else { "short" }
}

/// The exit code of an experiment: 1 if a bound is missed.
pub(crate) fn code(all_met: bool) -> ExitCode {
    ExitCode::from(u8::from(!all_met))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_seed_order_and_errors_are_returned() {
        let slow_first = |seed: u64| {
            std::thread::sleep(std::time::Duration::from_millis(20 - 2 * seed));
            Ok(10 * seed)
        };
        let expected: Vec<u64> = (0..7).map(|seed| 10 * seed).collect();
        assert_eq!(each_seed(7, slow_first).unwrap(), expected);
        let fails = |seed: u64| {
            if seed == 2 {
                Err("the third".into())
            } else {
                Ok(())
            }
        };
        assert_eq!(each_seed(500, fails).unwrap_err().to_string(), "the third");
        assert!(each_seed(0, fails).unwrap().is_empty());
    }
}

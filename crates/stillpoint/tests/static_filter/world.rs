//! Recordings with moving people, and results of the system.

use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions, ReadAhead};
use stillpoint_detection::{BoundingBox, ClassId, Detection, ScriptRow, ScriptedDetector};
use stillpoint_evaluation::{Delta, EvalOptions, TimedPose, evaluate};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, FrameSource, GrayImage, RgbdFrame, Simd};
use stillpoint_simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint_slam::{
    Config, Event, FeatureVerdict, FrameReport, Outcome, Preset, RejudgeReport, RevokeReport,
    System, TrajectoryEntry,
};
use stillpoint_testdata::ate::{self, Figures};

/// A recording rendered once for several runs.
pub(crate) struct Recording {
    pub(crate) camera: Camera,
    pub(crate) frames: Vec<RgbdFrame>,
    pub(crate) truth: Vec<TimedPose>,
    /// Per pixel the object shown, 0 for the static scene. Empty without masks.
    pub(crate) masks: Vec<GrayImage>,
    /// Detections; may be empty.
    pub(crate) script: Vec<ScriptRow>,
}

pub(crate) struct Run {
    pub(crate) system: System,
    pub(crate) reports: Vec<FrameReport>,
    pub(crate) rejudged: Vec<RejudgeReport>,
    pub(crate) revoked: Vec<RevokeReport>,
}

/// Agreement of verdicts with the masks, over all keypoints.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shares {
    /// Share of keypoints on moving objects that was rejected.
    pub(crate) recall: f64,
    /// Share of static keypoints that was kept.
    pub(crate) kept: f64,
    pub(crate) moving: usize,
}

impl Recording {
    /// The frames `range` of a simulated scene, and a detector that misses a share `drop` of all people.
    pub(crate) fn simulated(scene: &str, range: std::ops::Range<usize>, drop: f64) -> Self {
        let camera = SimulatorConfig::default().camera;
        Self::with_camera(scene, range, drop, camera)
    }

    pub(crate) fn with_camera(
        scene: &str,
        range: std::ops::Range<usize>,
        drop: f64,
        camera: Camera,
    ) -> Self {
        let config = SimulatorConfig {
            scene: scene.into(),
            camera,
            ..SimulatorConfig::default()
        };
        Self::made(config, range, drop)
    }

    pub(crate) fn made(config: SimulatorConfig, range: std::ops::Range<usize>, drop: f64) -> Self {
        let simulator = Simulator::new(&SimulatorConfig {
            frames: Some(range.end),
            ..config
        })
        .unwrap();
        let noise = DetectionNoise {
            drop,
            ..DetectionNoise::default()
        };
        let seen: Vec<_> = range.clone().map(|i| simulator.moving(i)).collect();
        let said = range.clone().zip(&seen);
        let rows = said
            .flat_map(|(i, seen)| simulator.detections_of(i, seen, &noise))
            .map(|d| ScriptRow {
                stamp: d.stamp,
                detection: Detection {
                    class: ClassId::from_name(d.class).unwrap(),
                    score: d.score,
                    bounds: BoundingBox {
                        x0: d.x0,
                        y0: d.y0,
                        x1: d.x1,
                        y1: d.y1,
                    },
                },
            });
        // Frames are renumbered from 0.
        let frame = |i| RgbdFrame {
            id: FrameId((i - range.start) as u32),
            ..simulator.frame(i)
        };
        let truth = simulator.ground_truth().into_iter();
        Self {
            camera: *simulator.camera(),
            script: rows.collect(),
            frames: range.clone().map(frame).collect(),
            masks: seen.into_iter().map(|s| s.mask).collect(),
            truth: truth
                .skip(range.start)
                .map(|(stamp, world_from_camera)| TimedPose {
                    stamp,
                    world_from_camera,
                })
                .collect(),
        }
    }

    /// Every `n`-th frame, as from a slower camera. Detections of the others are ignored by their stamps.
    pub(crate) fn every(&self, n: usize) -> Self {
        let frames = self.frames.iter().step_by(n).enumerate();
        let frames = frames.map(|(i, frame)| RgbdFrame {
            id: FrameId(i as u32),
            ..frame.clone()
        });
        Self {
            camera: self.camera,
            script: self.script.clone(),
            frames: frames.collect(),
            masks: self.masks.iter().step_by(n).cloned().collect(),
            truth: self.truth.clone(),
        }
    }

    /// A real recording, if available.
    pub(crate) fn real(name: &str) -> Option<Self> {
        let path = stillpoint_testdata::recording(name)?;
        let dataset = Dataset::open(&path, &OpenOptions::default()).unwrap();
        let mut source = ReadAhead::new(dataset.frames(&FrameOptions::default()).unwrap());
        let mut frames = Vec::new();
        while let Some(frame) = source.next_frame() {
            frames.push(frame.unwrap());
        }
        Some(Self {
            camera: dataset.camera().camera,
            truth: dataset
                .ground_truth()
                .unwrap()
                .unwrap()
                .into_iter()
                .map(|p| TimedPose {
                    stamp: p.stamp,
                    world_from_camera: p.world_from_camera,
                })
                .collect(),
            frames,
            masks: Vec::new(),
            script: Vec::new(),
        })
    }

    /// Per frame, the share of the image that shows moving objects.
    pub(crate) fn covers(&self) -> impl Iterator<Item = f64> {
        let share = |mask: &GrayImage| {
            let moving = mask.data().iter().filter(|v| **v > 0).count();
            moving as f64 / mask.data().len() as f64
        };
        self.masks.iter().map(share)
    }

    pub(crate) fn detector(&self) -> ScriptedDetector {
        ScriptedDetector::new("the simulator's", self.script.clone()).unwrap()
    }

    pub(crate) fn run(&self, config: Config) -> Run {
        self.drive(System::new(config, self.camera, Simd::detect()).unwrap())
    }

    pub(crate) fn run_detected(&self, config: Config) -> Run {
        let system = System::new(config, self.camera, Simd::detect()).unwrap();
        self.drive(system.with_detector(Box::new(self.detector())))
    }

    pub(crate) fn drive(&self, mut system: System) -> Run {
        let (mut reports, mut rejudged, mut revoked) = (Vec::new(), Vec::new(), Vec::new());
        let mut take = |events: Vec<Event>| {
            for event in events {
                match event {
                    Event::Frame(frame) => reports.push(frame.report.clone()),
                    Event::Rejudged { report, .. } => rejudged.push(report),
                    Event::Revoked { report, .. } => revoked.push(report),
                    _ => {}
                }
            }
        };
        for frame in &self.frames {
            take(system.step(frame.clone()));
        }
        take(system.finish());
        Run {
            system,
            reports,
            rejudged,
            revoked,
        }
    }

    /// ATE RMSE of a run, mm.
    pub(crate) fn ate_mm(&self, run: &Run) -> f64 {
        let score = evaluate(&self.truth, &run.poses(), &EvalOptions::default()).unwrap();
        score.ate.statistics.rmse * 1e3
    }

    /// Compares a run with the table of errors; returns its ATE RMSE, mm.
    #[track_caller]
    pub(crate) fn hold(&self, sequence: &str, detector: &str, preset: Preset, run: &Run) -> f64 {
        let error_mm = self.ate_mm(run);
        let found = Figures {
            error_mm,
            frames: self.frames.len(),
            posed: run.poses().len(),
        };
        println!("{sequence}, {detector}, {preset:?}: {found:?}");
        ate::hold(sequence, detector, name_of(preset), found);
        error_mm
    }

    /// ATE RMSE and RMSE of the motions between consecutive poses, mm.
    pub(crate) fn errors(&self, poses: &[TimedPose]) -> [f64; 2] {
        let options = EvalOptions {
            delta: Delta::Frames(1),
            ..EvalOptions::default()
        };
        let score = evaluate(&self.truth, poses, &options).unwrap();
        let steps = score.rpe.unwrap().translation.rmse;
        [score.ate.statistics.rmse, steps].map(|e| e * 1e3)
    }

    pub(crate) fn shares(&self, run: &Run) -> Shares {
        let (mut caught, mut moving, mut kept, mut still) = (0_usize, 0_usize, 0_usize, 0_usize);
        for (mask, report) in self.masks.iter().zip(&run.reports) {
            for verdict in report.verdicts.iter() {
                if shows_mover(mask, verdict) {
                    moving += 1;
                    caught += usize::from(verdict.dynamic);
                } else {
                    still += 1;
                    kept += usize::from(!verdict.dynamic);
                }
            }
        }
        Shares {
            recall: caught as f64 / moving.max(1) as f64,
            kept: kept as f64 / still.max(1) as f64,
            moving,
        }
    }
}

impl Run {
    /// The trajectory in the map's last version.
    pub(crate) fn poses(&self) -> Vec<TimedPose> {
        let view = self.system.view();
        timed(self.system.trajectory().resolve(&view))
    }

    pub(crate) fn smoothed(&self) -> Vec<TimedPose> {
        timed(self.system.corrected_trajectory().into_iter())
    }

    /// Number of lost frames.
    pub(crate) fn lost(&self) -> usize {
        let lost = |r: &&FrameReport| matches!(r.outcome, Outcome::Lost { .. });
        self.reports.iter().filter(lost).count()
    }
}

fn timed(poses: impl Iterator<Item = (TrajectoryEntry, Se3)>) -> Vec<TimedPose> {
    let timed = |(entry, world_from_camera): (TrajectoryEntry, Se3)| TimedPose {
        stamp: entry.stamp,
        world_from_camera,
    };
    poses.map(timed).collect()
}

/// Whether the pixel of a keypoint shows a moving object.
pub(crate) fn shows_mover(mask: &GrayImage, verdict: &FeatureVerdict) -> bool {
    let [u, v] = verdict.pixel.map(|x| x.round() as usize);
    u < mask.width() && v < mask.height() && mask.at(u, v) > 0
}

fn name_of(preset: Preset) -> &'static str {
    match preset {
        Preset::Off => "off",
        Preset::Paper => "paper",
        Preset::Default => "default",
    }
}

/// The default configuration with a preset of the filter.
pub(crate) fn with(preset: Preset) -> Config {
    let mut config = Config::default();
    config.static_filter.preset = preset;
    config
}

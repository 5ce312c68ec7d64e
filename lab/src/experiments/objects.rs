//! Tracked people against the simulator's truth: scenes with a detector that misses 30 %.
//!
//! `cargo run --release -p stillpoint --example objects -- SEEDS FRAMES [alarms] [bursts] [SCENE ...]`: a row per scene, with the median over the seeds and, in
//! brackets, the worst. With `alarms` the detector has false alarms as well, with `bursts` bursts of misses.
#![allow(clippy::print_stdout)]

use stillpoint::detection::{
    BoundingBox, ClassId, Detection, ObjectState, ScriptRow, ScriptedDetector,
};
use stillpoint::evaluation::objects::{
    PointMotion, TrackFrame, TrackOptions, TrackScore, TrackedBox, track_score,
};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{DetectionNoise, FrameTruth, Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, FrameReport, System};

type Failure = Box<dyn std::error::Error>;

/// Scenes with people.
const SCENES: [&str; 7] = [
    "walking_xyz",
    "walking_static",
    "walking_halfsphere",
    "walking_rpy",
    "sitting_xyz",
    "crowd_xyz",
    "crowd_static",
];
/// People of whom less is seen need not be found, px: as `eval --objects` has it.
const LEAST_VISIBLE: usize = 1500;

/// With `alarms`: the probability that a frame has one.
const FALSE_ALARM: f64 = 0.1;
/// With `bursts`: the probability that a burst of misses begins for somebody in a frame, one in 7 s at 30 Hz.
const BURST: f64 = 0.005;

/// What the simulated detector says of a frame.
fn script(
    simulator: &Simulator,
    index: usize,
    noise: &DetectionNoise,
) -> Result<Vec<ScriptRow>, Failure> {
    let row = |d: stillpoint::simulator::ScriptedDetection| {
        let class = ClassId::from_name(d.class).ok_or("a class that COCO does not have")?;
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
    simulator
        .detections(index, noise)
        .into_iter()
        .map(row)
        .collect()
}

/// People of the truth and of the report, side by side.
fn compared(truth: &FrameTruth, report: &FrameReport) -> TrackFrame {
    let mut frame = TrackFrame {
        stamp: report.stamp,
        ..TrackFrame::default()
    };
    for b in truth.boxes.iter().filter(|b| b.class == "person") {
        let bounds = [b.x0, b.y0, b.x1, b.y1];
        if b.visible_px < LEAST_VISIBLE {
            frame.ignored.push(bounds);
            continue;
        }
        frame.truth.push(TrackedBox {
            id: b.mover,
            bounds,
            motion: b.motion.map(|m| PointMotion {
                position: m.position.into(),
                velocity: m.velocity.into(),
            }),
        });
    }
    for o in report.objects.iter() {
        let said = matches!(o.state, ObjectState::Confirmed | ObjectState::Coasting);
        if o.class == ClassId::PERSON && said && o.bounds.area() > 0.0 {
            let motion = o.position.zip(o.velocity);
            frame.found.push(TrackedBox {
                id: o.id.0,
                bounds: [o.bounds.x0, o.bounds.y0, o.bounds.x1, o.bounds.y1],
                motion: motion.map(|(position, velocity)| PointMotion { position, velocity }),
            });
        }
    }
    frame
}

/// How well people were followed in a scene.
fn run(
    scene: &str,
    seed: u64,
    frames: usize,
    noise: &DetectionNoise,
) -> Result<TrackScore, Failure> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        frames: Some(frames),
        ..SimulatorConfig::default()
    })?;
    let mut rows = Vec::new();
    for i in 0..simulator.len() {
        rows.extend(script(&simulator, i, noise)?);
    }
    let detector = ScriptedDetector::new("simulated", rows)?;
    let mut system = System::new(Config::default(), *simulator.camera(), Simd::detect())?
        .with_detector(Box::new(detector));
    let mut pairs = Vec::new();
    for i in 0..simulator.len() {
        for event in system.step(simulator.frame(i)) {
            if let Event::Frame(done) = event {
                pairs.push(compared(&simulator.truth(i), &done.report));
            }
        }
    }
    Ok(track_score(&pairs, &TrackOptions::default()))
}

/// Median, and in brackets the worst of some numbers.
fn spread(mut values: Vec<f64>, better_is_more: bool, digits: usize) -> String {
    values.sort_by(f64::total_cmp);
    let worst = if better_is_more {
        values.first()
    } else {
        values.last()
    };
    let median = values.get(values.len() / 2);
    match (median, worst) {
        (Some(m), Some(w)) => format!("{m:.digits$} ({w:.digits$})"),
        _ => "-".to_owned(),
    }
}

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = words.first().map_or(Ok(5), |w| w.parse())?;
    let frames: usize = words.get(1).map_or(Ok(300), |w| w.parse())?;
    let mut named: Vec<&str> = words.iter().skip(2).map(String::as_str).collect();
    let mut noise = DetectionNoise::default();
    let mut asked = |word: &str| {
        let before = named.len();
        named.retain(|name| *name != word);
        named.len() < before
    };
    if asked("alarms") {
        noise.false_alarm = FALSE_ALARM;
    }
    if asked("bursts") {
        noise.burst = BURST;
    }
    let scenes = if named.is_empty() {
        &SCENES[..]
    } else {
        &named
    };
    println!("{seeds} seeds, {frames} frames; median (worst)\n");
    println!(
        "| scene | MOTA | IDF1 | HOTA | switches | ids of 2 people | ghosts per frame | speed error, m/s |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|---:|");
    for scene in scenes {
        let mut scores = Vec::new();
        for seed in 0..seeds {
            scores.push(run(scene, seed, frames, &noise)?);
        }
        let of = |value: &dyn Fn(&TrackScore) -> f64| scores.iter().map(value).collect::<Vec<_>>();
        let speed = |s: &TrackScore| s.motion.speed.map_or(f64::NAN, |speed| speed.median);
        println!(
            "| `{scene}` | {} | {} | {} | {} | {} | {} | {} |",
            spread(of(&|s| s.clear.mota), true, 3),
            spread(of(&|s| s.identity.f1), true, 3),
            spread(of(&|s| s.hota.hota), true, 3),
            spread(of(&|s| s.clear.id_switches as f64), false, 0),
            spread(of(&|s| s.found_ids as f64), false, 0),
            spread(of(&|s| s.ghosts_per_frame), false, 3),
            spread(of(&speed), false, 3),
        );
    }
    Ok(())
}

//! A custom camera, live: frames are pushed as they arrive, and every stage runs in a separate thread.
//!
//! `cargo run --release -p stillpoint --example 05_live_camera`

use std::error::Error;
use std::io::Write;
use std::time::{Duration, Instant};
use stillpoint::imaging::{FrameSource, RgbdFrame, Simd, SourceError};
use stillpoint::live::{Delivery, LiveOptions, LiveSystem};
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, Stages};

/// A fake driver. A real one waits for images in `next_frame`, numbers them 0, 1, 2, ..., sets their exposure times in seconds, and
/// registers depth to the colour image, in metres.
struct MyCamera {
    room: Simulator,
    next: usize,
    start: Instant,
}

impl FrameSource for MyCamera {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let frame = (self.next < self.room.len()).then(|| self.room.frame(self.next))?;
        self.next += 1;
        let exposed = self.start + Duration::from_secs_f64(frame.stamp);
        std::thread::sleep(exposed.saturating_duration_since(Instant::now()));
        Some(Ok(frame))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let room = Simulator::new(&SimulatorConfig {
        scene: "halfsphere".to_owned(),
        frames: Some(90),
        ..SimulatorConfig::default()
    })?;
    let stages = Stages::new(Config::default(), *room.camera(), Simd::detect())?;
    let mut live = LiveSystem::start(stages, None, LiveOptions::default())?;
    let watch = live.watch();
    // Slow listeners miss events, which the run counts. No stage waits for them.
    let events = live.listen("poses", Delivery::until_full(1000));
    let mut camera = MyCamera {
        room,
        next: 0,
        start: Instant::now(),
    };

    let mut out = std::io::stdout().lock();
    while let Some(frame) = camera.next_frame() {
        // Returns immediately. Replaces a frame that tracking has not yet taken.
        live.push(frame?);
        for event in events.try_iter() {
            if let Event::Frame(tracked) = event
                && let Some(pose) = tracked.report.world_from_camera
            {
                let (frame, t) = (tracked.report.frame, pose.translation);
                writeln!(out, "{frame}: {:.3} {:.3} {:.3}", t.x, t.y, t.z)?;
            }
        }
        // Quality, reason for a loss, and stalled threads.
        writeln!(out, "{}", watch.health())?;
    }

    // The current map can be saved at any time during the run.
    if let Some(map) = watch.map() {
        writeln!(out, "{} bytes of map", map.to_bytes(&[])?.len())?;
    }

    let result = live.finish();
    let dropped = result.statistics.dropped.len();
    writeln!(out, "{dropped} frames dropped")?;
    for (stage, end) in result.ended.failures() {
        writeln!(out, "{stage:?} {end}")?;
    }
    // The log of the run: `slam::Replay` reproduces the result from it and the frames, bit for bit.
    writeln!(out, "{} messages logged", result.log.entries.len())?;
    Ok(())
}

//! Full control: separate stages instead of `System`. Here the mapper's replies are delayed by some frames, as from a separate thread,
//! while the tracker continues with the older view.
//!
//! `cargo run --release -p stillpoint --example 04_own_driver`

use std::collections::VecDeque;
use std::error::Error;
use std::io::Write;
use std::sync::Arc;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Mapper, MapperMsg, MapperReport, Outcome, Tracker};

/// Delay of the mapper's replies, frames.
const DELAY: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let room = Simulator::new(&SimulatorConfig {
        scene: "halfsphere".to_owned(),
        frames: Some(60),
        ..SimulatorConfig::default()
    })?;
    let config = Config::default();
    config.validate()?;
    let mut mapper = Mapper::new(&config);
    let mut tracker = Tracker::new(config, *room.camera(), Simd::detect());
    let mut replies = VecDeque::new();

    let mut out = std::io::stdout().lock();
    for i in 0..room.len() {
        while replies.front().is_some_and(|(due, _)| *due <= i) {
            if let Some((_, view)) = replies.pop_front() {
                tracker.receive(view);
            }
        }
        let tracked = tracker.track(&Arc::new(room.frame(i)));
        if let Outcome::Lost { reason, .. } = tracked.report.outcome {
            writeln!(out, "frame {i} is lost: {reason}")?;
        }
        if let Some(keyframe) = tracked.keyframe {
            let reply = mapper.step(MapperMsg::Keyframe(Box::new(keyframe)));
            if let MapperReport::Mapped(report) = &reply.report {
                writeln!(
                    out,
                    "frame {i} is a keyframe: map version {}, {} landmarks, {} observations refined",
                    report.map_version, report.landmarks, report.bundle.observations
                )?;
            }
            // Before the first view there is nothing to track against, so it is delayed less.
            let due = if i == 0 { 1 } else { i + 1 + DELAY };
            replies.push_back((due, reply.view));
        }
    }
    writeln!(
        out,
        "{} frames tracked",
        tracker.trajectory().entries().len()
    )?;
    Ok(())
}

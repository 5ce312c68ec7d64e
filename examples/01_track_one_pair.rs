//! The motion between two frames: a minimal program.
//!
//! `cargo run --release -p stillpoint --example 01_track_one_pair`

use std::error::Error;
use std::io::Write;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, System};

fn main() -> Result<(), Box<dyn Error>> {
    // Frames can have any source; here it is a simulated room, with known motion.
    let room = Simulator::new(&SimulatorConfig::default())?;
    let mut system = System::new(Config::default(), *room.camera(), Simd::detect())?;

    // The first frame starts the map, and its pose is the origin.
    system.step(room.frame(0));
    let events = system.step(room.frame(3));

    let tracked = events.iter().find_map(Event::as_frame);
    let report = &tracked.ok_or("every frame gets a report")?.report;
    let Some(found) = report.world_from_camera else {
        return Err(format!("the frame has no pose: {:?}", report.outcome).into());
    };
    let pose = |i| room.world_from_camera(room.stamp(i));
    let truth = pose(0).inverse() * pose(3);

    let (found, truth) = (found.translation * 1e3, truth.translation * 1e3);
    let mut out = std::io::stdout().lock();
    writeln!(out, "{} inliers", report.counts.inliers)?;
    for (name, t) in [("found", found), ("truth", truth)] {
        writeln!(out, "{name}  {:.2} {:.2} {:.2} mm", t.x, t.y, t.z)?;
    }
    writeln!(out, "error  {:.2} mm", (found - truth).norm())?;
    Ok(())
}

//! `simulate`: writes a data set of a simulated room, with exact ground truth.

use crate::args::simulated::SimulateArgs;
use crate::console::{self, Progress};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::output::write_file;
use stillpoint::datasets::{ColourFormat, MoverRow, ReadAhead, Recorder, StampedPose};
use stillpoint::detection::{BoundingBox, ClassId, Detection, ScriptRow, format_script};
use stillpoint::imaging::{FrameSource, GrayImage};
use stillpoint::simulator::{
    DepthModel, DetectionNoise, MoverBox, ScriptedDetection, Shutter, SimulatedImu,
    SimulatedOdometry, Simulator, SimulatorConfig, WheelSlip,
};

pub(crate) fn simulate(args: &SimulateArgs) -> Result<Status, Failure> {
    let config = config(args)?;
    let simulator = Simulator::new(&config).map_err(Failure::input)?;
    let format = if args.jpeg {
        ColourFormat::Jpeg
    } else {
        ColourFormat::Png
    };
    let poses = simulator.ground_truth();
    let name = format!("simulated {}", args.scene);
    let mut recorder = Recorder::create(&args.out, simulator.camera(), &name, format)?;
    let imu = args.imu.then(|| SimulatedImu {
        noise: !args.ideal,
        ..SimulatedImu::default()
    });
    let wheels = args.odometry.then(|| wheels(args));
    // The other one moves to the thread that reads ahead.
    let twin = Simulator::new(&config).map_err(Failure::input)?;
    let mut movers = Movers::new(args);
    let interrupt = Interrupt::listen();
    let mut progress = Progress::new(Some(simulator.len()));
    let mut source = simulator.source().with_colour();
    if let Some(imu) = &imu {
        recorder = recorder.with_imu(imu.model);
        source = source.with_imu(imu);
    }
    if let Some(wheels) = &wheels {
        recorder = recorder.with_odometry(wheels.model);
        source = source.with_odometry(wheels);
    }
    let mut frames = ReadAhead::new(source);
    let mut written = 0;
    while let Some(frame) = frames.next_frame() {
        let frame = frame.map_err(Failure::input)?;
        recorder.add_inertial(&frames.take_inertial());
        recorder.add_odometry(&frames.take_odometry());
        recorder.add(&frame, poses.get(written).map(|(_, p)| p))?;
        movers.record(&twin, written, &mut recorder)?;
        written += 1;
        progress.show(written, "");
        if interrupt.requested() {
            break;
        }
    }
    progress.finish();
    if movers.seen || args.furniture {
        let script = format_script(&movers.detections);
        write_file(&args.out.join("detections.csv"), script.as_bytes())?;
    }
    recorder.finish()?;
    if interrupt.requested() {
        console::line(&format!(
            "interrupted: {written} of {} frames were written",
            poses.len()
        ));
        return Ok(Status::Failed);
    }
    console::report(&format!("{written} frames in {}\n", args.out.display()));
    Ok(Status::Ok)
}

/// Duration, s, and speed, m/s, of a wheel slip.
const SLIP_S: f64 = 0.5;
const SLIP_SPEED: f64 = 0.5;

fn wheels(args: &SimulateArgs) -> SimulatedOdometry {
    let slip = |from: &f64| WheelSlip {
        from: *from,
        to: from + SLIP_S,
        speed: SLIP_SPEED,
    };
    SimulatedOdometry {
        noise: !args.ideal,
        slips: args.slip.iter().map(slip).collect(),
        ..SimulatedOdometry::default()
    }
}

/// The simulator's configuration; camera parameters that are not given are the scene's own.
fn config(args: &SimulateArgs) -> Result<SimulatorConfig, Failure> {
    let mut config = SimulatorConfig {
        scene: args.scene.clone(),
        seed: args.seed,
        frames: args.frames.map(|n| n as usize),
        noise: !args.ideal,
        depth_model: args.depth_model.as_deref().map(|name| match name {
            "structured-light" => DepthModel::StructuredLight,
            _ => DepthModel::Independent,
        }),
        ..SimulatorConfig::default()
    };
    let (readout, depth_readout, exposure) = (args.readout, args.depth_readout, args.exposure);
    if [readout, depth_readout, exposure]
        .iter()
        .any(Option::is_some)
    {
        let simulator = Simulator::new(&config).map_err(Failure::input)?;
        let own = simulator.shutter();
        config.shutter = Some(Shutter {
            readout: readout.unwrap_or(own.readout),
            depth_readout: depth_readout.unwrap_or(own.depth_readout),
            exposure: exposure.unwrap_or(own.exposure),
        });
    }
    Ok(config)
}

/// Masks, boxes and scripted detections of a scene in which something moves.
struct Movers {
    noise: DetectionNoise,
    /// True once anything has moved. Nothing is written before that, as most scenes are static.
    seen: bool,
    /// The frames before that.
    still: Vec<usize>,
    detections: Vec<ScriptRow>,
}

impl Movers {
    fn new(args: &SimulateArgs) -> Self {
        let noise = DetectionNoise {
            seed: args.seed,
            things: args.furniture,
            ..DetectionNoise::default()
        };
        let exact = DetectionNoise {
            drop: 0.0,
            jitter_px: 0.0,
            from_behind: 0.0,
            ..noise
        };
        Self {
            noise: if args.ideal { exact } else { noise },
            seen: false,
            still: Vec::new(),
            detections: Vec::new(),
        }
    }

    fn record(
        &mut self,
        simulator: &Simulator,
        index: usize,
        recorder: &mut Recorder,
    ) -> Result<(), Failure> {
        let truth = if self.noise.things {
            simulator.truth(index)
        } else {
            simulator.moving(index)
        };
        let said = simulator.detections_of(index, &truth, &self.noise);
        if self.noise.things {
            self.detections.extend(script_rows(&said));
        }
        if truth.boxes.is_empty() && !self.seen {
            self.still.push(index);
            return Ok(());
        }
        self.seen = true;
        let empty = GrayImage::new(truth.mask.width(), truth.mask.height());
        for index in self.still.drain(..) {
            recorder.add_movers(simulator.stamp(index), &empty, &[])?;
        }
        let rows: Vec<MoverRow> = truth.boxes.iter().map(mover_row).collect();
        recorder.add_movers(simulator.stamp(index), &truth.mask, &rows)?;
        if !self.noise.things {
            self.detections.extend(script_rows(&said));
        }
        Ok(())
    }
}

/// The simulator's detections of a frame, as rows of a script.
pub(crate) fn script_rows(said: &[ScriptedDetection]) -> Vec<ScriptRow> {
    let mut rows = Vec::new();
    for d in said {
        let detection = Detection {
            class: ClassId::from_name(d.class).unwrap_or(ClassId::PERSON),
            score: d.score,
            bounds: BoundingBox {
                x0: d.x0,
                y0: d.y0,
                x1: d.x1,
                y1: d.y1,
            },
        };
        // Jitter may shrink a box at the image border to nothing, and scripts refuse such boxes.
        if detection.bounds.width() >= 1.0 && detection.bounds.height() >= 1.0 {
            let stamp = d.stamp;
            rows.push(ScriptRow { stamp, detection });
        }
    }
    rows
}

fn mover_row(seen: &MoverBox) -> MoverRow {
    let motion = seen.motion.unwrap_or_default();
    MoverRow {
        mover: seen.mover,
        bounds: [seen.x0, seen.y0, seen.x1, seen.y1],
        visible_px: seen.visible_px,
        position: motion.position,
        velocity: motion.velocity,
    }
}

pub(crate) fn ground_truth(simulator: &Simulator) -> Vec<StampedPose> {
    simulator
        .ground_truth()
        .into_iter()
        .map(|(stamp, world_from_camera)| StampedPose {
            stamp,
            world_from_camera,
        })
        .collect()
}

//! `demo`: a simulated room with people in it, through the system twice, with the static filter off and on.

pub(crate) mod detector;
pub(crate) mod pictures;
pub(crate) mod report;

use crate::args::simulated::{DemoArgs, DemoDetector};
use crate::demo::detector::{SimulatedDetector, errors_in_words};
use crate::demo::pictures::{Shots, beside};
use crate::demo::report::Pass;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::output::ResultFolder;
use crate::page::{self, Gathering};
use crate::run::result::{Setup, verdict, write};
use crate::run::session::{Driver, Outputs};
use crate::run::summary::Input;
use crate::timing::Timing;
use crate::{config, console};
use stillpoint::datasets::{ReadAhead, StampedPose};
use stillpoint::detection::Detector;
use stillpoint::evaluation::Score;
use stillpoint::evaluation::plot::{Compared, comparison_figure};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Preset};

/// Every file that stands beside the results of the two passes, and the animation of older ones.
const FILES: [&str; 5] = [
    "side_by_side.png",
    "animation.gif",
    "animation.png",
    "comparison.svg",
    "comparison.png",
];

/// The ATE RMSE that the pass with the filter must not exceed, m: with the simulator's detections, and without any.
const BOUND: [f64; 2] = [0.010, 0.015];

/// What both passes have in common.
struct DemoStage<'a> {
    args: &'a DemoArgs,
    scene: SimulatorConfig,
    simd: Simd,
    timing: &'static Timing,
    interrupt: &'a Interrupt,
}

/// `demo`.
pub(crate) fn demo(args: &DemoArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let on = config::resolve(&args.config)?;
    if on.static_filter.preset == Preset::Off {
        return Err(Failure::input(
            "static_filter.preset: the demo compares the filter with none: expected \"default\", \"paper\" or \"adapted\", found \"off\"",
        ));
    }
    let mut off = on.clone();
    off.static_filter.preset = Preset::Off;
    let stage = DemoStage {
        args,
        scene: SimulatorConfig {
            scene: args.scene.clone(),
            seed: on.seed,
            frames: Some(args.frames as usize),
            ..SimulatorConfig::default()
        },
        simd: config::simd()?,
        timing,
        interrupt: &Interrupt::listen(),
    };
    let simulator = stage.simulator()?;
    let folder = ResultFolder::create_of(&args.out, "--out", |name| FILES.contains(&name))?;
    stage.announce(&simulator);
    let (off, off_shots) = stage.pass("off", off)?;
    if off.summary.interrupted {
        return Ok(verdict(&off.summary));
    }
    let (on, on_shots) = stage.pass("on", on)?;
    let hits = on_shots.against_truth(&simulator);
    let text = report::text(&off, &on, &hits);
    stage.draw(folder, (&off, &off_shots), (&on, &on_shots))?;
    console::report(&text);
    console::report(&format!(
        "\nresults in {} and {}; pictures of both beside them: side_by_side.png, animation.gif, comparison.svg\n",
        args.out.join("off").display(),
        args.out.join("on").display()
    ));
    let status = verdict(&on.summary);
    let bound = BOUND[usize::from(args.detector == DemoDetector::None)];
    Ok(report::judge(&on, bound, status))
}

impl DemoStage<'_> {
    fn simulator(&self) -> Result<Simulator, Failure> {
        Simulator::new(&self.scene).map_err(Failure::input)
    }

    fn announce(&self, simulator: &Simulator) {
        console::info(&format!(
            "simulating scene {}: {} frames at 30 Hz, seed {}",
            self.scene.scene,
            simulator.len(),
            self.scene.seed
        ));
        console::info(&match self.args.detector {
            DemoDetector::Simulated => format!("detections: {}", errors_in_words()),
            DemoDetector::None => "detections: none".to_owned(),
        });
    }

    /// Runs the scene with one configuration and writes the result to a folder of this name.
    fn pass(&self, name: &str, config: Config) -> Result<(Pass, Shots), Failure> {
        let out = self.args.out.join(name);
        let folder = ResultFolder::create(&out)?;
        let simulator = self.simulator()?;
        let truth = ground_truth(&simulator);
        let detector: Option<Box<dyn Detector>> = match self.args.detector {
            DemoDetector::None => None,
            DemoDetector::Simulated => Some(Box::new(SimulatedDetector::new(
                self.simulator()?,
                self.scene.seed,
            ))),
        };
        self.timing.restart();
        let driver = Driver {
            config: config.clone(),
            camera: *simulator.camera(),
            imu: None,
            odometry: None,
            simd: self.simd,
            timing: self.timing,
            interrupt: self.interrupt,
            detector,
            map: None,
        };
        let mut outputs = Outputs {
            shots: Some(Shots::new(simulator.len(), &config.motion_weights)),
            report: Some(Gathering::default()),
            ..Outputs::default()
        };
        console::info(&format!("static filter {name}"));
        let mut frames = ReadAhead::new(simulator.source().with_colour());
        let session = driver.drive(&mut frames, &mut outputs)?;
        let report = outputs.report.take();
        let setup = Setup {
            input: Input {
                name: format!("{}, filter {name}", self.scene.scene),
                layout: "simulated".to_owned(),
                camera: "simulator".to_owned(),
            },
            config: &config,
            simd: self.simd,
            timing: self.timing,
            truth: Some(&truth),
            log: None,
            report: report.as_ref().map(|g| &g.0),
            view: None,
            command: page::typed(),
        };
        let (summary, score) = write(&setup, &session, folder)?;
        let shots = outputs
            .shots
            .unwrap_or_else(|| Shots::new(0, &config.motion_weights));
        Ok((Pass { summary, score }, shots))
    }

    /// Pictures of both passes.
    fn draw(
        &self,
        mut folder: ResultFolder,
        (off, off_shots): (&Pass, &Shots),
        (on, on_shots): (&Pass, &Shots),
    ) -> Result<(), Failure> {
        let titles = [("off", off), ("on", on)]
            .map(|(name, pass)| format!("filter {name}: {}", report::error(pass)));
        let (still, animation) = beside(off_shots, on_shots, [&titles[0], &titles[1]])?;
        folder.write("side_by_side.png", &still)?;
        folder.write("animation.gif", &animation)?;
        // A camera that stands still has no alignment: the plots of both passes show its drift.
        if let (Some(Score::Moving(a)), Some(Score::Moving(b))) = (&off.score, &on.score) {
            let estimates = [("filter off", &a.ate), ("filter on", &b.ate)];
            let estimates = estimates.map(|(name, ate)| Compared { name, ate });
            let figure = comparison_figure(&self.scene.scene, &estimates);
            folder.write("comparison.svg", figure.to_svg().as_bytes())?;
            let png = figure.to_png().map_err(Failure::input)?;
            folder.write("comparison.png", &png)?;
        }
        folder.commit()
    }
}

/// The exact poses at the colour stamps.
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

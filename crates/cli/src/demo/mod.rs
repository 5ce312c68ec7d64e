//! `demo`: runs SLAM twice on a simulated room with people, with the static filter off and on.

pub(crate) mod detector;
pub(crate) mod pictures;
pub(crate) mod report;

use crate::args::InputArgs;
use crate::args::simulated::{DemoArgs, DemoDetector};
use crate::demo::detector::{SimulatedDetector, errors_in_words};
use crate::demo::pictures::{Shots, beside};
use crate::demo::report::Pass;
use crate::dense::Fused;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::output::{ResultFolder, StreamedFile};
use crate::page;
use crate::render::reel::Reel;
use crate::render::{self, Format, Named, Scene};
use crate::run::about::{About, Simulated, run_log};
use crate::run::drive::Driver;
use crate::run::result::{verdict, write};
use crate::run::setup::Setup;
use crate::run::summary::Input;
use crate::simulate::ground_truth;
use crate::sink::{KnownUp, Sink, Sinks};
use crate::sinks::dense::{Fusion, Wish};
use crate::sinks::report::Gathering;
use crate::timing::Timing;
use crate::{config, console};
use stillpoint::datasets::ReadAhead;
use stillpoint::detection::Detector;
use stillpoint::evaluation::Score;
use stillpoint::evaluation::plot::{Compared, comparison_figure};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Preset};

/// Every file beside the results of the two passes, and the animation of older versions.
const FILES: [&str; 6] = [
    FILM,
    "side_by_side.png",
    "animation.gif",
    "animation.png",
    "comparison.svg",
    "comparison.png",
];

const FILM: &str = "demo.webp";
/// Maximum size of the animation, MB: that of the picture in README, which a test holds to this limit.
const FILM_MB: f64 = 3.0;

/// Maximum ATE RMSE of the pass with the filter, m: with the simulator's detections, and without any.
const BOUND: [f64; 2] = [0.010, 0.015];

struct DemoStage<'a> {
    args: &'a DemoArgs,
    scene: SimulatorConfig,
    simd: Simd,
    timing: &'static Timing,
    interrupt: &'a Interrupt,
}

pub(crate) fn demo(args: &DemoArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let on = config::resolve(&args.config)?;
    if on.static_filter.preset == Preset::Off {
        return Err(Failure::input(
            "static_filter.preset: the demo compares the filter with none: expected \"default\" or \"paper\", found \"off\"",
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
    let off = stage.pass("off", off)?;
    if off.pass.summary.interrupted {
        return Ok(verdict(&off.pass.summary));
    }
    let on = stage.pass("on", on)?;
    let hits = on.shots.against_truth(&simulator);
    stage.draw(folder, &off, &on)?;
    let film = stage.film(&off, &on)?;
    if console::verbosity() > 1 {
        console::report(&report::text(&off.pass, &on.pass, &hits));
    }
    let status = verdict(&on.pass.summary);
    let bound = BOUND[usize::from(args.detector == DemoDetector::None)];
    console::report(&report::lines(
        (&stage.scene.scene, hits.people > 0),
        [&off.pass, &on.pass],
        bound,
        (&args.out, film),
    ));
    Ok(report::judge(&on.pass, bound, status))
}

struct Passed {
    pass: Pass,
    shots: Shots,
    /// Only for the pass with the filter.
    scene: Option<Scene>,
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
    fn pass(&self, name: &'static str, config: Config) -> Result<Passed, Failure> {
        let out = self.args.out.join(name);
        let mut folder = ResultFolder::create(&out)?;
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
        let mut sinks = self.sinks(&simulator, &config)?;
        let (frames_in_all, camera) = (simulator.len(), *simulator.camera());
        console::info(&format!("static filter {name}"));
        let mut frames = ReadAhead::new(simulator.source().with_colour());
        let session = driver.drive(&mut frames, &mut sinks)?;
        let mut found = sinks.finish(&session, KnownUp::default(), Some(&mut folder))?;
        let detector = &session.stages.detector;
        let mut about = About::new(&InputArgs::default(), &config, None, detector)?;
        about.dense = found.shelf.get::<Fused>().map(|d| d.logged.clone());
        about.simulated = Some(Simulated {
            scene: self.scene.scene.clone(),
            frames: frames_in_all,
        });
        let setup = Setup {
            input: Input {
                name: format!("{}, filter {name}", self.scene.scene),
                layout: "simulated".to_owned(),
                camera: "simulator".to_owned(),
            },
            config_text: config::to_text(&config)?,
            simd: self.simd,
            timing: self.timing,
            truth: Some(&truth),
            report: found.shelf.get(),
            log: run_log(&session, &about, None)?,
            command: page::typed(),
        };
        let (summary, score) = write(&setup, &session, &found, folder)?;
        let shots = found.shelf.take();
        let shots = shots.unwrap_or_else(|| Shots::new(0, &config.motion_weights));
        let scene = found.shelf.take::<Reel>().map(|reel| {
            let fused = found.shelf.get();
            Scene::of(reel, &session, fused, Some(truth), &camera)
        });
        let poses = session.poses.final_poses;
        let pass = Pass {
            summary,
            score,
            poses,
        };
        Ok(Passed { pass, shots, scene })
    }

    /// Outputs of a pass; for the pass with the filter, whose map has no people, also surface and views.
    fn sinks(&self, simulator: &Simulator, config: &Config) -> Result<Sinks, Failure> {
        let shots = Shots::new(simulator.len(), &config.motion_weights);
        let mut all: Vec<Box<dyn Sink>> = vec![Box::new(shots), Box::new(Gathering::default())];
        if config.static_filter.preset != Preset::Off {
            let wish = Wish {
                weights: config.motion_weights.clone(),
                ..Wish::default()
            };
            all.push(Box::new(Fusion::new(wish, simulator.camera(), self.simd)?));
            all.push(Box::new(Reel::new(simulator.len())));
        }
        Ok(Sinks(all))
    }

    /// Writes the animation of both passes, and returns its name; `None` if a run was lost from its beginning.
    fn film(&self, off: &Passed, on: &Passed) -> Result<Option<&'static str>, Failure> {
        let Some(scene) = on.scene.as_ref().filter(|_| !on.pass.poses.is_empty()) else {
            return Ok(None);
        };
        let without = Named {
            name: render::OFF.to_owned(),
            poses: off.pass.poses.clone(),
        };
        let known = usize::from(!without.poses.is_empty());
        let shot = scene.shoot(&[without][..known])?;
        let path = self.args.out.join(FILM);
        let file = StreamedFile::create(&path, "--out")?;
        let said = render::write(&shot, Format::Webp, FILM_MB, (file, &path))?;
        if console::verbosity() > 1 {
            console::info(&said);
        }
        Ok(Some(FILM))
    }

    fn draw(
        &self,
        mut folder: ResultFolder,
        Passed {
            pass: off,
            shots: off_shots,
            ..
        }: &Passed,
        Passed {
            pass: on,
            shots: on_shots,
            ..
        }: &Passed,
    ) -> Result<(), Failure> {
        let titles = [("off", off), ("on", on)]
            .map(|(name, pass)| format!("filter {name}: {}", report::error(pass)));
        let (still, animation) = beside(off_shots, on_shots, [&titles[0], &titles[1]])?;
        folder.write("side_by_side.png", &still)?;
        folder.write("animation.gif", &animation)?;
        // Where the ground truth stands still, alignment is undefined; the plots of both passes show the drift.
        if let (Some(Score::Moving(a)), Some(Score::Moving(b))) = (&off.score, &on.score) {
            let estimates = [("filter off", a), ("filter on", b)].map(|(name, e)| Compared {
                name,
                ate: &e.ate,
                rpe: e.rpe.as_ref(),
            });
            let figure = comparison_figure(&self.scene.scene, &estimates);
            folder.write("comparison.svg", figure.to_svg().as_bytes())?;
            let png = figure.to_png().map_err(Failure::input)?;
            folder.write("comparison.png", &png)?;
        }
        folder.commit()
    }
}

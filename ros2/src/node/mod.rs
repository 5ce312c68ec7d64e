//! The node: one loop that receives messages, passes frames to the run, and serves requests.

mod entries;
mod requests;
mod runs;
mod status;

use crate::arguments::Request;
use crate::bus::{Bus, Quality, Reach, Writer};
use crate::camera::CameraState;
use crate::inertial::Measured;
use crate::intake::{Intake, News, topics};
use crate::losses::Losses;
use crate::odometry::{self, Rolled};
use crate::options::Options;
use crate::outputs::Outputs;
use crate::pairing::Pair;
use crate::parameters::Parameters;
use crate::run::{Known, Run};
use crate::say::Voice;
use crate::services::Services;
use crate::type_hash;
use crate::waiting::Waiting;
use entries::{constant, image};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use stillpoint::recordings::ImageMessage;
use stillpoint::ros_events::Publisher;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::Message;

/// Maximum interval between checks for requests.
const LOOK: Duration = Duration::from_millis(50);
/// Maximum number of pairs of images waiting for a calibration: a third of a second.
const PENDING: usize = 10;
/// Interval of status messages.
const STATUS: Duration = Duration::from_secs(1);
/// Minimum interval of repeated warnings about images.
const REPEAT: Duration = Duration::from_secs(5);

/// A running node.
pub struct Node {
    bus: Bus,
    voice: Voice,
    parameters: Parameters,
    options: Options,
    outputs: Arc<Outputs>,
    services: Services,
    parameter_events: Writer,
    intake: Intake,
    camera: CameraState,
    run: Option<Run>,
    number: u32,
    begun: Instant,
    /// A map for the next run, and its publisher if `odom` continues.
    known: Option<Known>,
    publisher: Option<Publisher>,
    /// Reason not to start a run, until a setting changes.
    refused: Option<String>,
    not_ready: Option<String>,
    /// Error of the last pair, if any.
    unreadable: Option<String>,
    paused: bool,
    waiting: Waiting,
    losses: Losses,
    last_pair: Option<Instant>,
    status_at: Instant,
    counted: [u64; 2],
    /// Pairs of images waiting for calibration.
    pending: VecDeque<Pair<Vec<u8>>>,
    said: BTreeMap<String, Instant>,
}

impl Node {
    /// Joins the network.
    ///
    /// # Errors
    /// Invalid parameters, no network.
    pub fn start(request: &Request, reach: Reach) -> Result<Self, String> {
        let mut parameters = Parameters::new(request)?;
        let options = Options::new(&parameters)?;
        let node = &request.node;
        let voice = Voice::new(&node.full(), request.log_level);
        let remaps = &request.remaps;
        if options.subscribe_odometry {
            odometry::topic(node, remaps)?;
        }
        let told = |e: crate::bus::BusError| e.to_string();
        let mut bus = Bus::join(node, reach, type_hash::of_topics()).map_err(told)?;
        let of_node = |bus: &mut Bus, name: &str, type_name: &str| {
            let quality = Quality {
                depth: 100,
                latched: name == "/rosout",
                ..Quality::DEFAULT
            };
            bus.publish(name, type_name, quality).map_err(told)
        };
        voice.on_rosout(of_node(&mut bus, "/rosout", ros::Log::NAME)?);
        let parameter_events = of_node(&mut bus, "/parameter_events", ros::ParameterEvent::NAME)?;
        let outputs = Outputs::offer(&mut bus, node, remaps).map_err(told)?;
        let services = Services::offer(&mut bus, node, remaps).map_err(told)?;
        let topics = topics(&options, node, remaps);
        let intake = Intake::subscribe(&mut bus, &topics, &options, remaps).map_err(told)?;
        bus.announce().map_err(told)?;
        parameters.start();
        let mut started = Self {
            known: None,
            bus,
            voice,
            parameters,
            outputs: Arc::new(outputs),
            services,
            parameter_events,
            intake,
            camera: CameraState::new(topics),
            run: None,
            number: 0,
            begun: Instant::now(),
            publisher: None,
            refused: None,
            not_ready: None,
            unreadable: None,
            paused: false,
            waiting: Waiting::default(),
            losses: Losses::new(Instant::now()),
            last_pair: None,
            status_at: Instant::now(),
            counted: [0; 2],
            pending: VecDeque::new(),
            said: BTreeMap::new(),
            options,
        };
        if let Some(file) = started.options.load_map.clone() {
            started.known = Some(started.read_map(file.into())?);
        }
        started.say_hello(reach);
        Ok(started)
    }

    fn say_hello(&self, reach: Reach) {
        let topics = self.intake.topics();
        let domain = reach.domain;
        let place = if reach.local_only {
            "this machine only"
        } else {
            "all interfaces"
        };
        self.voice.info(&format!(
            "{} on domain {domain} ({place}); colour {}, depth {}",
            self.bus.node().full(),
            topics.colour,
            topics.depth
        ));
    }

    /// Runs until stopped, then finishes files.
    ///
    /// # Errors
    /// Files that could not be written.
    pub fn run_until(&mut self, stop: &AtomicBool) -> Result<(), String> {
        while !stop.load(Ordering::Relaxed) {
            self.bus.wait(LOOK);
            let news = self.intake.take_news(&mut self.camera);
            self.take_news(news);
            self.take_images();
            self.decide_mounting();
            self.serve();
            self.tell_status();
        }
        let troubles = self.end_run(false);
        if troubles.is_empty() {
            return Ok(());
        }
        Err(troubles.join("; "))
    }

    fn take_news(&mut self, news: News) {
        for broken in news.broken {
            self.repeat(&broken);
        }
        if news.other_camera && self.run.is_some() {
            self.voice
                .warn("the camera's calibration changed: a new map begins");
            self.end_run(false);
        }
        for bytes in news.transforms {
            if let Some(run) = &self.run {
                run.record(|| constant(bytes));
            }
        }
        self.take_inertial(news.inertial);
        self.take_odometry(news.odometry);
    }

    fn take_inertial(&mut self, inertial: Vec<(Measured, Vec<u8>)>) {
        let Some(run) = &mut self.run else {
            return;
        };
        if let Some(topic) = self.intake.inertial_topic().filter(|_| run.is_recorded()) {
            for (measured, bytes) in &inertial {
                let time = nanoseconds(measured.stamp);
                run.record(|| entries::inertial(topic.to_owned(), time, bytes.clone()));
            }
        }
        // The end of tracking is detected with frames.
        run.tell_inertial(inertial.into_iter().map(|(m, _)| m.sample).collect());
    }

    fn take_odometry(&mut self, odometry: Vec<(Rolled, Vec<u8>)>) {
        let Some(run) = &mut self.run else {
            return;
        };
        if let Some(topic) = self.intake.odometry_topic().filter(|_| run.is_recorded()) {
            for (rolled, bytes) in &odometry {
                let time = nanoseconds(rolled.stamp);
                run.record(|| entries::odometry(topic.to_owned(), time, bytes.clone()));
            }
        }
        run.tell_odometry(odometry.into_iter().map(|(r, _)| r.sample).collect());
    }

    fn take_images(&mut self) {
        let mut told = Vec::new();
        self.intake.take_images(&mut told);
        told.iter().for_each(|t| self.repeat(t));
        while let Some(pair) = self.intake.next_pair() {
            self.last_pair = Some(Instant::now());
            if self.paused {
                continue;
            }
            // Drops pairs of another time, as of a restarted camera.
            let now = pair.colour.0;
            self.pending.retain(|p| (now - p.colour.0).abs() < 1.0);
            self.pending.push_back(pair);
            if self.pending.len() > PENDING {
                self.pending.pop_front();
            }
            while let Some(pair) = self.pending.pop_front() {
                match self.take_pair(&pair) {
                    Ok(true) => self.unreadable = None,
                    Ok(false) => {
                        self.pending.push_front(pair);
                        break;
                    }
                    Err(e) => {
                        self.repeat(&e);
                        self.unreadable = Some(e);
                    }
                }
            }
        }
    }

    /// Converts a pair to a frame and passes it on. Returns false if messages are missing.
    fn take_pair(&mut self, pair: &Pair<Vec<u8>>) -> Result<bool, String> {
        let topics = self.intake.topics().clone();
        let read = |bytes, compressed| {
            ImageMessage::read(bytes, compressed).map_err(|e| format!("image: {e}"))
        };
        let colour = read(&pair.colour.1, topics.colour_compressed)?;
        let depth = read(&pair.depth.1, topics.depth_compressed)?;
        if self.run.is_none() {
            self.begin_run(&colour, &depth)?;
        }
        let Some(run) = &mut self.run else {
            return Ok(self.refused.is_some());
        };
        let time = nanoseconds(colour.header().stamp);
        if run.is_recorded() {
            let images = [
                (&topics.colour, topics.colour_compressed, &pair.colour.1),
                (&topics.depth, topics.depth_compressed, &pair.depth.1),
            ];
            for (topic, compressed, bytes) in images {
                run.record(|| image(topic.clone(), compressed, time, bytes.clone()));
            }
        }
        run.timing().begin(pair.colour.0, self.intake.age(pair));
        let id = run.number();
        let stamps = (pair.colour.0, pair.depth.0);
        let keep = run.keep_colour();
        let frame = run
            .ready()
            .incoming
            .frame(id, stamps, &colour, &depth, keep)?;
        if !run.push(frame) {
            return Err("tracking has ended by a fault; call reset".to_owned());
        }
        Ok(true)
    }
}

fn nanoseconds(stamp: ros::Time) -> u64 {
    let ns = stamp.sec.saturating_mul(1_000_000_000) + i64::from(stamp.nanosec);
    u64::try_from(ns).unwrap_or(0)
}

fn now() -> ros::Time {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    ros::Time {
        sec: now.as_secs() as i64,
        nanosec: now.subsec_nanos(),
    }
}

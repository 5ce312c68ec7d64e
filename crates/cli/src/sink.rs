//! Outputs (the options) and the sinks that they start.
//!
//! Defines how a sink starts, receives events and finishes. The list of outputs is in [`sinks`](crate::sinks).

use crate::dense::Logged;
use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::run::known_map::Known;
use crate::run::session::Session;
use crate::run::summary::Input;
use crate::timing::Timing;
use serde_json::Value;
use std::any::Any;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use stillpoint::geometry::Camera;
use stillpoint::imaging::Simd;
use stillpoint::live::{Delivery, Watch};
use stillpoint::map::{Extension, Map, MapView};
use stillpoint::slam::{self, Config, Event, Up};

/// Maximum number of queued events per sink: at 30 Hz about a minute of frames, with other events.
pub(crate) const EVENTS: usize = 4096;
/// Maximum number of images queued for drawing: some 20 MB.
pub(crate) const PICTURES: usize = 8;

/// The options of an output.
pub(crate) trait Output {
    /// Starts the output if requested, before the first frame, so that unwritable paths are reported early.
    ///
    /// # Errors
    /// Why it cannot be started.
    fn begin(&self, _: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        Ok(None)
    }

    /// Files written outside the result folder, by option.
    fn files(&self) -> Vec<(&'static str, &Path)> {
        Vec::new()
    }

    /// Folders filled outside the result folder, by option.
    fn folders(&self) -> Vec<(&'static str, &Path)> {
        Vec::new()
    }

    fn wants_colour(&self) -> bool {
        false
    }
}

/// A started output. It receives events, then the finished run, and completes its files. Dropping it before leaves existing files
/// unchanged.
pub(crate) trait Sink: Send {
    /// Before the first frame: how it receives events; `None` for no events. `watch` observes a live run.
    fn subscribe(&mut self, _map: &Arc<MapView>, _watch: Option<&Watch>) -> Option<Subscription> {
        None
    }

    /// Receives an event. After an error it receives no more, and the run ends.
    ///
    /// # Errors
    /// A failed write.
    fn receive(&mut self, _: &Event) -> Result<(), Failure> {
        Ok(())
    }

    /// After the run: prepares data that other sinks use. All sinks settle before one finishes.
    ///
    /// # Errors
    /// A failed step.
    fn settle(&mut self, _: &mut Ended<'_>) -> Result<(), Failure> {
        Ok(())
    }

    /// After all sinks have settled: completes its files.
    ///
    /// # Errors
    /// A failed write.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure>;

    /// After a failed run: saves and reports data that are useful without a result. Most sinks do nothing.
    fn rescue(self: Box<Self>, _: &Left<'_>) {}
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Subscription {
    /// Name of its thread in a live run, and in messages about missed events.
    pub(crate) name: &'static str,
    /// Policy for slow sinks in a live run; inline and in a replay a sink receives everything.
    pub(crate) delivery: Delivery,
}

impl Subscription {
    /// Every event, without images.
    pub(crate) fn to_all(name: &'static str) -> Self {
        Self {
            name,
            delivery: Delivery::until_full(EVENTS),
        }
    }

    /// Every event, with the images of every n-th frame unless too many are queued.
    pub(crate) fn to_images(name: &'static str, every: usize) -> Self {
        let delivery = Delivery::until_full(EVENTS).with_images(PICTURES, every);
        Self { name, delivery }
    }
}

pub(crate) struct Start<'a> {
    pub(crate) config: &'a Config,
    /// The configuration as text.
    pub(crate) config_text: &'a str,
    pub(crate) camera: Camera,
    pub(crate) simd: Simd,
    pub(crate) timing: &'static Timing,
    pub(crate) input: &'a Input,
    pub(crate) name: String,
    pub(crate) command: String,
    /// Colour and depth stamps of all frames of the input, s; empty for a camera.
    pub(crate) stamps: &'a [(f64, f64)],
    pub(crate) frames: Option<usize>,
    pub(crate) known: Option<&'a Known>,
    /// Whether the map is saved with its extensions.
    pub(crate) saves_map: bool,
    /// The up direction, from the user or that map.
    pub(crate) up: Option<Up>,
    /// From the log of the run that is replayed.
    pub(crate) logged: Repeated,
    /// Values shared between outputs.
    pub(crate) shelf: Shelf,
}

impl Start<'_> {
    pub(crate) fn first_keyframe(&self) -> usize {
        self.known.map_or(0, |k| k.map.view().keyframe_bound())
    }
}

/// For a replay: which frames got their images in time.
#[derive(Default)]
pub(crate) struct Repeated {
    /// The fused frames.
    pub(crate) dense: Option<Logged>,
    /// Numbers of the frames in which objects were searched.
    pub(crate) things: Option<Vec<u32>>,
}

pub(crate) struct Ended<'a> {
    pub(crate) session: &'a Session,
    /// The up direction: from the user, else from the inertial sensor, else from the initial map.
    pub(crate) up: Option<Up>,
    /// The uncommitted result folder, if any.
    pub(crate) folder: Option<&'a mut ResultFolder>,
    pub(crate) found: Found,
}

#[derive(Default)]
pub(crate) struct Found {
    pub(crate) extensions: Vec<Extension>,
    /// Sections of `summary.json` defined by the sinks.
    pub(crate) sections: BTreeMap<String, Value>,
    /// Lines to print below the report.
    pub(crate) said: String,
    /// An error that makes a complete result lack a part.
    pub(crate) late: Option<Failure>,
    /// Values for other parts of the program.
    pub(crate) shelf: Shelf,
}

pub(crate) struct Left<'a> {
    /// The current map; `None` if it is unusable.
    pub(crate) map: Option<&'a Map>,
    pub(crate) timing: slam::Timing,
    pub(crate) frames: usize,
}

/// Values by type, at most one of each, that one sink makes and another uses.
#[derive(Default)]
pub(crate) struct Shelf(Vec<Box<dyn Any>>);

impl Shelf {
    pub(crate) fn put<T: Any>(&mut self, value: T) {
        self.0.push(Box::new(value));
    }

    pub(crate) fn get<T: Any>(&self) -> Option<&T> {
        self.0.iter().find_map(|value| value.downcast_ref())
    }

    pub(crate) fn take<T: Any>(&mut self) -> Option<T> {
        let at = self.0.iter().position(|value| value.is::<T>())?;
        let value = self.0.swap_remove(at).downcast::<T>().ok()?;
        Some(*value)
    }
}

/// The sinks of a run, in the order of their list.
#[derive(Default)]
pub(crate) struct Sinks(pub(crate) Vec<Box<dyn Sink>>);

impl Sinks {
    /// Settles and finishes all sinks after the run, and returns their results. `up` is used where the run itself does not know better,
    /// `folder` is the uncommitted result. The failure of one sink does not affect the others.
    ///
    /// # Errors
    /// The first failure.
    pub(crate) fn finish(
        mut self,
        session: &Session,
        up: KnownUp,
        folder: Option<&mut ResultFolder>,
    ) -> Result<Found, Failure> {
        let up = up.with(session.stages.inertial.as_ref().and_then(|i| i.up));
        let mut ended = Ended {
            session,
            up,
            folder,
            found: Found::default(),
        };
        let extension = ended.up.as_ref().map(Up::to_extension);
        ended.found.extensions.extend(extension);
        let mut failed = Ok(());
        for sink in &mut self.0 {
            failed = failed.and(sink.settle(&mut ended));
        }
        for sink in self.0 {
            failed = failed.and(sink.finish(&mut ended));
        }
        failed.map(|()| ended.found)
    }

    /// Lets all sinks save their data after a failed run.
    pub(crate) fn rescue(&mut self, left: &Left<'_>) {
        for sink in self.0.drain(..) {
            sink.rescue(left);
        }
    }
}

/// The up direction from sources other than the run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KnownUp {
    pub(crate) named: Option<Up>,
    /// From the initial map.
    pub(crate) known: Option<Up>,
}

impl KnownUp {
    /// Combines it with the direction measured by the inertial sensor.
    fn with(self, measured: Option<[f64; 3]>) -> Option<Up> {
        let measured = measured.and_then(|up| Up::along(&up.into()));
        self.named.or(measured).or(self.known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::run::summary::DetectorJson;
    use crate::run::tally::{End, Tally};
    use std::sync::Mutex;
    use stillpoint::slam::Trajectory;

    /// Records its calls; fails to finish if `fails` is set.
    struct Noting {
        name: &'static str,
        notes: Arc<Mutex<Vec<String>>>,
        fails: bool,
    }

    impl Noting {
        fn note(&self, what: &str) {
            let mut notes = self.notes.lock().unwrap();
            notes.push(format!("{what} {}", self.name));
        }
    }

    impl Sink for Noting {
        fn settle(&mut self, ended: &mut Ended<'_>) -> Result<(), Failure> {
            self.note("settle");
            ended.found.said += self.name;
            Ok(())
        }

        fn finish(self: Box<Self>, _: &mut Ended<'_>) -> Result<(), Failure> {
            self.note("finish");
            if self.fails {
                return Err(Failure::input(format!("{} is full", self.name)));
            }
            Ok(())
        }

        fn rescue(self: Box<Self>, _: &Left<'_>) {
            self.note("rescue");
        }
    }

    /// Sinks of these names, and the record of their calls. With `fails` the first fails to finish.
    fn noting(names: [&'static str; 2], fails: bool) -> (Sinks, Arc<Mutex<Vec<String>>>) {
        let notes = Arc::<Mutex<Vec<String>>>::default();
        let sink = |name: &'static str| {
            let notes = Arc::clone(&notes);
            let fails = fails && name == names[0];
            Box::new(Noting { name, notes, fails }) as Box<dyn Sink>
        };
        let sinks = Sinks(names.map(sink).into_iter().collect());
        (sinks, notes)
    }

    fn session() -> Session {
        Tally::default().close(End {
            trajectory: Trajectory::default(),
            view: Arc::default(),
            map: None,
            timing: slam::Timing::default(),
            detector: DetectorJson::default(),
            interrupted: false,
            seconds: 1.0,
            log: None,
            agrees: None,
            live: None,
        })
    }

    #[test]
    fn sinks_settle_before_finishing_and_fail_independently() {
        let (sinks, notes) = noting(["a", "b"], false);
        let found = sinks.finish(&session(), KnownUp::default(), None);
        let order = ["settle a", "settle b", "finish a", "finish b"];
        assert_eq!(*notes.lock().unwrap(), order);
        assert_eq!(found.unwrap().said, "ab");
        let (sinks, notes) = noting(["a", "b"], true);
        let found = sinks.finish(&session(), KnownUp::default(), None);
        assert_eq!(*notes.lock().unwrap(), order);
        assert_eq!(found.err().unwrap().to_string(), "a is full");
    }

    #[test]
    fn sinks_rescue_their_data_after_an_error() {
        let (mut sinks, notes) = noting(["a", "b"], false);
        sinks.rescue(&Left {
            map: None,
            timing: slam::Timing::default(),
            frames: 3,
        });
        assert_eq!(*notes.lock().unwrap(), ["rescue a", "rescue b"]);
        assert!(sinks.0.is_empty());
    }

    #[test]
    fn up_direction_prefers_user_then_sensor_then_map() {
        let up = |x: f64, y: f64| Up::along(&[x, y, 0.0].into());
        let (named, known, measured) = (up(1.0, 0.0), up(0.0, 1.0), Some([-1.0, 0.0, 0.0]));
        assert_eq!(KnownUp { named, known }.with(measured), named);
        let named = None;
        assert_eq!(KnownUp { named, known }.with(measured), up(-1.0, 0.0));
        assert_eq!(KnownUp { named, known }.with(None), known);
    }

    #[test]
    fn shelf_holds_one_value_per_type() {
        let mut shelf = Shelf::default();
        shelf.put(7_u32);
        shelf.put("seven".to_owned());
        assert_eq!(shelf.get::<u32>(), Some(&7));
        assert_eq!(shelf.take::<u32>(), Some(7));
        assert_eq!(shelf.take::<u32>(), None);
        assert_eq!(shelf.get::<String>().map(String::as_str), Some("seven"));
    }
}

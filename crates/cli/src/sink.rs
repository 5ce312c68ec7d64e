//! What leaves a run: outputs, which can be asked for, and sinks, which they become.
//!
//! Answers: what an output may know before the first frame, how its sink listens, and what it finds in the end. Knows none of them: their list is
//! [`sinks`](crate::sinks).

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

/// Events that wait for a sink, at most: at 30 Hz about a minute of frames, with what else happens.
pub(crate) const EVENTS: usize = 4096;
/// Pictures that wait to be drawn, at most: some 20 MB.
pub(crate) const PICTURES: usize = 8;

/// An output that can be asked for: its options.
pub(crate) trait Output {
    /// Begins it where it is asked for, before the first frame: what cannot be written is said now and not after an hour.
    ///
    /// # Errors
    /// What cannot be begun, and why.
    fn begin(&self, _: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        Ok(None)
    }

    /// The files that it writes beside the result, by the options that name them.
    fn files(&self) -> Vec<(&'static str, &Path)> {
        Vec::new()
    }

    /// The folders that it fills beside the result, by the options that name them.
    fn folders(&self) -> Vec<(&'static str, &Path)> {
        Vec::new()
    }

    /// Whether it looks at the colours of frames.
    fn wants_colour(&self) -> bool {
        false
    }
}

/// An output that was begun. It takes what happens, finds the run when that is over, and puts what it made where it belongs. Dropping it
/// without that leaves what was there before.
pub(crate) trait Sink: Send {
    /// Before the first frame: how events reach it; none where it takes none. `watch` says how a live run is.
    fn subscribe(&mut self, _map: &Arc<MapView>, _watch: Option<&Watch>) -> Option<Subscription> {
        None
    }

    /// Takes an event. After an error it gets no more, and the run ends.
    ///
    /// # Errors
    /// What could not be written.
    fn receive(&mut self, _: &Event) -> Result<(), Failure> {
        Ok(())
    }

    /// The run is over: makes what other sinks may build on. All sinks settle before one finishes.
    ///
    /// # Errors
    /// What could not be made.
    fn settle(&mut self, _: &mut Ended<'_>) -> Result<(), Failure> {
        Ok(())
    }

    /// The run is over and all sinks have settled: puts everything where it belongs.
    ///
    /// # Errors
    /// What could not be written.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure>;

    /// An error ended the run: keeps what is worth having without a result, and says so. Most keep nothing.
    fn rescue(self: Box<Self>, _: &Left<'_>) {}
}

/// How events reach a sink.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Subscription {
    /// Of its thread in a live run, and in what is said of events that it missed.
    pub(crate) name: &'static str,
    /// What is left out in a live run when it is slow; inline and in a replay it takes all.
    pub(crate) delivery: Delivery,
}

impl Subscription {
    /// Every event, with no images.
    pub(crate) fn to_all(name: &'static str) -> Self {
        Self {
            name,
            delivery: Delivery::until_full(EVENTS),
        }
    }

    /// Every event, with the images of every n-th frame while not too many wait.
    pub(crate) fn to_images(name: &'static str, every: usize) -> Self {
        let delivery = Delivery::until_full(EVENTS).with_images(PICTURES, every);
        Self { name, delivery }
    }
}

/// What an output may know when it is begun.
pub(crate) struct Start<'a> {
    pub(crate) config: &'a Config,
    /// The same as text.
    pub(crate) config_text: &'a str,
    pub(crate) camera: Camera,
    pub(crate) simd: Simd,
    pub(crate) timing: &'static Timing,
    /// What is run on, and what a person calls it.
    pub(crate) input: &'a Input,
    pub(crate) name: String,
    /// How the run was begun, as typed.
    pub(crate) command: String,
    /// Stamps of all colour and depth images of the input, s; none of a camera.
    pub(crate) stamps: &'a [(f64, f64)],
    /// Frames that will be taken, where their number is known.
    pub(crate) frames: Option<usize>,
    /// The map that the run begins with.
    pub(crate) known: Option<&'a Known>,
    /// Whether the map is saved with what is kept beside it.
    pub(crate) saves_map: bool,
    /// Which way is up, as users say or as that map has it.
    pub(crate) up: Option<Up>,
    /// What the run that is repeated here found.
    pub(crate) logged: Repeated,
    /// What outputs leave for others.
    pub(crate) shelf: Shelf,
}

impl Start<'_> {
    /// The first id that keyframes of the run can have.
    pub(crate) fn first_keyframe(&self) -> usize {
        self.known.map_or(0, |k| k.map.view().keyframe_bound())
    }
}

/// What a repetition has to know: which frames found their images in time.
#[derive(Default)]
pub(crate) struct Repeated {
    /// Of those that were fused.
    pub(crate) dense: Option<Logged>,
    /// Numbers of those in which things were looked for.
    pub(crate) things: Option<Vec<u32>>,
}

/// A run that is over, and what its sinks make of it.
pub(crate) struct Ended<'a> {
    pub(crate) session: &'a Session,
    /// Which way is up: as users say, else as the inertial sensor does, else as the map had it before.
    pub(crate) up: Option<Up>,
    /// The result in the making, where there is one.
    pub(crate) folder: Option<&'a mut ResultFolder>,
    pub(crate) found: Found,
}

/// What the sinks of a run leave.
#[derive(Default)]
pub(crate) struct Found {
    /// What the map's file keeps beside the map.
    pub(crate) extensions: Vec<Extension>,
    /// Sections of `summary.json` that no part of the program knows but the sinks that leave them.
    pub(crate) sections: BTreeMap<String, Value>,
    /// What is said below the report, in lines.
    pub(crate) said: String,
    /// Why something is missing of a run whose result is whole.
    pub(crate) late: Option<Failure>,
    /// What is made for others.
    pub(crate) shelf: Shelf,
}

/// A run that an error ended.
pub(crate) struct Left<'a> {
    /// The map until then; none where it cannot be used.
    pub(crate) map: Option<&'a Map>,
    pub(crate) timing: slam::Timing,
    /// Frames that went through the system.
    pub(crate) frames: usize,
}

/// Values of any types, at most one of each: what one sink makes and another needs.
#[derive(Default)]
pub(crate) struct Shelf(Vec<Box<dyn Any>>);

impl Shelf {
    /// Leaves a value.
    pub(crate) fn put<T: Any>(&mut self, value: T) {
        self.0.push(Box::new(value));
    }

    /// Looks at the value of this type.
    pub(crate) fn get<T: Any>(&self) -> Option<&T> {
        self.0.iter().find_map(|value| value.downcast_ref())
    }

    /// Takes the value of this type away.
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
    /// The run is over: has all sinks settle and finish, and returns what they leave. `up` says which way is up where the run itself does not know better,
    /// `folder` is the result in the making. One that fails takes nothing from those after it.
    ///
    /// # Errors
    /// The first that failed.
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

    /// An error ended the run: has all sinks keep what they can.
    pub(crate) fn rescue(&mut self, left: &Left<'_>) {
        for sink in self.0.drain(..) {
            sink.rescue(left);
        }
    }
}

/// Which way is up, as said by others than the run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct KnownUp {
    /// By users.
    pub(crate) named: Option<Up>,
    /// By the map that the run begins with.
    pub(crate) known: Option<Up>,
}

impl KnownUp {
    /// With what the inertial sensor measured.
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

    /// Says what is done with it; fails to finish where it is told to.
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

    /// Sinks of these names, and what is done with them. The first fails to finish if it is told to.
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
    fn all_sinks_settle_before_one_finishes_and_one_that_fails_takes_nothing_from_others() {
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
    fn sinks_of_a_run_that_an_error_ended_keep_what_they_can() {
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
    fn users_know_better_than_sensors_which_way_is_up_and_sensors_better_than_older_maps() {
        let up = |x: f64, y: f64| Up::along(&[x, y, 0.0].into());
        let (named, known, measured) = (up(1.0, 0.0), up(0.0, 1.0), Some([-1.0, 0.0, 0.0]));
        assert_eq!(KnownUp { named, known }.with(measured), named);
        let named = None;
        assert_eq!(KnownUp { named, known }.with(measured), up(-1.0, 0.0));
        assert_eq!(KnownUp { named, known }.with(None), known);
    }

    #[test]
    fn a_shelf_holds_one_value_of_each_type() {
        let mut shelf = Shelf::default();
        shelf.put(7_u32);
        shelf.put("seven".to_owned());
        assert_eq!(shelf.get::<u32>(), Some(&7));
        assert_eq!(shelf.take::<u32>(), Some(7));
        assert_eq!(shelf.take::<u32>(), None);
        assert_eq!(shelf.get::<String>().map(String::as_str), Some("seven"));
    }
}

//! What a session writes while frames go by, and what it saves when they cannot be continued.

use crate::console;
use crate::demo::pictures::Shots;
use crate::dense::{Fused, Fusion};
use crate::failure::Failure;
use crate::map::file::MapOutput;
use crate::page::Gathering;
use crate::render::reel::Reel;
use crate::run::masks::MaskFolder;
use crate::run::objects::ObjectFile;
use crate::run::overlay::OverlayFolder;
use crate::run::recording::RunRecording;
use crate::run::session::listeners::{Listening, Rounds, Stop, Writer};
use crate::run::verdicts::VerdictFile;
use crate::run::view::PageView;
use crate::things::{Gathered, Gatherer};
use crate::timing::Timing;
use crate::trace::TraceFile;
use stillpoint::dense::{FinalPose, ThingMap};
use stillpoint::live::{Delivery, LiveSystem, Subscribed};
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{self, Event, Subscriber, Up};

/// The subscriber that draws pictures.
pub(crate) const OVERLAY: &str = "overlay";

/// What is written while frames go by.
#[derive(Default)]
pub(crate) struct Outputs {
    pub(crate) verdicts: Option<VerdictFile>,
    pub(crate) objects: Option<ObjectFile>,
    pub(crate) masks: Option<MaskFolder>,
    /// Pictures in a folder; not together with those for the demo.
    pub(crate) overlay: Option<OverlayFolder>,
    /// Pictures for the demo.
    pub(crate) shots: Option<Shots>,
    /// What is shown of a run in motion, of one that is no live run.
    pub(crate) reel: Option<Reel>,
    /// What the report shows.
    pub(crate) report: Option<Gathering>,
    /// What was found as messages.
    pub(crate) record: Option<RunRecording>,
    /// What browsers are shown.
    pub(crate) view: Option<PageView>,
    /// The surface, fused.
    pub(crate) dense: Option<Fusion>,
    /// What stands in the room.
    pub(crate) things: Option<Gatherer>,
    /// What an earlier run knew of that, where this one does not look.
    pub(crate) known_things: Option<ThingMap>,
    /// Which way is up, as users say.
    pub(crate) named_up: Option<Up>,
    /// The same as the map has it that the run begins with.
    pub(crate) known_up: Option<Up>,
    /// What every thread does when.
    pub(crate) trace: Option<TraceFile>,
    /// The map, at the end.
    pub(crate) map: Option<MapOutput>,
}

/// What is written as subscribers.
pub(crate) struct Writers {
    verdicts: Option<Listening<VerdictFile>>,
    objects: Option<Listening<ObjectFile>>,
    masks: Option<Listening<MaskFolder>>,
    overlay: Option<Listening<OverlayFolder>>,
    shots: Option<Listening<Shots>>,
    reel: Option<Listening<Reel>>,
    report: Option<Listening<Gathering>>,
    record: Option<Listening<RunRecording>>,
    view: Option<Listening<PageView>>,
    dense: Option<Listening<Fusion>>,
    things: Option<Listening<Gatherer>>,
    trace: Option<Listening<TraceFile>>,
}

impl Subscriber for Writers {
    fn receive(&mut self, event: &Event) {
        self.verdicts.receive(event);
        self.objects.receive(event);
        self.masks.receive(event);
        self.overlay.receive(event);
        self.shots.receive(event);
        self.reel.receive(event);
        self.report.receive(event);
        self.record.receive(event);
        self.view.receive(event);
        self.dense.receive(event);
        self.things.receive(event);
        self.trace.receive(event);
    }
}

/// What is written as subscribers of a live run.
pub(crate) struct LiveWriters {
    verdicts: Option<Subscribed<Rounds<Listening<VerdictFile>>>>,
    objects: Option<Subscribed<Rounds<Listening<ObjectFile>>>>,
    masks: Option<Subscribed<Rounds<Listening<MaskFolder>>>>,
    overlay: Option<Subscribed<Rounds<Listening<OverlayFolder>>>>,
    shots: Option<Subscribed<Rounds<Listening<Shots>>>>,
    report: Option<Subscribed<Rounds<Listening<Gathering>>>>,
    record: Option<Subscribed<Rounds<Listening<RunRecording>>>>,
    view: Option<Subscribed<Rounds<Listening<PageView>>>>,
    dense: Option<Subscribed<Rounds<Listening<Fusion>>>>,
    things: Option<Subscribed<Rounds<Listening<Gatherer>>>>,
    trace: Option<Subscribed<Rounds<Listening<TraceFile>>>>,
}

/// Events that wait to be written, at most: at 30 Hz about a minute of frames, with what else happens.
pub(crate) const EVENTS: usize = 4096;
/// The subscriber that browsers are shown.
pub(crate) const VIEW: &str = "view";
/// Events of each kind that wait to be shown, at most: some seconds.
const SHOWN: usize = 128;
/// Pictures that wait to be drawn, at most: some 20 MB.
const PICTURES: usize = 8;

impl Outputs {
    /// Has everything that is written listen. [`Outputs::rejoin`] takes it back.
    pub(crate) fn listen(&mut self, stop: &Stop) -> Writers {
        Writers {
            verdicts: self.verdicts.take().map(|w| Listening::new(w, stop)),
            objects: self.objects.take().map(|w| Listening::new(w, stop)),
            masks: self.masks.take().map(|w| Listening::new(w, stop)),
            overlay: self.overlay.take().map(|w| Listening::new(w, stop)),
            shots: self.shots.take().map(|w| Listening::new(w, stop)),
            reel: self.reel.take().map(|w| Listening::new(w, stop)),
            report: self.report.take().map(|w| Listening::new(w, stop)),
            record: self.record.take().map(|w| Listening::new(w, stop)),
            view: self.view.take().map(|w| Listening::new(w, stop)),
            dense: self.dense.take().map(|w| Listening::new(w, stop)),
            things: self.things.take().map(|w| Listening::new(w, stop)),
            trace: self.trace.take().map(|w| Listening::new(w, stop)),
        }
    }

    /// Takes back what listened.
    ///
    /// # Errors
    /// What could not be written.
    pub(crate) fn rejoin(&mut self, writers: Writers) -> Result<(), Failure> {
        self.verdicts = writers.verdicts.map(Listening::finish).transpose()?;
        self.objects = writers.objects.map(Listening::finish).transpose()?;
        self.masks = writers.masks.map(Listening::finish).transpose()?;
        self.overlay = writers.overlay.map(Listening::finish).transpose()?;
        self.shots = writers.shots.map(Listening::finish).transpose()?;
        self.reel = writers.reel.map(Listening::finish).transpose()?;
        self.report = writers.report.map(Listening::finish).transpose()?;
        self.record = writers.record.map(Listening::finish).transpose()?;
        self.view = writers.view.map(Listening::finish).transpose()?;
        self.dense = writers.dense.map(Listening::finish).transpose()?;
        self.things = writers.things.map(Listening::finish).transpose()?;
        self.trace = writers.trace.map(Listening::finish).transpose()?;
        Ok(())
    }

    /// Has everything that is written listen to a live run. [`Outputs::rejoin_live`] takes it back.
    pub(crate) fn subscribe(
        &mut self,
        live: &mut LiveSystem,
        stop: &Stop,
        timing: &'static Timing,
    ) -> Result<LiveWriters, Failure> {
        let all = Delivery::until_full(EVENTS);
        let every = self.overlay.as_ref().map_or(1, OverlayFolder::every);
        let every_shot = self.shots.as_ref().map_or(1, Shots::every);
        // Whoever looks wants to see what is now; no frame waits for that, even where none is dropped.
        let newest = Delivery::newest(SHOWN).with_images(PICTURES, 2);
        let mut on = Subscribing { live, stop, timing };
        Ok(LiveWriters {
            verdicts: on.add("verdicts", all, self.verdicts.take())?,
            objects: on.add("objects", all, self.objects.take())?,
            masks: on.add("masks", all.with_images(PICTURES, 1), self.masks.take())?,
            overlay: on.add(
                OVERLAY,
                all.with_images(PICTURES, every),
                self.overlay.take(),
            )?,
            shots: on.add(
                "shots",
                all.with_images(PICTURES, every_shot),
                self.shots.take(),
            )?,
            report: on.add("report", all.with_images(PICTURES, 1), self.report.take())?,
            record: on.add("record", all.with_images(PICTURES, 1), self.record.take())?,
            view: on.add(VIEW, newest, self.view.take())?,
            dense: on.add("dense", all.with_images(PICTURES, 1), self.dense.take())?,
            things: on.add("things", all.with_images(PICTURES, 1), self.things.take())?,
            trace: on.add("trace", all, self.trace.take())?,
        })
    }

    /// Takes back what listened to a live run that is over.
    ///
    /// # Errors
    /// What could not be written.
    pub(crate) fn rejoin_live(&mut self, writers: LiveWriters) -> Result<(), Failure> {
        self.verdicts = writers.verdicts.map(rejoined).transpose()?;
        self.objects = writers.objects.map(rejoined).transpose()?;
        self.masks = writers.masks.map(rejoined).transpose()?;
        self.overlay = writers.overlay.map(rejoined).transpose()?;
        self.shots = writers.shots.map(rejoined).transpose()?;
        self.report = writers.report.map(rejoined).transpose()?;
        self.record = writers.record.map(rejoined).transpose()?;
        self.view = writers.view.map(rejoined).transpose()?;
        self.dense = writers.dense.map(rejoined).transpose()?;
        self.things = writers.things.map(rejoined).transpose()?;
        self.trace = writers.trace.map(rejoined).transpose()?;
        Ok(())
    }

    /// Fuses at the final poses what was to be fused.
    pub(crate) fn fuse(&mut self, poses: &[FinalPose], up: Option<Up>) -> Option<Fused> {
        Some(self.dense.take()?.finish(poses, up))
    }

    /// What stands in the room, at the poses of the final map.
    pub(crate) fn gather(&mut self, view: &MapView) -> Option<Gathered> {
        let known = self
            .known_things
            .take()
            .map(|map| Gathered::known(map, view));
        self.things.take().map(|t| t.finish(view)).or(known)
    }

    /// Saves the map of a run that cannot go on after so many frames, if it is to be saved, and says so. What else there was is
    /// lost, and whoever mapped for an hour wants to go on from there.
    pub(crate) fn rescue_map(&mut self, map: Option<&Map>, timing: &slam::Timing, frames: usize) {
        let Some(file) = self.map.take() else { return };
        let Some(map) = map.filter(|m| frames > 0 && m.view().keyframe_count() > 0) else {
            return;
        };
        match file.save(map, Some(timing), Vec::new()) {
            Ok(saved) => console::line(&format!(
                "the run ends after {frames} frames; the map until then, of {} keyframes and {} landmarks, is saved to {}",
                saved.keyframes, saved.landmarks, saved.path
            )),
            Err(failure) => console::line(&format!("the map until then is not saved: {failure}")),
        }
    }

    /// Puts everything where it belongs, and says where that is.
    pub(crate) fn finish(self) -> Result<String, Failure> {
        let mut said = String::new();
        if let Some(file) = self.verdicts {
            said += &file.finish()?;
        }
        if let Some(file) = self.objects {
            said += &file.finish()?;
        }
        if let Some(folder) = self.masks {
            said += &folder.finish()?;
        }
        if let Some(folder) = self.overlay {
            said += &folder.finish()?;
        }
        if let Some(file) = self.record {
            said += &file.finish()?;
        }
        if let Some(file) = self.trace {
            said += &file.finish()?;
        }
        Ok(said)
    }
}

/// Where writers of a live run subscribe.
struct Subscribing<'a> {
    live: &'a mut LiveSystem,
    stop: &'a Stop,
    timing: &'static Timing,
}

impl Subscribing<'_> {
    fn add<W: Writer + Send + 'static>(
        &mut self,
        name: &str,
        delivery: Delivery,
        writer: Option<W>,
    ) -> Result<Option<Subscribed<Rounds<Listening<W>>>>, Failure> {
        let Some(writer) = writer else {
            return Ok(None);
        };
        let rounds = Rounds {
            subscriber: Listening::new(writer, self.stop),
            timing: self.timing,
        };
        let subscribed = self.live.subscribe(name, delivery, rounds);
        subscribed.map(Some).map_err(Failure::thread)
    }
}

/// A subscriber of a live run that is over.
pub(crate) fn returned<S>(subscribed: Subscribed<Rounds<S>>) -> Result<S, Failure> {
    let subscriber = subscribed.join();
    subscriber.map(|s| s.subscriber).map_err(|reason| {
        Failure::criteria(format!(
            "a thread that writes the result did not finish: {reason}"
        ))
    })
}

fn rejoined<W>(subscribed: Subscribed<Rounds<Listening<W>>>) -> Result<W, Failure> {
    returned(subscribed)?.finish()
}

//! Consumers of a pass: the tally, the sinks, and the progress output.
//!
//! A sink that fails stops the run. Inline and in a replay all are called in turn; in a live run each has a queue and a thread.

use crate::console;
use crate::failure::Failure;
use crate::run::drive::lines::{LossLine, ProgressLine};
use crate::run::live_report::PROGRESS;
use crate::run::stop::Stop;
use crate::run::tally::Tally;
use crate::sink::{EVENTS, Sink, Sinks};
use crate::timing::Timing;
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use stillpoint::live::{Delivery, LiveSystem, Subscribed};
use stillpoint::map::MapView;
use stillpoint::slam::{Event, Subscriber};

pub(super) struct Audience {
    seats: Seats,
    stop: Stop,
    unread: usize,
    /// The same number, shared with the progress line.
    shown_unread: Arc<AtomicUsize>,
}

enum Seats {
    Here {
        tally: Box<Tally>,
        sinks: Vec<Seat<Listening>>,
        progress: ProgressLine,
    },
    Apart {
        tally: Subscribed<Rounds<(Tally, LossLine)>>,
        sinks: Vec<Seat<Subscribed<Rounds<Listening>>>>,
        progress: Subscribed<Rounds<ProgressLine>>,
    },
}

/// A sink wrapped as `L`, or unwrapped if it takes no events.
enum Seat<L> {
    Silent(Box<dyn Sink>),
    Listens(L),
}

impl Audience {
    /// All in one thread; `frames` is the expected number of frames, `map` the initial map.
    pub(super) fn here(sinks: &mut Sinks, map: &Arc<MapView>, frames: Option<usize>) -> Self {
        let stop = Stop::default();
        let seat = |mut sink: Box<dyn Sink>| match sink.subscribe(map, None) {
            None => Seat::Silent(sink),
            Some(_) => Seat::Listens(Listening::new(sink, &stop)),
        };
        let sinks = sinks.0.drain(..).map(seat).collect();
        let progress = ProgressLine::new(frames);
        Self {
            stop: stop.clone(),
            unread: 0,
            shown_unread: progress.skipped(),
            seats: Seats::Here {
                tally: Box::default(),
                sinks,
                progress,
            },
        }
    }

    /// Each on a thread, for a live run.
    ///
    /// # Errors
    /// A thread that cannot be started.
    pub(super) fn apart(
        sinks: &mut Sinks,
        live: &mut LiveSystem,
        frames: Option<usize>,
        timing: &'static Timing,
    ) -> Result<Self, Failure> {
        let stop = Stop::default();
        let watch = live.watch();
        let map = watch.view();
        let tally = Rounds::new((Tally::default(), LossLine::default()), timing);
        let tally = live.subscribe("tally", Delivery::until_full(EVENTS), tally);
        let tally = tally.map_err(Failure::thread)?;
        let mut seats = Vec::new();
        for mut sink in sinks.0.drain(..) {
            seats.push(match sink.subscribe(&map, Some(&watch)) {
                None => Seat::Silent(sink),
                Some(wanted) => {
                    let listening = Rounds::new(Listening::new(sink, &stop), timing);
                    let listening = live.subscribe(wanted.name, wanted.delivery, listening);
                    Seat::Listens(listening.map_err(Failure::thread)?)
                }
            });
        }
        let progress = ProgressLine::of_live(frames, watch);
        let shown_unread = progress.skipped();
        let progress = Rounds::new(progress, timing);
        let progress = live.subscribe(PROGRESS, Delivery::newest(1), progress);
        Ok(Self {
            stop,
            unread: 0,
            shown_unread,
            seats: Seats::Apart {
                tally,
                sinks: seats,
                progress: progress.map_err(Failure::thread)?,
            },
        })
    }

    /// Set when a sink fails, to end the run.
    pub(super) fn stop(&self) -> &Stop {
        &self.stop
    }

    pub(super) fn receive_all(&mut self, events: &[Event]) {
        if let Seats::Here {
            tally,
            sinks,
            progress,
        } = &mut self.seats
        {
            for event in events {
                tally.receive(event);
                for seat in &mut *sinks {
                    if let Seat::Listens(sink) = seat {
                        sink.receive(event);
                    }
                }
                progress.receive(event);
            }
        }
    }

    pub(super) fn skip(&mut self, reason: &dyn Display) {
        console::warn(&format!("skipped: {reason}"));
        self.unread += 1;
        self.shown_unread.fetch_add(1, Ordering::Relaxed);
    }

    /// Ends the pass: returns the sinks and the tally, and the error of the first failed sink, which is dropped.
    ///
    /// # Errors
    /// The tally is lost.
    pub(super) fn leave(self, to: &mut Sinks) -> Result<(Tally, Result<(), Failure>), Failure> {
        let (mut tally, sinks) = match self.seats {
            Seats::Here {
                tally,
                sinks,
                progress,
            } => {
                progress.finish();
                let sinks = sinks
                    .into_iter()
                    .map(|seat| seat.left_by(Listening::finish));
                (*tally, sinks.collect::<Vec<_>>())
            }
            Seats::Apart {
                tally,
                sinks,
                progress,
            } => {
                // The result is complete without the progress line, which waits for a terminal that was stopped.
                match returned(progress) {
                    Ok(progress) => progress.finish(),
                    Err(failure) => {
                        console::warn(&format!("no progress is shown: {failure}"));
                    }
                }
                let (tally, _) = returned(tally)?;
                let sinks = sinks.into_iter().map(|seat| seat.left_by(rejoined));
                (tally, sinks.collect())
            }
        };
        tally.skipped += self.unread;
        let mut written = Ok(());
        for sink in sinks {
            match sink {
                Ok(sink) => to.0.push(sink),
                Err(failure) => written = written.and(Err(failure)),
            }
        }
        Ok((tally, written))
    }
}

impl<L> Seat<L> {
    fn left_by(
        self,
        leave: impl FnOnce(L) -> Result<Box<dyn Sink>, Failure>,
    ) -> Result<Box<dyn Sink>, Failure> {
        match self {
            Self::Silent(sink) => Ok(sink),
            Self::Listens(listening) => leave(listening),
        }
    }
}

/// A sink as a subscriber. After its first error it takes no more events, and asks that the run ends.
struct Listening {
    sink: Box<dyn Sink>,
    failed: Option<Failure>,
    stop: Stop,
}

impl Listening {
    fn new(sink: Box<dyn Sink>, stop: &Stop) -> Self {
        Self {
            sink,
            failed: None,
            stop: stop.clone(),
        }
    }

    fn finish(self) -> Result<Box<dyn Sink>, Failure> {
        self.failed.map_or(Ok(self.sink), Err)
    }
}

impl Subscriber for Listening {
    fn receive(&mut self, event: &Event) {
        if self.failed.is_some() {
            return;
        }
        if let Err(failure) = self.sink.receive(event) {
            self.failed = Some(failure);
            self.stop.request();
        }
    }
}

/// A subscriber on its own thread; its time per event is measured as a round of that thread.
struct Rounds<S> {
    subscriber: S,
    timing: &'static Timing,
}

impl<S> Rounds<S> {
    fn new(subscriber: S, timing: &'static Timing) -> Self {
        Self { subscriber, timing }
    }
}

impl<S: Subscriber> Subscriber for Rounds<S> {
    fn receive(&mut self, event: &Event) {
        self.subscriber.receive(event);
        self.timing.end_round();
    }
}

fn rejoined(listening: Subscribed<Rounds<Listening>>) -> Result<Box<dyn Sink>, Failure> {
    returned(listening)?.finish()
}

fn returned<S>(subscribed: Subscribed<Rounds<S>>) -> Result<S, Failure> {
    let subscriber = subscribed.join();
    subscriber.map(|s| s.subscriber).map_err(|reason| {
        Failure::criteria(format!(
            "a thread that writes the result did not finish: {reason}"
        ))
    })
}

//! Subscribers on threads of their own, and what becomes of one that does not come to its end.

use super::{Events, Queue};
use crate::threads::join;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use stillpoint_slam::Subscriber;

/// A subscriber on a thread of its own, to be had back when the run is over.
pub struct Subscribed<S> {
    done: Receiver<Result<S, String>>,
}

impl<S> Subscribed<S> {
    /// Waits until the run is over and the subscriber has received everything, and gives it back.
    ///
    /// # Errors
    /// Why it panicked, if it did, or that it took too long over an event when the run ended. The run went on without it.
    pub fn join(self) -> Result<S, String> {
        let gone = || Err("its thread ended".to_owned());
        self.done.recv().unwrap_or_else(|_| gone())
    }
}

/// A subscriber's thread, as the run sees it.
pub(crate) struct Listening {
    queue: Queue,
    thread: JoinHandle<()>,
    /// Says nothing, and ends with the thread.
    over: Receiver<()>,
    /// Answers in the thread's place.
    give_up: Box<dyn FnOnce() + Send>,
}

impl Listening {
    /// Waits until the subscriber has received all that waits, after the queue was closed. One that takes no further event for so
    /// long is left to itself, and has missed the rest.
    pub(crate) fn finish(self, patience: Duration) {
        let taken = || self.queue.look(|q| q.taken);
        loop {
            let before = taken();
            match self.over.recv_timeout(patience) {
                Ok(()) | Err(RecvTimeoutError::Disconnected) => return join(self.thread),
                Err(RecvTimeoutError::Timeout) if taken() > before => {}
                Err(RecvTimeoutError::Timeout) => break,
            }
        }
        self.queue.change(super::Waiting::give_up);
        (self.give_up)();
    }
}

/// Starts the thread of a subscriber.
pub(crate) fn start<S: Subscriber + Send + 'static>(
    name: &str,
    events: Events,
    subscriber: S,
    begin: impl FnOnce() + Send + 'static,
) -> std::io::Result<(Subscribed<S>, Listening)> {
    let (sender, done): (SyncSender<Result<S, String>>, _) = sync_channel(1);
    let (alive, over) = sync_channel(0);
    let queue = Arc::clone(&events.queue);
    let instead = sender.clone();
    let thread = std::thread::Builder::new().name(name.to_owned());
    let thread = thread.spawn(move || {
        let _alive: SyncSender<()> = alive;
        let mut subscriber = subscriber;
        let listened = catch_unwind(AssertUnwindSafe(|| {
            begin();
            events.iter().for_each(|event| subscriber.receive(&event));
        }));
        let end = listened.map(|()| subscriber);
        // Nobody may want it back, or it was given up.
        let _ = sender.try_send(end.map_err(|panic| crate::health::reason_of(panic.as_ref())));
    })?;
    let listening = Listening {
        queue,
        thread,
        over,
        give_up: Box::new(move || {
            let why = "it did not answer any more and was given up".to_owned();
            let _ = instead.try_send(Err(why));
        }),
    };
    Ok((Subscribed { done }, listening))
}

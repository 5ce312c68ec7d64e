//! Subscribers on their own threads, and the handling of hanging ones.

use super::{Events, Queue};
use crate::threads::join;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use stillpoint_slam::Subscriber;

/// A subscriber on its own thread, which is returned after the run.
pub struct Subscribed<S> {
    done: Receiver<Result<S, String>>,
}

impl<S> Subscribed<S> {
    /// Waits until the run is over and the subscriber has received everything, and returns it.
    ///
    /// # Errors
    /// It panicked, or took too long for an event at the end of the run, which continued without it.
    pub fn join(self) -> Result<S, String> {
        let gone = || Err("its thread ended".to_owned());
        self.done.recv().unwrap_or_else(|_| gone())
    }
}

/// A subscriber's thread, as seen by the run.
pub(crate) struct Listening {
    queue: Queue,
    thread: JoinHandle<()>,
    /// Never receives; disconnected when the thread ends.
    over: Receiver<()>,
    /// Reports the failure on behalf of the thread.
    give_up: Box<dyn FnOnce() + Send>,
}

impl Listening {
    /// After the queue was closed, waits until the subscriber has received all pending events. If it takes no further event for `patience`,
    /// it is abandoned and misses the rest.
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
        // The receiver may be gone, or the subscriber was abandoned.
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

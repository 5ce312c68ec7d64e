//! What a run finds, on its way out: events in, messages to topics and to the recording.

use crate::options::Options;
use crate::outputs::Outputs;
use crate::record::Recorder;
use crate::timing::Timing;
use std::sync::{Arc, OnceLock};
use stillpoint::ros_events::{FrameNames, Mount, Outgoing, Publisher, Topic};
use stillpoint::slam::{Event, Subscriber};

/// Events that wait for the place of the camera on the robot at most: three minutes of frames. What is older is not published.
const BACKLOG: usize = 8192;

/// Where the camera is on the robot, once that is decided: then the names of its frames are, too.
#[derive(Clone, Debug)]
pub struct Mounting {
    /// As transforms say; none where the camera's own body is the base, and the transform from it is published here.
    pub mount: Option<Mount>,
    /// Names of the frames.
    pub names: FrameNames,
}

/// Shared by those who wait for it.
pub type Decided = Arc<OnceLock<Mounting>>;

impl Mounting {
    /// Has a publisher say it so.
    #[must_use]
    pub fn apply(&self, publisher: Publisher) -> Publisher {
        let publisher = publisher.with_names(self.names.clone());
        match self.mount {
            Some(mount) => publisher.with_mount(mount),
            None => publisher,
        }
    }
}

/// Publishes the events of a run.
pub struct Outlet {
    publisher: Option<Publisher>,
    decided: Decided,
    applied: bool,
    waiting: Vec<Event>,
    outputs: Arc<Outputs>,
    recorder: Option<Recorder>,
    publish_tf: bool,
    timing: Timing,
}

impl Outlet {
    /// Of a run; `publisher` goes on where there was one before.
    #[must_use]
    pub fn new(
        publisher: Publisher,
        decided: &Decided,
        outputs: &Arc<Outputs>,
        recorder: Option<Recorder>,
        options: &Options,
    ) -> Self {
        Self {
            publisher: Some(publisher),
            decided: Arc::clone(decided),
            applied: false,
            waiting: Vec::new(),
            outputs: Arc::clone(outputs),
            recorder,
            publish_tf: options.publish_tf,
            timing: Timing::default(),
        }
    }

    /// Tells when odometry was sent.
    #[must_use]
    pub fn timed(self, timing: Timing) -> Self {
        Self { timing, ..self }
    }

    fn send(&self, messages: &[Outgoing]) {
        for message in messages {
            if self.publish_tf || message.topic != Topic::Tf {
                self.outputs.send(message);
            }
            if message.topic == Topic::Odometry {
                self.timing.sent(message.time);
            }
            if let Some(recorder) = &self.recorder {
                recorder.found(message);
            }
        }
    }

    /// Publishes what waited, as soon as it is decided how.
    fn begin(&mut self) {
        let Some(mounting) = self.decided.get().filter(|_| !self.applied) else {
            return;
        };
        self.applied = true;
        self.publisher = self.publisher.take().map(|p| mounting.apply(p));
        for event in std::mem::take(&mut self.waiting) {
            self.publish(&event);
        }
    }

    fn publish(&mut self, event: &Event) {
        if let Some(publisher) = &mut self.publisher {
            let messages = publisher.publish(event);
            self.send(&messages);
        }
    }

    /// Publishes what is left, and gives the publisher back.
    pub fn finish(mut self) -> Option<Publisher> {
        self.begin();
        let messages = self.publisher.as_mut().map(Publisher::finish);
        self.send(&messages.unwrap_or_default());
        self.publisher.take()
    }
}

impl Subscriber for Outlet {
    fn receive(&mut self, event: &Event) {
        self.begin();
        if self.applied {
            self.publish(event);
        } else if self.waiting.len() < BACKLOG {
            self.waiting.push(event.clone());
        }
    }
}

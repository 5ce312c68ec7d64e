//! Output of a run: converts events to messages, for topics and the recording.

use crate::options::Options;
use crate::outputs::Outputs;
use crate::record::Recorder;
use crate::timing::Timing;
use std::sync::{Arc, OnceLock};
use stillpoint::ros_events::{FrameNames, Mount, Outgoing, Publisher, Topic};
use stillpoint::slam::{Event, Subscriber};

/// Maximum number of events queued until the camera's mount is decided: three minutes of frames. Older ones are not published.
const BACKLOG: usize = 8192;

/// The camera's mount on the robot, and the names of frames.
#[derive(Clone, Debug)]
pub struct Mounting {
    /// From transforms; `None` if the camera's body is the base, with its transform published by this node.
    pub mount: Option<Mount>,
    /// Names of the frames.
    pub names: FrameNames,
}

/// Set once, and shared by all outputs.
pub type Decided = Arc<OnceLock<Mounting>>;

impl Mounting {
    /// Configures a publisher.
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
    /// For a run; `publisher` may continue from an earlier run.
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

    /// Records when odometry is sent.
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

    /// Publishes queued events as soon as the mount is decided.
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

    /// Publishes remaining messages, and returns the publisher.
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

//! The recording of a run: pairs of images, and the results.
//!
//! Both images of a pair get the same log time, by which [`stillpoint::recordings`] pairs them again, so that a replay has the tracked
//! frames.

use std::path::Path;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use stillpoint::recordings::{MessageFile, TopicInfo};
use stillpoint::ros_events::Outgoing;

/// Maximum number of messages queued for the disk: a second of images and results.
const WAITING: usize = 60;

/// A message for the file.
pub struct Entry {
    /// Its topic.
    pub topic: String,
    /// `sensor_msgs/msg/Image`.
    pub type_name: &'static str,
    /// Definition with nested messages.
    pub definition: fn() -> String,
    /// Log time, ns.
    pub time: u64,
    /// Whether players should latch it.
    pub latched: bool,
    /// CDR with its encapsulation header.
    pub bytes: Vec<u8>,
}

enum Order {
    Write(Entry),
    Found(Outgoing),
}

/// Accepts messages from any thread. Blocks while the disk does not keep up: replays need every frame.
#[derive(Clone)]
pub struct Recorder(SyncSender<Order>);

impl Recorder {
    /// Writes a received message.
    pub fn write(&self, entry: Entry) {
        // Fails only after an error that `finish` reports.
        let _ = self.0.send(Order::Write(entry));
    }

    /// Writes a result.
    pub fn found(&self, message: &Outgoing) {
        let _ = self.0.send(Order::Found(message.clone()));
    }
}

/// A recording in progress.
pub struct Recording {
    thread: JoinHandle<Result<(), String>>,
}

impl Recording {
    /// Creates a file.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn begin(path: &Path) -> Result<(Self, Recorder), String> {
        let mut file = MessageFile::create(path).map_err(|e| format!("record: {e}"))?;
        let (orders, inbox) = sync_channel(WAITING);
        let thread = std::thread::Builder::new()
            .name("record".to_owned())
            .spawn(move || {
                for order in inbox {
                    write(&mut file, order).map_err(|e| format!("record: {e}"))?;
                }
                file.finish().map_err(|e| format!("record: {e}"))
            });
        let thread = thread.map_err(|e| format!("record: expected a thread, found: {e}"))?;
        Ok((Self { thread }, Recorder(orders)))
    }

    /// Waits until all is written; every [`Recorder`] must be dropped before.
    ///
    /// # Errors
    /// Failures to write.
    pub fn finish(self) -> Result<(), String> {
        let panicked = |_| Err("record: its thread panicked".to_owned());
        self.thread.join().unwrap_or_else(panicked)
    }
}

fn write(file: &mut MessageFile, order: Order) -> stillpoint::recordings::Result<()> {
    match order {
        Order::Write(entry) => {
            let info = TopicInfo {
                name: &entry.topic,
                type_name: entry.type_name,
                definition: entry.definition,
                is_latched: entry.latched,
            };
            file.write(info, entry.time, &entry.bytes)
        }
        Order::Found(message) => {
            let topic = message.topic;
            let info = TopicInfo {
                name: topic.name(),
                type_name: topic.type_name(),
                definition: move || topic.definition(),
                is_latched: topic.is_latched(),
            };
            file.write(info, message.time, &message.bytes)
        }
    }
}

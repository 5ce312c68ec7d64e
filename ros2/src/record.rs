//! The recording of a run: images as they came, pair by pair, and what was found.
//!
//! The images of a pair are written at one time, by which [`stillpoint::recordings`] knows them as a pair again, so that a replay of the run's log sees the frames that were tracked.

use std::path::Path;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use stillpoint::recordings::{MessageFile, TopicInfo};
use stillpoint::ros_events::Outgoing;

/// Messages that wait for the disk at most: a second of images and what was found.
const WAITING: usize = 60;

/// A message on its way to the file.
pub struct Entry {
    /// Its topic.
    pub topic: String,
    /// `sensor_msgs/msg/Image`.
    pub type_name: &'static str,
    /// With those that it holds.
    pub definition: fn() -> String,
    /// ns.
    pub time: u64,
    /// Whether players offer it to who comes later.
    pub latched: bool,
    /// CDR with its encapsulation header.
    pub bytes: Vec<u8>,
}

enum Order {
    Write(Entry),
    Found(Outgoing),
}

/// Where messages are handed over, from any thread. Who hands one over waits while the disk does not keep up: a frame that is missing could not be replayed.
#[derive(Clone)]
pub struct Recorder(SyncSender<Order>);

impl Recorder {
    /// Writes a message that came.
    pub fn write(&self, entry: Entry) {
        // A file that failed has said so; its thread is gone.
        let _ = self.0.send(Order::Write(entry));
    }

    /// Writes what was found.
    pub fn found(&self, message: &Outgoing) {
        let _ = self.0.send(Order::Found(message.clone()));
    }
}

/// A recording in the making.
pub struct Recording {
    thread: JoinHandle<Result<(), String>>,
}

impl Recording {
    /// Begins a file where nothing is.
    ///
    /// # Errors
    /// Something is there, or cannot be written.
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

    /// Waits until all is written; every [`Recorder`] has to be gone.
    ///
    /// # Errors
    /// What could not be written.
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

//! Writes messages to an MCAP file that ROS 2 tools open.

use crate::error::{RecordingError, Result};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use stillpoint_datasets::{AtomicFile, open_regular};
use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, Message, Version, Wire};

/// QoS profile that `ros2 bag play` offers on a latched topic, as rosbag2 states it: reliable, transient local.
const LATCHED: &str = "- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
";

/// Writes messages. The file gets its name only when [`MessageFile::finish`] succeeds.
pub struct MessageFile {
    path: PathBuf,
    writer: mcap::Writer<BufWriter<AtomicFile>>,
    channels: BTreeMap<String, Channel>,
}

struct Channel {
    id: u16,
    messages: u32,
}

impl std::fmt::Debug for MessageFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MessageFile")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

/// Declaration of a topic, written before its first message.
#[derive(Clone, Copy, Debug)]
pub struct TopicInfo<'a, F> {
    /// Topic name, such as `/tf`.
    pub name: &'a str,
    /// Type name, such as `tf2_msgs/msg/TFMessage`.
    pub type_name: &'a str,
    /// Returns the definition of the type and its nested types; called once.
    pub definition: F,
    /// Whether late subscribers get its last message.
    pub is_latched: bool,
}

impl MessageFile {
    /// Starts a new file.
    ///
    /// # Errors
    /// The path exists, or is not writable.
    pub fn create(path: &Path) -> Result<Self> {
        if path.exists() {
            return Err(RecordingError::format(
                path,
                "a new file",
                "one that exists",
                "choose another name, or remove it",
            ));
        }
        Self::replace(path)
    }

    /// Starts a file that replaces an existing one when it is finished.
    ///
    /// # Errors
    /// The path is not writable.
    pub fn replace(path: &Path) -> Result<Self> {
        // A device, pipe or socket can neither be replaced nor written at several positions, as an index needs.
        if path.exists()
            && let Err(e) = open_regular(path)
        {
            let found = if path.is_dir() {
                "a folder".to_owned()
            } else {
                e.to_string()
            };
            return Err(RecordingError::format(
                path,
                "a file to write to",
                found,
                "choose another name",
            ));
        }
        let file = AtomicFile::create(path).map_err(|e| refused(path, &e))?;
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library("stillpoint");
        let writer = options
            .create(BufWriter::new(file))
            .map_err(|e| refused(path, &e))?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            channels: BTreeMap::new(),
        })
    }

    /// Writes a message in little-endian CDR, with its stamp in ns.
    ///
    /// # Errors
    /// A failed write.
    pub fn write<F: FnOnce() -> String>(
        &mut self,
        topic: TopicInfo<'_, F>,
        time: u64,
        cdr: &[u8],
    ) -> Result<()> {
        self.add(topic, time, cdr)
            .map_err(|e| refused(&self.path, &e))
    }

    fn add<F: FnOnce() -> String>(
        &mut self,
        topic: TopicInfo<'_, F>,
        time: u64,
        cdr: &[u8],
    ) -> mcap::McapResult<()> {
        if !self.channels.contains_key(topic.name) {
            let definition = (topic.definition)();
            let schema =
                self.writer
                    .add_schema(topic.type_name, "ros2msg", definition.as_bytes())?;
            let mut metadata = BTreeMap::new();
            if topic.is_latched {
                metadata.insert("offered_qos_profiles".to_owned(), LATCHED.to_owned());
            }
            let id = self
                .writer
                .add_channel(schema, topic.name, "cdr", &metadata)?;
            self.channels
                .insert(topic.name.to_owned(), Channel { id, messages: 0 });
        }
        if let Some(channel) = self.channels.get_mut(topic.name) {
            let header = MessageHeader {
                channel_id: channel.id,
                sequence: channel.messages,
                log_time: time,
                publish_time: time,
            };
            channel.messages = channel.messages.wrapping_add(1);
            self.writer.write_to_known_channel(&header, cdr)?;
        }
        Ok(())
    }

    pub(crate) fn write_value<'a, T: Message + Wire<'a>>(
        &mut self,
        topic: &'static str,
        time: u64,
        message: &T,
    ) -> Result<()> {
        let topic = TopicInfo {
            name: topic,
            type_name: T::NAME,
            definition: || ros::definition::<T>(Version::Ros2),
            is_latched: false,
        };
        self.write(
            topic,
            time,
            &ros::to_bytes(message, Format::CdrLittleEndian),
        )
    }

    /// Writes indexes and summary, and gives the file its name.
    ///
    /// # Errors
    /// A failed write.
    pub fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(|e| refused(&self.path, &e))?;
        let file = self.writer.into_inner().into_inner();
        file.map_err(std::io::IntoInnerError::into_error)
            .and_then(AtomicFile::commit)
            .map_err(|e| refused(&self.path, &e))
    }
}

fn refused(path: &Path, e: &dyn std::fmt::Display) -> RecordingError {
    let advice = "check the folder's permissions and the free space";
    RecordingError::format(path, "to write it", e.to_string(), advice)
}

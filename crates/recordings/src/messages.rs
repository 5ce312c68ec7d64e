//! Messages as an MCAP file that the tools of ROS 2 open.

use crate::error::{RecordingError, Result};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use stillpoint_datasets::{AtomicFile, open_regular};
use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, Message, Version, Wire};

/// What `ros2 bag play` offers on a topic, in the words of rosbag2: reliable, the last message kept for who comes later.
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

/// Writes messages. The file has its name only when [`MessageFile::finish`] has come to its end.
pub struct MessageFile {
    path: PathBuf,
    writer: mcap::Writer<BufWriter<AtomicFile>>,
    channels: BTreeMap<String, Channel>,
}

/// A topic, and how many messages it had.
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

/// A topic as a file declares it before its first message.
#[derive(Clone, Copy, Debug)]
pub struct TopicInfo<'a, F> {
    /// `/tf`.
    pub name: &'a str,
    /// `tf2_msgs/msg/TFMessage`.
    pub type_name: &'a str,
    /// Gives the definition of that type, with those that it holds; asked once.
    pub definition: F,
    /// Whether players offer its last message to those that come later.
    pub is_latched: bool,
}

impl MessageFile {
    /// Begins a file at a path where nothing is.
    ///
    /// # Errors
    /// Something is there, or cannot be written.
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

    /// Begins a file that takes the place of an older one when it is finished.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn replace(path: &Path) -> Result<Self> {
        // A device, pipe or socket can neither be replaced nor written to in several places, as an index needs.
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
    /// The system's reason.
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

    /// Writes a message as a value.
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
    /// The system's reason.
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

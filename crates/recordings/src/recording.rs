//! A recording: its files as one, and what their messages say.

use crate::error::{RecordingError, Result};
use crate::store::blocks::Bytes;
use crate::store::{Channel, Contents, Slot, Store, bag, mcap, seconds};
use std::path::{Path, PathBuf};
use stillpoint_ros_messages::{Format, Wire, from_bytes};

/// What a file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Mcap,
    Bag,
}

impl Kind {
    fn of(head: &[u8]) -> Option<Self> {
        if head.starts_with(mcap::MAGIC) {
            Some(Self::Mcap)
        } else if head.starts_with(bag::MAGIC) {
            Some(Self::Bag)
        } else {
            None
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Mcap => "MCAP",
            Self::Bag => "ROS 1 bag",
        }
    }
}

/// Files of messages, scanned.
#[derive(Debug)]
pub(crate) struct Recording {
    pub(crate) path: PathBuf,
    pub(crate) kind: Kind,
    pub(crate) contents: Contents,
    stores: Vec<Box<dyn Store>>,
}

impl Recording {
    /// Scans a file.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let mut bytes = Bytes::open(path)?;
        let head = bytes.get(0, 16)?;
        let Some(kind) = Kind::of(&head) else {
            return Err(unknown(path, &head));
        };
        let (store, contents) = match kind {
            Kind::Mcap => mcap::open(bytes, 0)?,
            Kind::Bag => bag::open(bytes, 0)?,
        };
        Ok(Self {
            path: path.to_owned(),
            kind,
            contents,
            stores: vec![Box::new(store)],
        })
    }

    /// What kind of file it is, in words.
    pub(crate) fn format(&self) -> &'static str {
        self.kind.name()
    }

    pub(crate) fn channel(&self, slot: &Slot) -> &Channel {
        &self.contents.channels[slot.channel as usize]
    }

    /// The bytes of a message.
    pub(crate) fn read(&mut self, slot: &Slot) -> Result<Vec<u8>> {
        self.stores[usize::from(slot.place.file)].read(&slot.place)
    }

    /// The message in bytes that [`Self::read`] gave.
    pub(crate) fn parse<'b, T: Wire<'b>>(&self, slot: &Slot, bytes: &'b [u8]) -> Result<T> {
        let channel = self.channel(slot);
        let format = channel.format.unwrap_or(Format::CdrLittleEndian);
        from_bytes(bytes, format).map_err(|source| RecordingError::Message {
            path: self.path.clone(),
            topic: channel.topic.clone(),
            stamp: seconds(slot.logged),
            source,
        })
    }

    /// Messages of a channel, in the order of the file.
    pub(crate) fn slots_of(&self, channel: u32) -> impl Iterator<Item = &Slot> {
        self.contents
            .slots
            .iter()
            .filter(move |s| s.channel == channel)
    }

    /// Channels of a type.
    pub(crate) fn channels_of(&self, type_name: &str) -> Vec<u32> {
        let all = self.contents.channels.iter().enumerate();
        all.filter(|(_, c)| c.type_name == type_name && c.format.is_some())
            .map(|(i, _)| i as u32)
            .collect()
    }

    pub(crate) fn topic(&self, channel: u32) -> &str {
        &self.contents.channels[channel as usize].topic
    }
}

/// What a file of no known format may be.
fn unknown(path: &Path, head: &[u8]) -> RecordingError {
    let (found, advice) = if head.is_empty() {
        ("an empty file", "record it again")
    } else if head.starts_with(b"#ROSBAG V1") {
        ("a bag of version 1", "convert it with `rosbag fix`")
    } else if head.starts_with(b"SQLite format 3\0") {
        (
            "a data base of SQLite",
            "name a program that was built with the feature `sqlite`",
        )
    } else {
        (
            "a file of another format",
            "check the path, or name the folder of a data set",
        )
    };
    let expected = "a data set folder, or a recording (MCAP, rosbag2, ROS 1 bag)";
    RecordingError::format(path, expected, found, advice)
}

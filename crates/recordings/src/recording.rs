//! A recording: combines its files, and reads and parses their messages.

use crate::budget::Unpacking;
use crate::error::{RecordingError, Result};
use crate::rosbag2;
use crate::store::blocks::{Block, BlockFile, Blocks, Bytes, Compression, decompress};
#[cfg(feature = "sqlite")]
use crate::store::sqlite::Sqlite;
use crate::store::temporary::Temporary;
use crate::store::{Channel, Contents, Place, Slot, Store, bag, largest_message, mcap, seconds};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint_datasets::SetBack;
use stillpoint_ros_messages::{Format, Wire, from_bytes};

/// Reopens a file without scanning it.
#[derive(Clone, Debug)]
enum Opener {
    Blocks(PathBuf, Vec<Block>),
    #[cfg(feature = "sqlite")]
    Sqlite(PathBuf),
    None,
}

#[derive(Debug)]
struct Nothing;

impl Store for Nothing {
    fn read(&mut self, _: &Place, _: &mut Blocks) -> Result<Vec<u8>> {
        Ok(Vec::new())
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Files {
    pub(crate) path: PathBuf,
    pub(crate) format: &'static str,
    pub(crate) contents: Arc<Contents>,
    openers: Vec<Opener>,
    /// Messages are compressed individually.
    compressed: bool,
    _temporary: Arc<Vec<Temporary>>,
}

impl Files {
    /// Scans a file, or the files of a rosbag2 folder.
    pub(crate) fn scan(path: &Path) -> Result<Self> {
        let plan = rosbag2::plan(path)?;
        let mut files = Self {
            path: path.to_owned(),
            format: "",
            contents: Arc::default(),
            openers: Vec::new(),
            compressed: plan.compressed_messages,
            _temporary: Arc::default(),
        };
        let mut contents = Contents::default();
        let mut temporary = Vec::new();
        let mut unpacking = Unpacking::default();
        for (i, file) in plan.files.iter().enumerate().take(usize::from(u16::MAX)) {
            let unpacked = match rosbag2::unpack(file) {
                // The other files remain usable.
                Err(e) if plan.files.len() > 1 => {
                    contents.remarks.add(|| format!("a file is left out: {e}"));
                    files.openers.push(Opener::None);
                    continue;
                }
                unpacked => unpacked?,
            };
            let at = unpacked
                .as_ref()
                .map_or(file.as_path(), |t| t.path.as_path());
            contents.merge(files.scan_one(at, file, i as u16, &mut unpacking)?);
            temporary.extend(unpacked);
        }
        contents.remarks.merge(plan.remarks);
        files._temporary = Arc::new(temporary);
        if plan.compressed_messages {
            files.look_again(&mut contents)?;
        }
        contents.finish();
        files.contents = Arc::new(contents);
        Ok(files)
    }

    /// Scans one file `at` a path that may differ from `named`.
    fn scan_one(
        &mut self,
        at: &Path,
        named: &Path,
        index: u16,
        unpacking: &mut Unpacking,
    ) -> Result<Contents> {
        let mut bytes = Bytes::open(at)?;
        let head = bytes.get(0, 16)?;
        let (store, contents) = if head.starts_with(mcap::MAGIC) {
            self.format = "MCAP";
            mcap::open(bytes, index, unpacking)?
        } else if head.starts_with(bag::MAGIC) {
            self.format = "ROS 1 bag";
            bag::open(bytes, index, unpacking)?
        } else {
            return self.scan_data_base(at, named, index, &head);
        };
        self.openers
            .push(Opener::Blocks(at.to_owned(), store.blocks));
        Ok(contents)
    }

    #[cfg(feature = "sqlite")]
    fn scan_data_base(
        &mut self,
        at: &Path,
        named: &Path,
        index: u16,
        head: &[u8],
    ) -> Result<Contents> {
        if !head.starts_with(SQLITE) {
            return Err(unknown(named, head));
        }
        self.format = "SQLite";
        self.openers.push(Opener::Sqlite(at.to_owned()));
        Sqlite::open(at)?.scan(index)
    }

    #[cfg(not(feature = "sqlite"))]
    fn scan_data_base(&mut self, _: &Path, named: &Path, _: u16, head: &[u8]) -> Result<Contents> {
        Err(unknown(named, head))
    }

    fn look_again(&self, contents: &mut Contents) -> Result<()> {
        let mut recording = self.open()?;
        contents.look_again(|slot, head| {
            let store = &mut recording.stores[usize::from(slot.place.file)];
            let stored = store.read(&slot.place, &mut recording.blocks)?;
            // Damage in the rest is reported when the message is read.
            Ok(decompress(Compression::Zstd, &stored, head as u64).0)
        })
    }

    pub(crate) fn open(&self) -> Result<Recording> {
        let open = |opener: &Opener| -> Result<Box<dyn Store>> {
            Ok(match opener {
                Opener::Blocks(path, blocks) => {
                    let mut store = BlockFile::new(Bytes::open(path)?);
                    store.blocks.clone_from(blocks);
                    Box::new(store)
                }
                #[cfg(feature = "sqlite")]
                Opener::Sqlite(path) => Box::new(Sqlite::open(path)?),
                Opener::None => Box::new(Nothing),
            })
        };
        let stores = self.openers.iter().map(open).collect::<Result<_>>()?;
        Ok(Recording {
            path: self.path.clone(),
            contents: Arc::clone(&self.contents),
            stores,
            blocks: Blocks::default(),
            files: self.clone(),
            set_back: Vec::new(),
        })
    }
}

#[derive(Debug)]
pub(crate) struct Recording {
    pub(crate) path: PathBuf,
    pub(crate) contents: Arc<Contents>,
    stores: Vec<Box<dyn Store>>,
    blocks: Blocks,
    pub(crate) files: Files,
    /// Where the clock that stamped the images was set back, as far as known.
    pub(crate) set_back: Vec<SetBack>,
}

impl Recording {
    pub(crate) fn channel(&self, slot: &Slot) -> &Channel {
        &self.contents.channels[slot.channel as usize]
    }

    pub(crate) fn read(&mut self, slot: &Slot) -> Result<Vec<u8>> {
        let store = &mut self.stores[usize::from(slot.place.file)];
        let stored = store.read(&slot.place, &mut self.blocks)?;
        if !self.files.compressed {
            return Ok(stored);
        }
        let channel = self.channel(slot);
        let largest = largest_message(&channel.type_name);
        let (bytes, error) = decompress(Compression::Zstd, &stored, largest);
        if let Some(found) = error {
            return Err(RecordingError::Image {
                path: self.path.clone(),
                topic: channel.topic.clone(),
                stamp: seconds(slot.logged),
                expected: "a message that unpacks".to_owned(),
                found,
            });
        }
        let unpacking = &mut self.blocks.unpacking;
        unpacking.take(&self.path, stored.len() as u64, bytes.len() as u64)?;
        Ok(bytes)
    }

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

    pub(crate) fn slots_of(&self, channel: u32) -> impl Iterator<Item = &Slot> {
        self.contents.slots_of(channel)
    }

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

const SQLITE: &[u8] = b"SQLite format 3\0";

/// Whether a file has the signature of a known format.
pub(crate) fn begins_as_one(path: &Path) -> bool {
    let head = Bytes::open(path).and_then(|mut bytes| bytes.get(0, 16));
    let known: [&[u8]; 4] = [mcap::MAGIC, bag::MAGIC, b"#ROSBAG V1", SQLITE];
    head.is_ok_and(|head| known.iter().any(|magic| head.starts_with(magic)))
}

/// Error: a file of unknown format, with a guess.
fn unknown(path: &Path, head: &[u8]) -> RecordingError {
    let (found, advice) = if head.is_empty() {
        ("an empty file", "record it again")
    } else if head.starts_with(b"#ROSBAG V1") {
        ("a bag of version 1", "convert it with `rosbag fix`")
    } else if head.starts_with(SQLITE) {
        (
            "a data base of SQLite",
            "use a program that was built with the feature `sqlite`",
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

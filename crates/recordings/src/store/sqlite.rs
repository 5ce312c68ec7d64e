//! Data bases of rosbag2 and of librealsense: one table of topics, one of messages.

use super::{Channel, Contents, HEAD, MOST_CHANNELS, Place, Store, full_name, is_looked_into};
use crate::error::{RecordingError, Result};
use crate::store::temporary::Temporary;
use rusqlite::{Connection, OpenFlags};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use stillpoint_ros_messages::Format;

/// A data base, open.
#[derive(Debug)]
pub(crate) struct Sqlite {
    path: PathBuf,
    connection: Connection,
    /// Copies, where the place of the file cannot be written to.
    _copies: Vec<Temporary>,
}

fn error(path: &Path) -> impl Fn(rusqlite::Error) -> RecordingError + '_ {
    |e| {
        let expected = "a data base of rosbag2";
        RecordingError::format(
            path,
            expected,
            e.to_string(),
            "record it again, or restore it with `sqlite3 FILE .recover`",
        )
    }
}

impl Sqlite {
    /// Opens a data base for reading. Messages that a recorder left in a write-ahead log are read as well: for that SQLite has to write an index beside the
    /// file, and where it cannot, both are copied.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
            | OpenFlags::SQLITE_OPEN_URI
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let mut log = path.as_os_str().to_owned();
        log.push("-wal");
        let log = PathBuf::from(log);
        let has_log = std::fs::metadata(&log).is_ok_and(|m| m.len() > 0);
        let open = |path: &Path, has_log: bool| {
            let connection = Connection::open_with_flags(uri(path, has_log), flags)?;
            connection.query_row("SELECT count(*) FROM topics", [], |_| Ok(()))?;
            Ok(connection)
        };
        let (connection, copies) = match open(path, has_log) {
            Ok(connection) => (connection, Vec::new()),
            Err(_) if has_log => {
                let (copy, _) = Temporary::create(path, ".db3")?;
                let beside = PathBuf::from(format!("{}-wal", copy.path.display()));
                let copies = vec![
                    Temporary::copy(path, copy.path.clone())?,
                    Temporary::copy(&log, beside)?,
                ];
                let connection = open(&copy.path, true).map_err(error(path))?;
                // The file goes with its copy's name.
                std::mem::forget(copy);
                (connection, copies)
            }
            Err(e) => return Err(error(path)(e)),
        };
        Ok(Self {
            path: path.to_owned(),
            connection,
            _copies: copies,
        })
    }

    /// Topics and messages.
    pub(crate) fn scan(&self, file: u16) -> Result<Contents> {
        let mut contents = Contents::default();
        let topics = self.topics(&mut contents).map_err(error(&self.path))?;
        // A data base that is damaged farther behind gives what is before.
        if let Err(e) = self.messages(&topics, file, &mut contents) {
            contents.remarks.push(format!(
                "the data base is cut off or damaged ({e}): what is before is used"
            ));
        }
        Ok(contents)
    }

    fn topics(&self, contents: &mut Contents) -> rusqlite::Result<BTreeMap<i64, u32>> {
        let sql = "SELECT id, name, type, serialization_format FROM topics ORDER BY id";
        let mut statement = self.connection.prepare(sql)?;
        let mut rows = statement.query([])?;
        let mut topics = BTreeMap::new();
        while let Some(row) = rows.next()? {
            let serialised: String = row.get(3)?;
            let channel = Channel {
                topic: row.get(1)?,
                type_name: full_name(&row.get::<_, String>(2)?),
                format: (serialised == "cdr").then_some(Format::CdrLittleEndian),
            };
            if topics.len() < MOST_CHANNELS {
                topics.insert(row.get(0)?, contents.channel(channel));
            }
        }
        Ok(topics)
    }

    fn messages(
        &self,
        topics: &BTreeMap<i64, u32>,
        file: u16,
        contents: &mut Contents,
    ) -> rusqlite::Result<()> {
        let sql = "SELECT id, topic_id, timestamp, length(data) FROM messages ORDER BY id";
        let mut statement = self.connection.prepare(sql)?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let (id, topic, logged): (i64, i64, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let Some(&channel) = topics.get(&topic) else {
                continue;
            };
            let len = row.get::<_, Option<i64>>(3)?.unwrap_or(0);
            let mut head = Vec::new();
            if is_looked_into(&contents.channels[channel as usize].type_name) && len > 0 {
                let blob = self
                    .connection
                    .blob_open("main", "messages", "data", id, true)?;
                // Too few bytes are told when the message is read.
                let _ = blob.take(HEAD as u64).read_to_end(&mut head);
            }
            let place = Place {
                file,
                block: None,
                offset: id as u64,
                len: u32::try_from(len).unwrap_or(u32::MAX),
            };
            contents.message(channel, logged, &head, place);
        }
        Ok(())
    }
}

/// The file as SQLite's name of it. One without a log is not going to change, and then nothing is written beside it.
fn uri(path: &Path, has_log: bool) -> String {
    let mut name = String::from("file:");
    for c in path.to_string_lossy().chars() {
        match c {
            '%' => name += "%25",
            '?' => name += "%3f",
            '#' => name += "%23",
            c => name.push(c),
        }
    }
    name + if has_log {
        "?mode=ro"
    } else {
        "?mode=ro&immutable=1"
    }
}

impl Store for Sqlite {
    fn read(&mut self, place: &Place) -> Result<Vec<u8>> {
        let row = place.offset as i64;
        let read = || {
            let mut blob = self
                .connection
                .blob_open("main", "messages", "data", row, true)?;
            // At once: every read of a blob goes along its chain of pages from the first one on.
            let mut bytes = vec![0; blob.len()];
            let read = blob.read_exact(&mut bytes);
            Ok(read.map(|_| bytes))
        };
        let bytes = read().map_err(error(&self.path))?;
        bytes.map_err(RecordingError::read(&self.path))
    }
}

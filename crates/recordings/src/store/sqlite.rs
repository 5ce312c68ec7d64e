//! SQLite databases of rosbag2 and of librealsense: a table of topics, and one of messages.

use super::blocks::Blocks;
use super::{Contents, Place, Store, is_looked_into};
use crate::budget::{LARGEST_IMAGE, LONGEST_NAME, MOST_NUMBERS};
use crate::error::{RecordingError, Result};
use crate::store::temporary::Temporary;
use rusqlite::blob::Blob;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use stillpoint_ros_messages::Format;

#[derive(Debug)]
pub(crate) struct Sqlite {
    path: PathBuf,
    bytes: u64,
    connection: Connection,
    /// Copies, used if the folder is not writable.
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
    /// Opens a database for reading, including messages in a recorder's write-ahead log: for that SQLite has to write an index beside the
    /// file; if it cannot, both are copied.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
            | OpenFlags::SQLITE_OPEN_URI
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let mut log = path.as_os_str().to_owned();
        log.push("-wal");
        let log = PathBuf::from(log);
        let size = |path: &Path| std::fs::metadata(path).map_or(0, |m| m.len());
        let has_log = size(&log) > 0;
        let bytes = size(path) + size(&log);
        let open = |path: &Path, has_log: bool| {
            let mut connection = Connection::open_with_flags(uri(path, has_log), flags)?;
            confine(&mut connection, bytes)?;
            connection.query_row("SELECT count(*) FROM main.sqlite_schema", [], |_| Ok(()))?;
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
                // The file is removed with its copy.
                std::mem::forget(copy);
                (connection, copies)
            }
            Err(e) => return Err(error(path)(e)),
        };
        for table in ["topics", "messages"] {
            plain_table(&connection, path, table)?;
        }
        Ok(Self {
            path: path.to_owned(),
            bytes,
            connection,
            _copies: copies,
        })
    }

    pub(crate) fn scan(&self, file: u16) -> Result<Contents> {
        let mut contents = Contents::of(self.bytes);
        let topics = self.topics(&mut contents).map_err(error(&self.path))?;
        // A damaged database gives the messages before the damage.
        if let Err(e) = self.messages(&topics, file, &mut contents) {
            contents.remarks.add(|| {
                format!("the data base is cut off or damaged ({e}): what is before is used")
            });
        }
        Ok(contents)
    }

    fn topics(&self, contents: &mut Contents) -> rusqlite::Result<BTreeMap<i64, u32>> {
        // An oversized text is not loaded: its length is known without it.
        let sql = "SELECT id,
            CASE WHEN octet_length(name) <= ?1 THEN name END,
            CASE WHEN octet_length(type) <= ?1 THEN type END,
            serialization_format = 'cdr' FROM topics ORDER BY id";
        let mut statement = self.connection.prepare(sql)?;
        let mut rows = statement.query([LONGEST_NAME as i64])?;
        let mut topics = BTreeMap::new();
        while let Some(row) = rows.next()? {
            let (name, kind): (Option<String>, Option<String>) = (row.get(1)?, row.get(2)?);
            let Some((name, kind)) = name.zip(kind) else {
                contents.remarks.add(|| {
                    format!(
                        "a topic without a name or type of at most {LONGEST_NAME} bytes is left out"
                    )
                });
                continue;
            };
            let is_cdr: Option<bool> = row.get(3)?;
            let format = is_cdr.unwrap_or(false).then_some(Format::CdrLittleEndian);
            let index = contents.channel(&name, &kind, format);
            if let Some(index) = index
                && topics.len() < MOST_NUMBERS
            {
                topics.insert(row.get(0)?, index);
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
        let sql = "SELECT id, topic_id, timestamp, octet_length(data) FROM messages ORDER BY id";
        let mut statement = self.connection.prepare(sql)?;
        let mut rows = statement.query([])?;
        let mut blob = None;
        while let Some(row) = rows.next()? {
            let (id, topic, logged): (i64, i64, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let Some(&channel) = topics.get(&topic) else {
                continue;
            };
            let len = row.get::<_, Option<i64>>(3)?.unwrap_or(0);
            let mut head = Vec::new();
            if is_looked_into(&contents.channels[channel as usize].type_name) && len > 0 {
                let found = self.blob(&mut blob, id)?;
                // Missing bytes are reported when the message is read.
                let _ = found
                    .take(contents.head_of(channel) as u64)
                    .read_to_end(&mut head);
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

    /// The message of a row. Reuses the previous blob handle, since opening one takes several times longer.
    fn blob<'b, 'c>(
        &'c self,
        kept: &'b mut Option<Blob<'c>>,
        row: i64,
    ) -> rusqlite::Result<&'b mut Blob<'c>> {
        if kept.as_mut().is_none_or(|blob| blob.reopen(row).is_err()) {
            let anew = self
                .connection
                .blob_open("main", "messages", "data", row, true)?;
            return Ok(kept.insert(anew));
        }
        kept.as_mut().ok_or(rusqlite::Error::QueryReturnedNoRows)
    }
}

/// SQLite VM instructions allowed for a file of any size: some seconds.
const FREE_STEPS: u64 = 100_000_000;
const STEPS: i32 = 100_000;

/// Restricts a database to plain rows: a hostile schema may contain views, triggers and functions that would run on reading. The number of
/// instructions is limited by the file size: scanning takes some ten per message.
fn confine(connection: &mut Connection, bytes: u64) -> rusqlite::Result<()> {
    for (what, on) in [
        (DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true),
        (DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false),
    ] {
        connection.set_db_config(what, on)?;
    }
    for (what, most) in [
        (Limit::SQLITE_LIMIT_LENGTH, LARGEST_IMAGE as i32),
        // Length of the statement that created a table.
        (Limit::SQLITE_LIMIT_SQL_LENGTH, 1 << 20),
        (Limit::SQLITE_LIMIT_COLUMN, 100),
        (Limit::SQLITE_LIMIT_EXPR_DEPTH, 50),
        (Limit::SQLITE_LIMIT_VDBE_OP, 10_000),
        (Limit::SQLITE_LIMIT_ATTACHED, 0),
        (Limit::SQLITE_LIMIT_TRIGGER_DEPTH, 1),
        (Limit::SQLITE_LIMIT_WORKER_THREADS, 0),
    ] {
        connection.set_limit(what, most)?;
    }
    let mut left = FREE_STEPS.saturating_add(bytes);
    connection.progress_handler(
        STEPS,
        Some(move || {
            left = left.saturating_sub(STEPS as u64);
            left == 0
        }),
    )
}

/// Refuses everything but plain tables: views, virtual tables, computed columns.
fn plain_table(connection: &Connection, path: &Path, table: &str) -> Result<()> {
    let kind = "SELECT type, rootpage > 0 FROM main.sqlite_schema
        WHERE name = ?1 COLLATE NOCASE AND type IN ('table', 'view')";
    let kind = connection.query_row(kind, [table], |row| {
        Ok((row.get::<_, String>(0)?, row.get::<_, bool>(1)?))
    });
    let computed = "SELECT count(*) FROM pragma_table_xinfo(?1) WHERE hidden <> 0";
    let computed = || connection.query_row(computed, [table], |row| row.get::<_, i64>(0));
    let found = match kind {
        Err(rusqlite::Error::QueryReturnedNoRows) => "none".to_owned(),
        Ok((kind, true)) if kind == "table" => match computed().map_err(error(path))? {
            0 => return Ok(()),
            n => format!("a table with {n} columns that are computed"),
        },
        Ok((kind, _)) => format!("a {kind} that is computed"),
        Err(e) => return Err(error(path)(e)),
    };
    let expected = format!("a data base of rosbag2 with a table of {table}");
    let advice = "record it again, or copy its rows into a new data base if you trust it";
    Err(RecordingError::format(path, &expected, found, advice))
}

/// The file's URI for SQLite. Without a log the file is opened as immutable, so that nothing is written beside it.
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
    fn read(&mut self, place: &Place, _: &mut Blocks) -> Result<Vec<u8>> {
        let row = place.offset as i64;
        let read = || {
            let mut blob = self
                .connection
                .blob_open("main", "messages", "data", row, true)?;
            // In one read: each read of a blob follows its page chain from the start.
            let mut bytes = vec![0; blob.len()];
            let read = blob.read_exact(&mut bytes);
            Ok(read.map(|_| bytes))
        };
        let bytes = read().map_err(error(&self.path))?;
        bytes.map_err(RecordingError::read(&self.path))
    }
}

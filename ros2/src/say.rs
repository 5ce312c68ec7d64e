//! What the node says: on standard error, and on /rosout.

use crate::arguments::Level;
use crate::bus::Writer;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use stillpoint::ros_messages::{Format, Log, Time, to_bytes};

/// Says things, from any thread.
#[derive(Clone)]
pub struct Voice(Arc<Inner>);

struct Inner {
    name: String,
    least: Level,
    rosout: Mutex<Option<Writer>>,
}

impl Voice {
    /// Of a node with this whole name.
    #[must_use]
    pub fn new(name: &str, least: Level) -> Self {
        Self(Arc::new(Inner {
            // As rcl names loggers.
            name: name.trim_start_matches('/').replace('/', "."),
            least,
            rosout: Mutex::new(None),
        }))
    }

    /// From now on on /rosout, too.
    pub fn on_rosout(&self, writer: Writer) {
        *self.0.rosout.lock().unwrap_or_else(PoisonError::into_inner) = Some(writer);
    }

    /// Says something.
    pub fn say(&self, level: Level, text: &str) {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        if level >= self.0.least {
            let word = format!("{level:?}").to_uppercase();
            eprintln!(
                "[{word}] [{}.{:09}] [{}]: {text}",
                now.as_secs(),
                now.subsec_nanos(),
                self.0.name
            );
        }
        let log = Log {
            stamp: Time {
                sec: now.as_secs() as i64,
                nanosec: now.subsec_nanos(),
            },
            level: level as u8,
            name: self.0.name.as_str().into(),
            msg: text.into(),
            ..Log::default()
        };
        let rosout = self.0.rosout.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(writer) = &*rosout {
            writer.send(&to_bytes(&log, Format::CdrLittleEndian));
        }
    }

    /// For the user.
    pub fn info(&self, text: &str) {
        self.say(Level::Info, text);
    }

    /// Something is amiss.
    pub fn warn(&self, text: &str) {
        self.say(Level::Warn, text);
    }

    /// Something does not work.
    pub fn error(&self, text: &str) {
        self.say(Level::Error, text);
    }
}

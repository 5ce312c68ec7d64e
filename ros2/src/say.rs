//! Log messages: on standard error, and on /rosout.

use crate::arguments::Level;
use crate::bus::Writer;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use stillpoint::ros_messages::{Format, Log, Time, to_bytes};

/// A logger for any thread.
#[derive(Clone)]
pub struct Voice(Arc<Inner>);

struct Inner {
    name: String,
    least: Level,
    rosout: Mutex<Option<Writer>>,
}

impl Voice {
    /// For a node with this full name.
    #[must_use]
    pub fn new(name: &str, least: Level) -> Self {
        Self(Arc::new(Inner {
            // As rcl names loggers.
            name: name.trim_start_matches('/').replace('/', "."),
            least,
            rosout: Mutex::new(None),
        }))
    }

    /// Adds /rosout.
    pub fn on_rosout(&self, writer: Writer) {
        *self.0.rosout.lock().unwrap_or_else(PoisonError::into_inner) = Some(writer);
    }

    /// Logs a message.
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

    /// Logs information.
    pub fn info(&self, text: &str) {
        self.say(Level::Info, text);
    }

    /// Logs a warning.
    pub fn warn(&self, text: &str) {
        self.say(Level::Warn, text);
    }

    /// Logs an error.
    pub fn error(&self, text: &str) {
        self.say(Level::Error, text);
    }
}

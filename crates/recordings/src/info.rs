//! Lists the contents of a recording without decoding it.

use crate::error::{RecordingError, Result};
use crate::recording::Files;
use crate::store::seconds;
use std::path::Path;

/// A topic of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Topic {
    /// Topic name.
    pub name: String,
    /// The ROS 2 type name.
    pub type_name: String,
    /// Number of messages.
    pub messages: u64,
    /// Times at which the first and the last of them were received, s; `None` without messages.
    pub received: Option<(f64, f64)>,
}

/// Contents of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// `MCAP`, `ROS 1 bag` or `SQLite`.
    pub format: &'static str,
    /// Sorted by name.
    pub topics: Vec<Topic>,
    /// Damage and missing parts, one sentence each.
    pub remarks: Vec<String>,
}

/// Scans a recording.
///
/// # Errors
/// A file that is no recording, or cannot be read.
pub fn info(path: &Path) -> Result<Info> {
    let files = Files::scan(path).map_err(RecordingError::on_one_line)?;
    let contents = &files.contents;
    let all = contents.channels.iter().zip(&contents.counts);
    let mut topics: Vec<Topic> = all
        .map(|(channel, count)| Topic {
            name: channel.topic.clone(),
            type_name: channel.type_name.clone(),
            messages: count.messages,
            received: (count.messages > 0).then(|| (seconds(count.first), seconds(count.last))),
        })
        .collect();
    topics.sort_by(|a, b| (&a.name, &a.type_name).cmp(&(&b.name, &b.type_name)));
    Ok(Info {
        format: files.format,
        topics,
        remarks: contents.remarks.lines(),
    })
}

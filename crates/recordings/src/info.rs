//! What is in a recording, without decoding it.

use crate::error::{RecordingError, Result};
use crate::recording::Files;
use crate::store::seconds;
use std::path::Path;

/// A topic of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Its type, as ROS 2 names it.
    pub type_name: String,
    /// Messages on it.
    pub messages: u64,
    /// When the first and the last of them were received, s; `None` without messages.
    pub received: Option<(f64, f64)>,
}

/// What a recording holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// `MCAP`, `ROS 1 bag` or `SQLite`.
    pub format: &'static str,
    /// By name.
    pub topics: Vec<Topic>,
    /// What is damaged or missing, one sentence each.
    pub remarks: Vec<String>,
}

/// Looks at a recording as a whole.
///
/// # Errors
/// What is no recording, or cannot be read.
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

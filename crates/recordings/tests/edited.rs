//! A camera recording whose messages are modified before it is opened.

use crate::files::put;
use crate::writers::*;
use std::path::PathBuf;
use stillpoint_recordings::{Input, OpenOptions, open};
use stillpoint_ros_messages::*;

pub(crate) const FRAMES: usize = 4;
pub(crate) const COLOUR: &str = "/camera/color/image_raw";
pub(crate) const INFO: &str = "/camera/color/camera_info";
pub(crate) const DEPTH: &str = "/camera/aligned_depth_to_color/image_raw";

/// Messages of a camera, kept in a folder until the test ends.
pub(crate) struct Recorded {
    pub(crate) dir: tempfile::TempDir,
    pub(crate) messages: Vec<Sent>,
}

impl Recorded {
    pub(crate) fn new() -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
            messages: camera("/camera", FRAMES),
        }
    }

    /// Replaces the messages of a topic; `edit` gets the frame number.
    pub(crate) fn edit<M: Message>(
        mut self,
        topic: &str,
        mut edit: impl FnMut(usize, &mut Sent),
    ) -> Self {
        let all = self.messages.iter_mut().filter(|m| m.topic == topic);
        let count = all.enumerate().map(|(k, m)| {
            assert_eq!(m.type_name, M::NAME);
            edit(k, m);
        });
        assert_eq!(count.count(), FRAMES, "{topic}");
        self
    }

    pub(crate) fn infos(self, mut change: impl FnMut(usize, &mut CameraInfo<'static>)) -> Self {
        self.edit::<CameraInfo<'_>>(INFO, |k, m| {
            let bytes: &'static [u8] = m.cdr.clone().leak();
            let mut info: CameraInfo<'static> = from_bytes(bytes, Format::CdrLittleEndian).unwrap();
            change(k, &mut info);
            *m = sent(&m.topic.clone(), m.time, &info);
        })
    }

    pub(crate) fn images(
        self,
        topic: &str,
        to: &str,
        mut change: impl FnMut(usize, Image<'static>) -> Image<'static>,
    ) -> Self {
        self.edit::<Image<'_>>(topic, |k, m| {
            let bytes: &'static [u8] = m.cdr.clone().leak();
            let image = from_bytes(bytes, Format::CdrLittleEndian).unwrap();
            *m = sent(to, m.time, &change(k, image));
        })
    }

    pub(crate) fn rename(mut self, from: &str, to: &str) -> Self {
        let all = self.messages.iter_mut().filter(|m| m.topic == from);
        all.for_each(|m| m.topic = to.to_owned());
        self
    }

    pub(crate) fn path(&self) -> PathBuf {
        put(self.dir.path(), "file.mcap", &mcap(&self.messages, None))
    }

    pub(crate) fn open(&self) -> Input {
        self.open_with(OpenOptions::default()).unwrap()
    }

    pub(crate) fn open_with(&self, options: OpenOptions) -> Result<Input, String> {
        open(&self.path(), &options).map_err(|e| e.to_string())
    }

    /// Checks that it is refused with all of these words.
    pub(crate) fn refused(&self, parts: &[&str]) {
        let said = self.open_with(OpenOptions::default()).unwrap_err();
        for part in parts {
            assert!(said.contains(part), "{said:?} lacks {part:?}");
        }
    }
}

pub(crate) fn said(input: &Input) -> String {
    [input.guesses(), input.warnings()].concat().join("\n")
}

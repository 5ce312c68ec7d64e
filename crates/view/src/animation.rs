//! Animations as GIF.
//!
//! GIF, because every browser, viewer, editor and messenger plays it; of APNG many show the first frame only. What it costs, a
//! palette of 256 colours, is made up for by a palette of each frame's own ([`Palette`]), and what did not change since the
//! frame before is not written again, which keeps resting parts of the image from flickering and the file small.

use crate::palette::Palette;
use crate::{Picture, ViewError};
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use std::borrow::Cow;
use std::io::Write;

/// How an animation is made of the frames that are pushed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnimationOptions {
    /// Every how many frames one is shown; 0 counts as 1.
    pub every: usize,
    /// Half width and height: a quarter of the file.
    pub halve: bool,
    /// Frames that are pushed per second of the recording; the animation runs at the recording's speed. Shown frames last at
    /// least 20 ms, below which browsers slow down.
    pub frames_per_second: f64,
}

impl Default for AnimationOptions {
    /// A third of the frames of a 30 Hz camera, at half size: ten a second look smooth enough.
    fn default() -> Self {
        Self {
            every: 3,
            halve: true,
            frames_per_second: 30.0,
        }
    }
}

/// Writes a GIF frame by frame; holds one frame at a time. It repeats forever.
pub struct Animation<W: Write> {
    file: File<W>,
    options: AnimationOptions,
    pushed: usize,
    /// Width and height of the pushed pictures.
    size: Option<(usize, usize)>,
    /// What a viewer shows now, RGB.
    shown: Vec<u8>,
    written: u32,
}

/// The size of the first frame is in the header.
enum File<W: Write> {
    Waiting(W),
    Begun(Encoder<W>),
    /// The header could not be written.
    Failed,
}

impl<W: Write> Animation<W> {
    /// Begins an animation. Nothing is written before the first frame.
    pub fn new(sink: W, options: AnimationOptions) -> Self {
        Self {
            file: File::Waiting(sink),
            options,
            pushed: 0,
            size: None,
            shown: Vec::new(),
            written: 0,
        }
    }

    /// Takes the next frame of the recording, and writes it if it is one that is shown.
    ///
    /// # Errors
    /// Any [`ViewError`] but [`ViewError::NoFrames`]; sizes are compared for frames that are not shown too.
    pub fn push(&mut self, picture: &Picture) -> Result<(), ViewError> {
        let found = (picture.width(), picture.height());
        if let Some(expected) = self.size
            && expected != found
        {
            return Err(ViewError::Size { expected, found });
        }
        let shown = self.pushed.is_multiple_of(self.options.every.max(1));
        self.pushed += 1;
        if !shown {
            return Ok(());
        }
        let small = if self.options.halve {
            Cow::Owned(picture.halved())
        } else {
            Cow::Borrowed(picture)
        };
        self.write_frame(&small)?;
        self.size = Some(found);
        Ok(())
    }

    fn write_frame(&mut self, picture: &Picture) -> Result<(), ViewError> {
        let (width, height) = size(picture)?;
        self.begin(width, height)?;
        let palette = Palette::of(picture);
        let frame = Frame {
            delay: self.delay(),
            dispose: DisposalMethod::Keep,
            transparent: Some(Palette::UNCHANGED),
            width,
            height,
            buffer: Cow::Owned(palette.indices(picture, &mut self.shown)),
            palette: Some(palette.rgb()),
            ..Frame::default()
        };
        match &mut self.file {
            File::Begun(encoder) => encoder.write_frame(&frame)?,
            File::Waiting(_) | File::Failed => return Err(ViewError::NoFrames),
        }
        self.written += 1;
        Ok(())
    }

    /// Writes the header, once.
    fn begin(&mut self, width: u16, height: u16) -> Result<(), ViewError> {
        self.file = match std::mem::replace(&mut self.file, File::Failed) {
            File::Waiting(sink) => {
                let mut encoder = Encoder::new(sink, width, height, &[])?;
                encoder.set_repeat(Repeat::Infinite)?;
                File::Begun(encoder)
            }
            file => file,
        };
        Ok(())
    }

    /// How long the next frame is shown, in hundredths of a second. What rounding takes from one frame the next ones get.
    fn delay(&self) -> u16 {
        let hundredths = 100.0 * self.options.every.max(1) as f64 / self.options.frames_per_second;
        let until = |frames: u32| (f64::from(frames) * hundredths).round();
        // The cast saturates, and makes 0 of what is no number.
        ((until(self.written + 1) - until(self.written)) as u16).max(2)
    }

    /// Frames written so far.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.written
    }

    /// Ends the file and gives the sink back, at the file's end.
    ///
    /// # Errors
    /// [`ViewError::NoFrames`], [`ViewError::Write`].
    pub fn finish(self) -> Result<W, ViewError> {
        match self.file {
            File::Begun(encoder) if self.written > 0 => Ok(encoder.into_inner()?),
            _ => Err(ViewError::NoFrames),
        }
    }
}

/// Width and height as GIF holds them.
fn size(picture: &Picture) -> Result<(u16, u16), ViewError> {
    let (w, h) = (picture.width(), picture.height());
    match (u16::try_from(w), u16::try_from(h)) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok((width, height)),
        _ if w == 0 || h == 0 => Err(ViewError::Empty(w, h)),
        _ => Err(ViewError::Large(w, h)),
    }
}

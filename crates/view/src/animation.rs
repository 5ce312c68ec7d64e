//! GIF animations.
//!
//! GIF plays in every browser, viewer, editor and messenger; many show only the first frame of an APNG. Each frame has its own palette of
//! up to 255 colours ([`Palette`]), and unchanged pixels are not written again, which avoids flicker in static parts and keeps the file
//! small.

use crate::palette::Palette;
use crate::{Picture, ViewError};
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use std::borrow::Cow;
use std::io::Write;

/// Settings of an animation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnimationOptions {
    /// Shows every n-th frame; 0 counts as 1.
    pub every: usize,
    /// Halves width and height: a quarter of the file.
    pub halve: bool,
    /// Pushed frames per second of the recording; playback is in real time. Shown frames last at least 20 ms, below which browsers slow
    /// down.
    pub frames_per_second: f64,
}

impl Default for AnimationOptions {
    /// A third of the frames of a 30 Hz camera, at half size: ten per second look smooth enough.
    fn default() -> Self {
        Self {
            every: 3,
            halve: true,
            frames_per_second: 30.0,
        }
    }
}

/// Writes an endless GIF frame by frame; holds one frame at a time.
pub struct Animation<W: Write> {
    file: File<W>,
    options: AnimationOptions,
    pushed: usize,
    size: Option<(usize, usize)>,
    shown: Vec<u8>,
    written: u32,
}

/// Created with the first frame, whose size is in the header.
enum File<W: Write> {
    Waiting(W),
    Begun(Encoder<W>),
    Failed,
}

impl<W: Write> Animation<W> {
    /// Starts an animation. Nothing is written before the first frame.
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

    /// Adds a frame of the recording, and writes it if it is shown.
    ///
    /// # Errors
    /// Any [`ViewError`] but [`ViewError::NoFrames`]; sizes are checked for skipped frames too.
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

    /// Duration of the next frame, in hundredths of a second; rounding errors do not accumulate.
    fn delay(&self) -> u16 {
        let hundredths = 100.0 * self.options.every.max(1) as f64 / self.options.frames_per_second;
        let until = |frames: u32| (f64::from(frames) * hundredths).round();
        // The cast saturates, and turns NaN to 0.
        ((until(self.written + 1) - until(self.written)) as u16).max(2)
    }

    /// Number of written frames.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.written
    }

    /// Completes the file and returns the sink.
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

fn size(picture: &Picture) -> Result<(u16, u16), ViewError> {
    let (w, h) = (picture.width(), picture.height());
    match (u16::try_from(w), u16::try_from(h)) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok((width, height)),
        _ if w == 0 || h == 0 => Err(ViewError::Empty(w, h)),
        _ => Err(ViewError::Large(w, h)),
    }
}

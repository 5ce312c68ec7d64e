//! Animations as APNG.
//!
//! APNG and not GIF: its encoder is in the tree already with the still pictures, it has all colours (256 would leave few for
//! the image once the marks have theirs), and browsers, README pages and image viewers show it; those that know PNG only
//! show the first frame. GIF would be streamed more simply, since APNG states the number of frames ahead of them: the sink
//! must seek, and the number is put in at the end.

use crate::encode::write_filtered;
use crate::{Picture, ViewError};
use std::io::{Seek, SeekFrom, Write};

/// How an animation is made of the frames that are pushed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnimationOptions {
    /// Every how many frames one is shown; 0 counts as 1.
    pub every: usize,
    /// Half width and height: a quarter of the file.
    pub halve: bool,
    /// Frames that are pushed per second of the recording; the animation runs at the recording's speed. Shown frames last at
    /// least 10 ms.
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

/// Writes an APNG frame by frame; holds one frame at a time. It repeats for ever.
#[derive(Debug)]
pub struct Animation<W: Write + Seek> {
    sink: W,
    options: AnimationOptions,
    pushed: usize,
    /// Width and height of the pushed pictures, and where the count of frames stands in the sink.
    begun: Option<((usize, usize), u64)>,
    written: u32,
    /// Number of the next chunk among those that are numbered.
    sequence: u32,
}

impl<W: Write + Seek> Animation<W> {
    /// Begins at the sink's position. Nothing is written before the first frame.
    pub fn new(sink: W, options: AnimationOptions) -> Self {
        Self {
            sink,
            options,
            pushed: 0,
            begun: None,
            written: 0,
            sequence: 0,
        }
    }

    /// Takes the next frame of the recording, and writes it if it is one that is shown.
    ///
    /// # Errors
    /// Any [`ViewError`] but [`ViewError::NoFrames`]; sizes are compared for frames that are not shown too.
    pub fn push(&mut self, picture: &Picture) -> Result<(), ViewError> {
        let found = (picture.width(), picture.height());
        if let Some((expected, _)) = self.begun
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
            picture.halved()
        } else {
            picture.clone()
        };
        let (header, pixels) = compress(&coarse(small))?;
        if self.begun.is_none() {
            self.sink.write_all(&SIGNATURE)?;
            chunk(&mut self.sink, *b"IHDR", &header)?;
            let position = self.sink.stream_position()?;
            chunk(&mut self.sink, *b"acTL", &control(1))?;
            self.begun = Some((found, position));
        }
        self.write_frame(&header, &pixels)
    }

    fn write_frame(&mut self, header: &[u8], pixels: &[u8]) -> Result<(), ViewError> {
        let mut frame = self.next_number().to_vec();
        // Width and height as in the header, no offset.
        frame.extend(&header[..8]);
        frame.extend([0; 8]);
        frame.extend(self.delay_ms().to_be_bytes());
        frame.extend(1000u16.to_be_bytes());
        // Neither disposal nor blending: each frame replaces all of the one before.
        frame.extend([0, 0]);
        chunk(&mut self.sink, *b"fcTL", &frame)?;
        if self.written == 0 {
            chunk(&mut self.sink, *b"IDAT", pixels)?;
        } else {
            let mut numbered = self.next_number().to_vec();
            numbered.extend(pixels);
            chunk(&mut self.sink, *b"fdAT", &numbered)?;
        }
        self.written += 1;
        Ok(())
    }

    fn next_number(&mut self) -> [u8; 4] {
        let number = self.sequence;
        self.sequence += 1;
        number.to_be_bytes()
    }

    /// How long a frame is shown, ms.
    fn delay_ms(&self) -> u16 {
        let ms = 1e3 * self.options.every.max(1) as f64 / self.options.frames_per_second;
        // The cast saturates, and makes 0 of what is no number.
        (ms.round() as u16).max(10)
    }

    /// Frames written so far.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.written
    }

    /// Ends the file and gives the sink back, at the file's end. Without this the file shows its first frame at most.
    ///
    /// # Errors
    /// [`ViewError::NoFrames`], [`ViewError::Write`].
    pub fn finish(mut self) -> Result<W, ViewError> {
        let (_, position) = self.begun.ok_or(ViewError::NoFrames)?;
        chunk(&mut self.sink, *b"IEND", &[])?;
        self.sink.seek(SeekFrom::Start(position))?;
        chunk(&mut self.sink, *b"acTL", &control(self.written))?;
        self.sink.seek(SeekFrom::End(0))?;
        self.sink.flush()?;
        Ok(self.sink)
    }
}

const SIGNATURE: [u8; 8] = [137, 80, 78, 71, 13, 10, 26, 10];

/// The content of `acTL`: number of frames, and 0 for repetition without end.
fn control(frames: u32) -> [u8; 8] {
    let mut control = [0; 8];
    control[..4].copy_from_slice(&frames.to_be_bytes());
    control
}

/// Five bits per channel: camera noise, which does not compress, mostly vanishes, and the eye misses little in motion.
fn coarse(picture: Picture) -> Picture {
    picture.map(|v| (v & 0xf8) | (v >> 5))
}

/// The header and the compressed pixels of a picture.
fn compress(picture: &Picture) -> Result<(Vec<u8>, Vec<u8>), ViewError> {
    let mut file = Vec::new();
    // Few levels repeat more often than their differences do: a quarter less than with adaptive filters.
    write_filtered(picture, &mut file, png::Filter::NoFilter)?;
    let (mut header, mut pixels) = (Vec::new(), Vec::new());
    let mut rest = file.get(SIGNATURE.len()..).unwrap_or_default();
    // Length, type, content, checksum.
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let Some((kind, after)) = after.split_first_chunk::<4>() else {
            break;
        };
        let Some((content, after)) = after.split_at_checked(u32::from_be_bytes(*length) as usize)
        else {
            break;
        };
        match kind {
            b"IHDR" => header.extend(content),
            b"IDAT" => pixels.extend(content),
            _ => {}
        }
        rest = after.get(4..).unwrap_or_default();
    }
    Ok((header, pixels))
}

/// Writes a chunk: length, type, content, checksum of the last two.
fn chunk(sink: &mut impl Write, kind: [u8; 4], content: &[u8]) -> Result<(), ViewError> {
    let length = u32::try_from(content.len()).map_err(std::io::Error::other)?;
    sink.write_all(&length.to_be_bytes())?;
    sink.write_all(&kind)?;
    sink.write_all(content)?;
    let crc = !crc32(crc32(u32::MAX, &kind), content);
    sink.write_all(&crc.to_be_bytes())?;
    Ok(())
}

/// Goes on with the checksum of the PNG specification, annex D, before its final complement.
fn crc32(start: u32, bytes: &[u8]) -> u32 {
    bytes.iter().fold(start, |crc, byte| {
        TABLE[((crc ^ u32::from(*byte)) & 0xff) as usize] ^ (crc >> 8)
    })
}

const TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut n = 0;
    while n < 256 {
        let (mut c, mut k) = (n as u32, 0);
        while k < 8 {
            c = if c & 1 == 1 {
                0xedb8_8320 ^ (c >> 1)
            } else {
                c >> 1
            };
            k += 1;
        }
        table[n] = c;
        n += 1;
    }
    table
};

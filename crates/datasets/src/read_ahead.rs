//! Reads and decodes frames ahead on a separate thread.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;
use stillpoint_imaging::{FrameSource, ImuSample, OdometrySample, RgbdFrame, SourceError};

type Item = Result<RgbdFrame, SourceError>;
#[derive(Debug, Default)]
struct Samples {
    inertial: Vec<ImuSample>,
    odometry: Vec<OdometrySample>,
}
/// A frame and the samples before it.
type Read = (Item, Samples);

/// Runs a source on its own thread, a limited number of frames ahead. Frames and their order are unchanged. A panic of the source becomes a
/// [`SourceError`] that ends the stream. Dropping it early stops and joins the thread.
#[derive(Debug)]
pub struct ReadAhead {
    // `None` after the end of the stream.
    frames: Option<Receiver<Read>>,
    thread: Option<JoinHandle<()>>,
    remaining: Option<usize>,
    is_live: bool,
    /// Samples that came with the returned frames.
    samples: Samples,
}

impl ReadAhead {
    /// Default number of frames read ahead: a quarter of a second at 30 Hz, about 15 MB of 640 x 480 frames.
    pub const DEFAULT_FRAMES: usize = 8;

    /// Starts reading, [`Self::DEFAULT_FRAMES`] ahead.
    #[must_use]
    pub fn new<S: FrameSource + 'static>(source: S) -> Self {
        Self::with_capacity(source, Self::DEFAULT_FRAMES)
    }

    /// Starts reading, `frames` ahead (at least one).
    #[must_use]
    pub fn with_capacity<S: FrameSource + 'static>(mut source: S, frames: usize) -> Self {
        let (remaining, is_live) = (source.remaining(), source.is_live());
        let (sender, receiver) = sync_channel(frames.max(1));
        let thread = std::thread::Builder::new()
            .name("read-ahead".to_owned())
            .spawn({
                let sender = sender.clone();
                move || {
                    while let Some(item) = source.next_frame() {
                        let last = matches!(&item, Err(e) if !e.recoverable);
                        // Sending fails when the receiver is gone.
                        let samples = Samples {
                            inertial: source.take_inertial(),
                            odometry: source.take_odometry(),
                        };
                        if sender.send((item, samples)).is_err() || last {
                            break;
                        }
                    }
                }
            });
        let thread = match thread {
            Ok(thread) => Some(thread),
            Err(e) => {
                // The channel is empty and holds at least one, so this cannot block.
                let failed = Err(SourceError {
                    message: format!(
                        "expected to start a thread for reading, found: {e}; end other programs"
                    ),
                    recoverable: false,
                });
                let _ = sender.try_send((failed, Samples::default()));
                None
            }
        };
        Self {
            frames: Some(receiver),
            thread,
            remaining,
            is_live,
            samples: Samples::default(),
        }
    }

    /// Joins the thread after its stream has ended, and reports its panic.
    fn finish(&mut self) -> Option<Item> {
        self.frames = None;
        self.remaining = Some(0);
        let panic = self.thread.take()?.join().err()?;
        let reason = panic
            .downcast_ref::<&str>()
            .map(|s| (*s).to_owned())
            .or_else(|| panic.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "unknown reason".to_owned());
        Some(Err(SourceError {
            message: format!("the reading thread panicked: {reason}; please report this"),
            recoverable: false,
        }))
    }
}

impl FrameSource for ReadAhead {
    fn next_frame(&mut self) -> Option<Item> {
        match self.frames.as_ref()?.recv() {
            Ok((item, samples)) => {
                self.samples.inertial.extend(samples.inertial);
                self.samples.odometry.extend(samples.odometry);
                self.remaining = self.remaining.map(|n| n.saturating_sub(1));
                if matches!(&item, Err(e) if !e.recoverable) {
                    self.finish();
                }
                Some(item)
            }
            Err(_) => self.finish(),
        }
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        std::mem::take(&mut self.samples.inertial)
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        std::mem::take(&mut self.samples.odometry)
    }

    fn remaining(&self) -> Option<usize> {
        self.remaining
    }

    fn is_live(&self) -> bool {
        self.is_live
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        // The receiver first, which wakes a thread blocked in sending; then the thread.
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

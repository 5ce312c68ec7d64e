//! Joins parts of recordings with black frames between them, to simulate a kidnapped camera.
//!
//! All parts come from one camera; the ground truth is joined too. The output is a pure function of the sources.

use crate::disturb::{black_colour, no_depth};
use crate::trajectory::StampedPose;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_imaging::{FrameId, FrameSource, GrayImage, RgbdFrame, SourceError};

/// An invalid request to a stream adaptor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct AdaptorError {
    /// Expectation.
    pub expected: String,
    /// Finding.
    pub found: String,
}

impl AdaptorError {
    pub(crate) fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            expected: expected.into(),
            found: found.into(),
        }
    }
}

/// A part of a splice.
pub enum Part {
    /// Frames of a source.
    Frames(Clip),
    /// This many black frames without depth, of the previous frame's size.
    Black(usize),
}

/// A range of frames of one source, with the ground truth of its recording.
pub struct Clip {
    source: Box<dyn FrameSource>,
    skip: usize,
    take: Option<usize>,
    skipped: usize,
    taken: usize,
    truth: Vec<StampedPose>,
}

impl Clip {
    /// All frames of a source.
    #[must_use]
    pub fn new<S: FrameSource + 'static>(source: S) -> Self {
        Self {
            source: Box::new(source),
            skip: 0,
            take: None,
            skipped: 0,
            taken: 0,
            truth: Vec::new(),
        }
    }

    /// Skips the first `frames` frames, unreadable ones included. They are still read: [`FrameOptions::start`](crate::FrameOptions::start)
    /// is faster, where available.
    #[must_use]
    pub fn skip(self, frames: usize) -> Self {
        Self {
            skip: frames,
            ..self
        }
    }

    /// Plays exactly `frames` frames, unreadable ones included; fewer are an error.
    #[must_use]
    pub fn take(self, frames: usize) -> Self {
        Self {
            take: Some(frames),
            ..self
        }
    }

    /// Poses at the source's own stamps, in time order; those outside of the clip are ignored.
    #[must_use]
    pub fn with_truth(self, truth: Vec<StampedPose>) -> Self {
        Self { truth, ..self }
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        if self.take == Some(self.taken) {
            return None;
        }
        while self.skipped < self.skip {
            match self.source.next_frame() {
                None => return Some(Err(self.short())),
                Some(Err(e)) if !e.recoverable => return Some(Err(e)),
                Some(_) => self.skipped += 1,
            }
        }
        match self.source.next_frame() {
            // A clip of unlimited length must have at least one frame.
            None if self.take.is_some() || self.taken == 0 => Some(Err(self.short())),
            None => None,
            item => {
                self.taken += 1;
                item
            }
        }
    }

    fn short(&self) -> SourceError {
        let needed = self.skip + self.take.unwrap_or(1);
        let found = self.skipped + self.taken;
        fatal(format!(
            "expected at least {needed} frames in the source, found {found}; skip or take fewer"
        ))
    }

    fn remaining(&self) -> Option<usize> {
        match self.take {
            Some(n) => Some(n - self.taken),
            None => {
                let left = self.source.remaining()?;
                Some(left.saturating_sub(self.skip - self.skipped))
            }
        }
    }
}

fn fatal(message: String) -> SourceError {
    SourceError {
        message,
        recoverable: false,
    }
}

/// Origin of a frame of a splice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Part number, from 0, black parts included.
    pub part: usize,
    /// The frame's id in its source.
    pub id: FrameId,
    /// Its stamp in its source, s.
    pub stamp: f64,
}

struct Span {
    part: usize,
    /// Stamps of the first and the last frame in the source, s.
    from: [f64; 2],
    /// Stamp given to the first frame, s.
    to: f64,
}

impl Span {
    fn restamp(&self, stamp: f64) -> f64 {
        self.to + (stamp - self.from[0])
    }
}

/// Plays [`Part`]s in sequence. Ids count from 0 and stamps from 0 s: within a part the steps are those of the source, between parts and
/// within black parts they are the period. An unreadable frame uses up its id. Depth stamps keep their distance from their colour stamps.
///
/// ```no_run
/// # use stillpoint_datasets::{Clip, Dataset, FrameOptions, OpenOptions, Part, Splice};
/// # use stillpoint_imaging::FrameSource;
/// let dataset = Dataset::open("rgbd_dataset_freiburg1_xyz".as_ref(), &OpenOptions::default())?;
/// let truth = dataset.ground_truth()?.unwrap_or_default();
/// let half = |start| {
///     let frames = dataset.frames(&FrameOptions { start, ..FrameOptions::default() })?;
///     Ok::<_, stillpoint_datasets::DatasetError>(Clip::new(frames).take(150).with_truth(truth.clone()))
/// };
/// let parts = vec![Part::Frames(half(150)?), Part::Black(30), Part::Frames(half(0)?)];
/// let mut kidnapped = Splice::new(parts, 1.0 / 30.0)?;
/// while let Some(frame) = kidnapped.next_frame() {
///     println!("{} {:.3} s", frame.as_ref().unwrap().id, frame.as_ref().unwrap().stamp);
/// }
/// let truth = kidnapped.ground_truth();
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Splice {
    parts: VecDeque<Part>,
    number: usize,
    period: f64,
    /// Size of the last frame of a source, and whether it has colour.
    shape: Option<([usize; 2], bool)>,
    last_stamp: Option<f64>,
    origins: Vec<Option<Origin>>,
    spans: Vec<Span>,
    truths: Vec<Vec<StampedPose>>,
    ended: bool,
}

impl Splice {
    /// Joins parts. `period` is the time between frames in black parts and between parts, s.
    ///
    /// # Errors
    /// [`AdaptorError`] unless the first part has frames (black frames take their size from those before them), every clip takes at least
    /// one frame, and the period is positive and finite.
    pub fn new(mut parts: Vec<Part>, period: f64) -> Result<Self, AdaptorError> {
        if !(period > 0.0 && period.is_finite()) {
            return Err(AdaptorError::new(
                "a positive period in seconds",
                format!("{period}"),
            ));
        }
        let found = match parts.first() {
            Some(Part::Frames(_)) => None,
            Some(Part::Black(_)) => Some("black frames, whose size nothing tells"),
            None => Some("no parts"),
        };
        if let Some(found) = found {
            return Err(AdaptorError::new("frames of a source at first", found));
        }
        for (k, part) in parts.iter().enumerate() {
            if matches!(part, Part::Frames(clip) if clip.take == Some(0)) {
                let expected = format!("at least one frame to take in part {k}");
                return Err(AdaptorError::new(expected, "0"));
            }
        }
        let truths = parts.iter_mut().map(|part| match part {
            Part::Frames(clip) => std::mem::take(&mut clip.truth),
            Part::Black(_) => Vec::new(),
        });
        Ok(Self {
            truths: truths.collect(),
            parts: parts.into(),
            number: 0,
            period,
            shape: None,
            last_stamp: None,
            origins: Vec::new(),
            spans: Vec::new(),
            ended: false,
        })
    }

    /// Origin of a frame that was played; `None` for black, unreadable and future frames.
    #[must_use]
    pub fn origin(&self, id: FrameId) -> Option<Origin> {
        *self.origins.get(id.0 as usize)?
    }

    /// The ground truth of the played part, at the splice's stamps in time order: for each clip the poses from just under half a period
    /// before its first frame to as long after its last one. Black frames have none.
    #[must_use]
    pub fn ground_truth(&self) -> Vec<StampedPose> {
        // Less than half, so that adjacent parts cannot overlap by rounding.
        let margin = 0.49 * self.period;
        let mut poses = Vec::new();
        for span in &self.spans {
            let [first, last] = span.from;
            let within = |p: &&StampedPose| p.stamp > first - margin && p.stamp < last + margin;
            poses.extend(
                self.truths[span.part]
                    .iter()
                    .filter(within)
                    .map(|p| StampedPose {
                        stamp: span.restamp(p.stamp),
                        ..*p
                    }),
            );
        }
        poses
    }

    fn next_stamp(&self) -> f64 {
        self.last_stamp.map_or(0.0, |last| last + self.period)
    }

    fn next_id(&self) -> Result<FrameId, SourceError> {
        let id = u32::try_from(self.origins.len()).map_err(|_| {
            fatal(format!(
                "expected at most {} frames, found more; play fewer",
                u32::MAX
            ))
        })?;
        Ok(FrameId(id))
    }

    fn black(&mut self) -> Result<RgbdFrame, SourceError> {
        let Some(([w, h], colour)) = self.shape else {
            return Err(fatal(format!(
                "part {}: expected a readable frame before the black ones, found none; check the first part",
                self.number
            )));
        };
        let (id, stamp) = (self.next_id()?, self.next_stamp());
        self.origins.push(None);
        self.last_stamp = Some(stamp);
        Ok(RgbdFrame {
            id,
            stamp,
            depth_stamp: stamp,
            gray: GrayImage::new(w, h),
            colour: colour.then(|| Arc::new(black_colour(w, h))),
            depth: no_depth(w, h),
        })
    }

    /// Sets the id and stamps of a frame of the current part.
    fn place(&mut self, mut frame: RgbdFrame) -> Result<RgbdFrame, SourceError> {
        let (part, from) = (self.number, frame.stamp);
        let wrong = |expected: String, found: String, advice: &str| {
            let id = frame.id;
            Err(fatal(format!(
                "part {part}, frame {id}: expected {expected}, found {found}; {advice}"
            )))
        };
        let size = [frame.gray.width(), frame.gray.height()];
        if let Some(([w, h], _)) = self.shape.filter(|(s, _)| *s != size) {
            let found = format!("{} x {} px", size[0], size[1]);
            let advice = "join recordings of one camera";
            return wrong(format!("{w} x {h} px as before"), found, advice);
        }
        let last = self.spans.last().filter(|s| s.part == part);
        let (low, shown) = last.map_or((f64::NEG_INFINITY, "a finite stamp".to_owned()), |s| {
            (s.from[1], format!("a stamp after {:.6}", s.from[1]))
        });
        if !(from > low && from.is_finite()) {
            return wrong(shown, format!("{from:.6}"), "repair the recording");
        }
        let id = self.next_id()?;
        if last.is_none() {
            let to = self.next_stamp();
            let from = [from, from];
            self.spans.push(Span { part, from, to });
        }
        self.origins.push(Some(Origin {
            part,
            id: frame.id,
            stamp: from,
        }));
        if let Some(span) = self.spans.last_mut() {
            span.from[1] = from;
            frame.stamp = span.restamp(from);
            frame.depth_stamp = span.restamp(frame.depth_stamp);
        }
        frame.id = id;
        self.last_stamp = Some(frame.stamp);
        self.shape = Some((size, frame.colour.is_some()));
        Ok(frame)
    }
}

impl FrameSource for Splice {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        while !self.ended {
            let item = match self.parts.front_mut()? {
                Part::Black(0) => None,
                Part::Black(left) => {
                    *left -= 1;
                    Some(self.black())
                }
                Part::Frames(clip) => clip.next_frame().map(|item| match item {
                    Ok(frame) => self.place(frame),
                    Err(e) => {
                        self.origins.push(None);
                        Err(SourceError {
                            message: format!("part {}: {}", self.number, e.message),
                            ..e
                        })
                    }
                }),
            };
            if let Some(item) = item {
                self.ended = matches!(&item, Err(e) if !e.recoverable);
                return Some(item);
            }
            self.parts.pop_front();
            self.number += 1;
        }
        None
    }

    fn remaining(&self) -> Option<usize> {
        if self.ended {
            return Some(0);
        }
        self.parts.iter().try_fold(0, |sum, part| {
            Some(
                sum + match part {
                    Part::Frames(clip) => clip.remaining()?,
                    Part::Black(left) => *left,
                },
            )
        })
    }
}

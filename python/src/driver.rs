//! The system behind a `Slam`, in one thread or with threads. Independent of Python.

use crate::events::Queue;
use crate::live::Live;
use std::sync::Arc;
use std::time::Instant;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::{Dense, DenseCounts, DenseMap, FinalPose};
use stillpoint::detection::{Detection, Detector, DetectorInfo};
use stillpoint::imaging::{
    ColourImage, DepthImage, FrameId, GrayImage, ImuSample, OdometrySample, RgbdFrame,
};
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{
    Event, FrameEvent, RefusedFrame, Subscriber, System, Timing, Trajectory, TrajectoryEntry,
};
use stillpoint_cli::front::{self, ResultRecorder};

/// Reason for the lack of a frame's result.
pub(crate) enum Trouble {
    /// It does not follow the previous frame.
    Refused(RefusedFrame),
    /// The run is finished.
    Over,
    /// Frame numbers are exhausted.
    Full,
    /// A thread of the run ended.
    Broken(String),
}

pub(crate) struct Taken {
    pub(crate) stamp: f64,
    pub(crate) depth_stamp: f64,
    pub(crate) gray: GrayImage,
    pub(crate) colour: Option<Arc<ColourImage>>,
    pub(crate) depth: DepthImage,
}

impl Taken {
    pub(crate) fn numbered(self, id: FrameId) -> RgbdFrame {
        RgbdFrame {
            id,
            stamp: self.stamp,
            depth_stamp: self.depth_stamp,
            gray: self.gray,
            colour: self.colour,
            depth: self.depth,
        }
    }
}

pub(crate) struct Known {
    pub(crate) view: Arc<MapView>,
    pub(crate) trajectory: Trajectory,
}

impl Known {
    /// Final poses of the largest submap, as in `trajectory.txt`.
    pub(crate) fn poses(&self) -> Vec<(TrajectoryEntry, StampedPose)> {
        front::final_poses(&self.trajectory, &self.view)
    }
}

pub(crate) enum Driver {
    Inline(Box<Inline>),
    Live(Box<Live>),
}

pub(crate) struct Inline {
    system: System,
    next: Option<u32>,
    /// One queue per listener, as long as the listener exists.
    queues: Vec<Queue>,
    dense: Surface,
    /// Recorder of a requested result folder.
    result: Option<Box<ResultRecorder>>,
    stride: u64,
    /// Accepted frames.
    steps: u64,
    is_over: bool,
}

pub(crate) enum Surface {
    Unwanted,
    Growing(Box<Dense>),
    /// With its statistics.
    Final(Box<(DenseMap, DenseCounts)>),
}

impl Surface {
    /// Fuses all stored frames at their final poses.
    pub(crate) fn finish(&mut self, known: &Known) {
        let this = std::mem::replace(self, Self::Unwanted);
        *self = match this {
            Self::Growing(dense) => {
                let of = |(entry, pose): &(TrajectoryEntry, StampedPose)| FinalPose {
                    frame: entry.frame,
                    stamp: pose.stamp,
                    world_from_camera: pose.world_from_camera,
                };
                let poses: Vec<FinalPose> = known.poses().iter().map(of).collect();
                let counts = dense.counts();
                Self::Final(Box::new((dense.finish(&poses), counts)))
            }
            other => other,
        };
    }

    pub(crate) fn map(&self) -> Option<DenseMap> {
        match self {
            Self::Unwanted => None,
            Self::Growing(dense) => Some(dense.map().clone()),
            Self::Final(map) => Some(map.0.clone()),
        }
    }

    /// The final surface with its statistics.
    pub(crate) fn counted(&self) -> Option<(DenseMap, DenseCounts)> {
        match self {
            Self::Final(map) => Some((**map).clone()),
            _ => None,
        }
    }
}

impl Inline {
    pub(crate) fn new(system: System, stride: u32, dense: Option<Dense>) -> Self {
        Self {
            system,
            next: Some(0),
            queues: Vec::new(),
            dense: dense.map_or(Surface::Unwanted, |d| Surface::Growing(Box::new(d))),
            result: None,
            stride: u64::from(stride),
            steps: 0,
            is_over: false,
        }
    }

    fn track(
        &mut self,
        taken: Taken,
        seen: Option<Vec<Detection>>,
    ) -> Result<Arc<FrameEvent>, Trouble> {
        if self.is_over {
            return Err(Trouble::Over);
        }
        let id = self.next.ok_or(Trouble::Full)?;
        let events = self.system.step_with(taken.numbered(FrameId(id)), seen);
        self.tell(&events);
        let mut answer = None;
        for event in events {
            match event {
                Event::Frame(frame) => answer = Some(frame),
                // Its number is reused, because it was not processed.
                Event::Refused(refused) => return Err(Trouble::Refused(refused)),
                _ => {}
            }
        }
        self.next = id.checked_add(1);
        self.steps += 1;
        answer.ok_or_else(|| Trouble::Broken("no answer to a frame".to_owned()))
    }

    fn tell(&mut self, events: &[Event]) {
        if let Surface::Growing(dense) = &mut self.dense {
            dense.receive_all(events);
        }
        if let Some(result) = &mut self.result {
            result.receive_all(events);
        }
        self.queues.retain(Queue::is_wanted);
        for queue in &self.queues {
            for event in events {
                queue.put(event);
            }
        }
    }

    fn known(&self) -> Known {
        Known {
            view: self.system.view(),
            trajectory: self.system.trajectory().clone(),
        }
    }

    fn finish(&mut self) {
        if self.is_over {
            return;
        }
        self.is_over = true;
        let events = self.system.finish();
        self.tell(&events);
        for queue in self.queues.drain(..) {
            queue.close();
        }
        let known = self.known();
        self.dense.finish(&known);
    }
}

impl Driver {
    /// Tracks a frame and returns its result.
    pub(crate) fn track(
        &mut self,
        taken: Taken,
        seen: Option<Vec<Detection>>,
    ) -> Result<Arc<FrameEvent>, Trouble> {
        let began = Instant::now();
        let tracked = match self {
            Self::Inline(inline) => inline.track(taken, seen),
            Self::Live(live) => live.track(taken, seen),
        }?;
        let milliseconds = 1e3 * began.elapsed().as_secs_f64();
        match self {
            Self::Inline(inline) => {
                if let Some(result) = &mut inline.result {
                    result.end_frame(milliseconds);
                }
            }
            Self::Live(live) => live.end_frame(milliseconds),
        }
        Ok(tracked)
    }

    /// Adds IMU samples up to the next frame.
    pub(crate) fn receive_inertial(&mut self, samples: Vec<ImuSample>) {
        match self {
            Self::Inline(inline) if !inline.is_over => inline.system.receive_inertial(samples),
            Self::Inline(_) => {}
            Self::Live(live) => live.receive_inertial(samples),
        }
    }

    /// Adds wheel odometry up to the next frame.
    pub(crate) fn receive_odometry(&mut self, samples: Vec<OdometrySample>) {
        match self {
            Self::Inline(inline) if !inline.is_over => inline.system.receive_odometry(samples),
            Self::Inline(_) => {}
            Self::Live(live) => live.receive_odometry(samples),
        }
    }

    /// Starts recording for a result folder.
    pub(crate) fn keep_result(&mut self, recorder: ResultRecorder) -> std::io::Result<()> {
        match self {
            Self::Inline(inline) => {
                inline.result = Some(Box::new(recorder));
                Ok(())
            }
            Self::Live(live) => live.keep_result(recorder),
        }
    }

    /// Accesses the recorder of a result folder, if requested.
    pub(crate) fn with_result<R>(&self, look: impl FnOnce(&ResultRecorder) -> R) -> Option<R> {
        match self {
            Self::Inline(inline) => inline.result.as_deref().map(look),
            Self::Live(live) => live.with_result(look),
        }
    }

    /// The detector running in this thread.
    pub(crate) fn detector(&self) -> Option<DetectorInfo> {
        match self {
            Self::Inline(inline) => inline.system.detector().map(Detector::info),
            Self::Live(_) => None,
        }
    }

    /// The final surface of a finished run, with its statistics.
    pub(crate) fn counted_surface(&self) -> Option<(DenseMap, DenseCounts)> {
        match self {
            Self::Inline(inline) => inline.dense.counted(),
            Self::Live(live) => live.counted_surface(),
        }
    }

    /// Whether the caller has to run the user's detector on the next frame; never in a live run.
    pub(crate) fn asks(&self) -> bool {
        match self {
            Self::Inline(inline) => inline.steps.is_multiple_of(inline.stride),
            Self::Live(_) => false,
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        match self {
            Self::Inline(inline) => inline.is_over,
            Self::Live(live) => live.is_over(),
        }
    }

    pub(crate) fn known(&self) -> Known {
        match self {
            Self::Inline(inline) => inline.known(),
            Self::Live(live) => live.known(),
        }
    }

    /// Accesses the current map for saving, with the estimated timing of the camera.
    pub(crate) fn with_map<R>(&self, look: impl FnOnce(&Map, Option<&Timing>) -> R) -> Option<R> {
        match self {
            Self::Inline(inline) => Some(look(inline.system.map(), Some(&inline.system.timing()))),
            Self::Live(live) => live.with_map(look),
        }
    }

    /// The current surface, if requested.
    pub(crate) fn surface(&self) -> Option<DenseMap> {
        match self {
            Self::Inline(inline) => inline.dense.map(),
            Self::Live(live) => live.surface(),
        }
    }

    /// Adds a listener with a queue of at most `room` events.
    pub(crate) fn listen(&mut self, room: usize) -> crate::events::Source {
        match self {
            Self::Inline(inline) => {
                let queue = Queue::new(room);
                if inline.is_over {
                    queue.close();
                } else {
                    inline.queues.push(queue.clone());
                }
                crate::events::Source::Queue(queue)
            }
            Self::Live(live) => live.listen(room),
        }
    }

    /// Ends the stream; idempotent.
    pub(crate) fn finish(&mut self) {
        match self {
            Self::Inline(inline) => inline.finish(),
            Self::Live(live) => live.finish(),
        }
    }
}

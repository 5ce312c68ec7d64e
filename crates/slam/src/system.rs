//! The inline driver: every stage in one thread, every reply after a fixed number of frames.

use crate::config::{Config, ConfigError};
use crate::event::Event;
use crate::mapping::Mapper;
use crate::messages::{MapperMsg, MapperOut, Tracked};
use crate::sensor::Timing;
use crate::tracking::Tracker;
use crate::trajectory::Trajectory;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Camera;
use stillpoint_imaging::{RgbdFrame, Simd};
use stillpoint_map::MapView;

/// RGB-D SLAM, driven frame by frame. The same frames, configuration and seed give the same result, bit for bit.
pub struct System {
    tracker: Tracker,
    mapper: Mapper,
    /// Replies of the mapper that are not due yet, with the number of the step at which they are.
    replies: VecDeque<(u64, MapperOut)>,
    mapper_delay: u64,
    step: u64,
}

impl System {
    /// A system for one camera.
    ///
    /// # Errors
    /// [`ConfigError`] when a field is out of range.
    pub fn new(config: Config, camera: Camera, simd: Simd) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self {
            mapper_delay: u64::from(config.schedule.mapper),
            mapper: Mapper::new(&config),
            tracker: Tracker::new(config, camera, simd),
            replies: VecDeque::new(),
            step: 0,
        })
    }

    /// Takes the next frame and says what happened, the frame's own report first.
    pub fn step(&mut self, frame: RgbdFrame) -> Vec<Event> {
        self.deliver(self.step);
        let Tracked { report, keyframe } = self.tracker.track(&Arc::new(frame));
        let mut events = vec![Event::Frame(report)];
        if let Some(keyframe) = keyframe {
            let out = self.mapper.step(MapperMsg::Keyframe(Box::new(keyframe)));
            events.push(Event::Mapped(out.report.clone()));
            self.replies
                .push_back((self.step + 1 + self.mapper_delay, out));
        }
        self.step += 1;
        events
    }

    /// Ends the stream: delivers every reply that is still outstanding.
    pub fn finish(&mut self) -> Vec<Event> {
        self.deliver(u64::MAX);
        Vec::new()
    }

    fn deliver(&mut self, now: u64) {
        while self.replies.front().is_some_and(|(due, _)| *due <= now) {
            if let Some((_, out)) = self.replies.pop_front() {
                self.tracker.receive(out.view);
            }
        }
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.tracker.trajectory()
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.tracker.timing()
    }

    /// The newest version of the map, whether the tracker has seen it yet or not.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.replies
            .back()
            .map_or_else(|| self.tracker.view(), |(_, out)| Arc::clone(&out.view))
    }
}

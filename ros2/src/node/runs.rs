//! Start and end of runs.

use super::entries::constant;
use super::{Node, nanoseconds};
use crate::camera::NotReady;
use crate::mounting;
use crate::options::Options;
use crate::record::Entry;
use crate::run::{Plan, Run};
use crate::value::Value;
use std::time::Instant;
use stillpoint::recordings::{ImageMessage, camera_info_topic};
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Message, Version};

impl Node {
    /// Does nothing while messages are missing.
    pub(super) fn begin_run(
        &mut self,
        colour: &ImageMessage<'_>,
        depth: &ImageMessage<'_>,
    ) -> Result<(), String> {
        if self.refused.is_some() {
            return Ok(());
        }
        self.options = Options::new(&self.parameters)?;
        let ready = match self.camera.ready(colour, depth, &self.options) {
            Ok(ready) => ready,
            Err(NotReady::Waiting(what)) => {
                self.not_ready = Some(what);
                return Ok(());
            }
            Err(NotReady::Refused(why)) => {
                self.not_ready = Some("images that can be worked with".to_owned());
                return Err(why);
            }
        };
        self.not_ready = None;
        let incoming = &ready.incoming;
        for guess in incoming.guesses() {
            self.voice.info(guess);
        }
        for warning in incoming.warnings() {
            self.voice.warn(warning);
        }
        if let Some(missing) = &ready.without_imu {
            self.voice
                .warn(&format!("the inertial sensor is not used: {missing}"));
        }
        if let Some(missing) = &ready.without_wheels {
            self.voice.warn(&format!("odometry is not used: {missing}"));
        }
        self.number += 1;
        let topics = self.intake.topics();
        let plan = Plan {
            ready,
            options: &self.options,
            config: self.parameters.config(),
            known: self.known.take(),
            publisher: self.publisher.take(),
            outputs: &self.outputs,
            topics: [&topics.colour, &topics.depth],
            imu_topic: self.intake.inertial_topic(),
            odometry_topic: self.intake.odometry_topic(),
            number: self.number,
        };
        match Run::begin(plan) {
            Ok(run) => {
                self.voice.info(&format!("run {} begins", self.number));
                self.record_constants(&run, nanoseconds(colour.header().stamp));
                self.run = Some(run);
                self.begun = Instant::now();
                Ok(())
            }
            Err(why) => {
                self.voice.error(&why);
                self.voice
                    .error("no run begins until that is put right and reset is called");
                self.refused = Some(why);
                Ok(())
            }
        }
    }

    /// Records messages received before the recording, and facts that a replay needs.
    fn record_constants(&self, run: &Run, time: u64) {
        for (image_topic, bytes) in self.camera.infos() {
            run.record(|| Entry {
                topic: camera_info_topic(image_topic),
                type_name: ros::CameraInfo::NAME,
                definition: || ros::definition::<ros::CameraInfo<'_>>(Version::Ros2),
                time,
                latched: false,
                bytes: bytes.to_vec(),
            });
        }
        for bytes in self.camera.constants() {
            run.record(|| Entry {
                time,
                ..constant(bytes.clone())
            });
        }
    }

    pub(super) fn decide_mounting(&mut self) {
        let Some(run) = self.run.as_ref().filter(|r| r.decided().get().is_none()) else {
            return;
        };
        let has_publishers = self.intake.publishers()[2] > 0;
        let optical = &run.ready().optical;
        let waited = self.begun.elapsed();
        let found = mounting::decide(&self.camera, optical, &self.options, has_publishers, waited);
        if let Some((mounting, remark)) = found {
            match remark {
                Some(remark) => self.voice.warn(&remark),
                None => self
                    .voice
                    .info(&format!("poses are of {}", mounting.names.body)),
            }
            // Cannot fail: it is set only here.
            let _ = run.decided().set(mounting);
        }
    }

    /// Ends a run; the next starts with the next pair of images. `goes_on`: whether `odom` continues.
    pub(super) fn end_run(&mut self, goes_on: bool) -> Vec<String> {
        self.refused = None;
        self.publisher = None;
        let Some(run) = self.run.take() else {
            return Vec::new();
        };
        let ended = run.end();
        let latency = ended.latency.map(|l| l.map(|s| 1e3 * s));
        let latency = latency.map_or_else(String::new, |[median, most]| {
            format!(
                "; from an image's last packet to its odometry {median:.1} ms, 95 % within {most:.1} ms"
            )
        });
        self.voice.info(&format!(
            "run {} ended: {} frames, {} dropped, {} with a pose{latency}",
            self.number, ended.frames[0], ended.frames[1], ended.tracked
        ));
        ended.troubles.iter().for_each(|t| self.voice.error(t));
        if goes_on {
            self.publisher = ended.publisher.map(|mut p| {
                p.begin_other_map();
                p
            });
        }
        let max_dt = self.parameters.get("max_dt").and_then(Value::double);
        self.intake.begin_run(max_dt.unwrap_or(self.options.max_dt));
        self.pending.clear();
        ended.troubles
    }
}

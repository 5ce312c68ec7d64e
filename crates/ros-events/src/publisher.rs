//! Events in, messages out.

use crate::mount::Mount;
use crate::odom::{Located, Odom};
use crate::parts::{
    camera_info, nanoseconds, pose, quaternion, quaternion_and_point, rows, time_of, vector,
};
use crate::topic::{Outgoing, Topic};
use crate::{axes, cloud, diagnostics, objects};
use std::sync::Arc;
use stillpoint_geometry::{Camera, Mat6, Se3, Vec3};
use stillpoint_map::{MapView, SubmapId};
use stillpoint_ros_messages as ros;
use stillpoint_slam::{Event, FrameEvent, Health, LoopOutcome, Outcome};

/// Minimum time between two publications of path and map, s.
const EVERY: f64 = 1.0;
/// Minimum time between two publications of path and map, as a fraction of the time since the first frame. All maps of a long run together
/// then take no more than some twenty times the size of the last one.
const EVERY_SHARE: f64 = 0.05;
/// Variance of unmeasured components, m^2 or rad^2.
const OPEN: f64 = 1e6;

/// Names of the frames of reference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameNames {
    /// The first submap; later ones have `_` and their number appended.
    pub map: String,
    /// The frame that never jumps.
    pub odom: String,
    /// The base, x forward and z up: the camera's body, unless a [`Mount`] places the camera on another one.
    pub body: String,
    /// The camera, z forward.
    pub optical: String,
}

impl Default for FrameNames {
    fn default() -> Self {
        Self {
            map: "map".to_owned(),
            odom: "odom".to_owned(),
            body: "camera_link".to_owned(),
            optical: "camera_color_optical_frame".to_owned(),
        }
    }
}

/// Converts the events of a run to messages. It must receive every event, in order.
#[derive(Clone, Debug)]
pub struct Publisher {
    names: FrameNames,
    mount: Mount,
    /// Whether the constant transform from body to optical frame is published here.
    has_constant: bool,
    camera: Camera,
    odom: Odom,
    first: Option<SubmapId>,
    here: Option<SubmapId>,
    /// Stamps of the first and of the last frame, s.
    span: Option<(f64, f64)>,
    shown: Option<f64>,
    /// The newest map, until it is published.
    unshown: Option<Arc<MapView>>,
    /// Of the previous frame, if it had a pose.
    last_health: Option<Health>,
}

impl Publisher {
    /// Before the first frame of a camera.
    #[must_use]
    pub fn new(camera: Camera, names: FrameNames) -> Self {
        Self {
            names,
            mount: Mount::default(),
            has_constant: true,
            camera,
            odom: Odom::default(),
            first: None,
            here: None,
            span: None,
            shown: None,
            unshown: None,
            last_health: None,
        }
    }

    /// Sets the names of frames.
    #[must_use]
    pub fn with_names(mut self, names: FrameNames) -> Self {
        self.names = names;
        self
    }

    /// For a camera mounted on a base; the transform between them is published elsewhere.
    #[must_use]
    pub fn with_mount(mut self, mount: Mount) -> Self {
        self.mount = mount;
        self.has_constant = false;
        self
    }

    /// Another map replaces the current one: `odom` continues, and the next submap is published as the map.
    pub fn begin_other_map(&mut self) {
        self.odom.begin_other_map();
        self.first = None;
        self.here = None;
        self.shown = None;
        self.unshown = None;
    }

    /// The messages for an event.
    pub fn publish(&mut self, event: &Event) -> Vec<Outgoing> {
        let mut out = Vec::new();
        let located = self.odom.take(event);
        match event {
            Event::Frame(frame) => self.frame(frame, located.as_ref(), &mut out),
            Event::Looped(report) if report.outcome == LoopOutcome::Closed => {
                if let Some(join) = &report.joined {
                    let (parent, child) = (self.map_name(join.into), self.map_name(join.submap));
                    let transform = self.transform(&parent, &child, &join.shift);
                    out.push(self.tf(Topic::TfStatic, vec![transform]));
                }
            }
            _ => {}
        }
        if let Some(view) = event.view() {
            self.unshown = Some(Arc::clone(view));
            let corrected = matches!(event, Event::Corrected { .. } | Event::Revoked { .. });
            if corrected || self.is_due() {
                self.map(&mut out);
            }
        }
        out
    }

    /// The final messages of a run: the map in its last state.
    pub fn finish(&mut self) -> Vec<Outgoing> {
        let mut out = Vec::new();
        self.map(&mut out);
        out
    }

    /// A picture of the newest frame, as JPEG of the size of the camera's images, with the camera's calibration.
    #[must_use]
    pub fn picture(&self, jpeg: Vec<u8>) -> [Outgoing; 2] {
        let header = self.header(&self.names.optical);
        let image = ros::CompressedImage {
            header: header.clone(),
            format: "jpeg".into(),
            data: jpeg.into(),
        };
        let info = camera_info(&self.camera, header);
        let time = self.time();
        [
            Outgoing::new(Topic::CameraInfo, time, &info),
            Outgoing::new(Topic::Image, time, &image),
        ]
    }

    /// The moving regions of the newest frame: an image of the camera's size, 255 where the scene moves.
    #[must_use]
    pub fn mask(&self, width: u32, height: u32, pixels: &[u8]) -> Outgoing {
        let image = ros::Image {
            header: self.header(&self.names.optical),
            height,
            width,
            encoding: "mono8".into(),
            is_bigendian: 0,
            step: width,
            data: pixels.into(),
        };
        Outgoing::new(Topic::Mask, self.time(), &image)
    }

    /// Coloured points of a surface in the world of the first submap, m.
    #[must_use]
    pub fn surface(&self, points: &[([f32; 3], [u8; 3])]) -> Outgoing {
        let cloud = cloud::surface(points, &self.mount, self.header(&self.names.map));
        Outgoing::new(Topic::Surface, self.time(), &cloud)
    }

    /// Sets the time, s, for callers that receive only frames and publish pictures, surfaces and plans.
    pub fn at(&mut self, stamp: f64) {
        self.span = Some((self.span.map_or(stamp, |(first, _)| first), stamp));
    }

    /// Transforms points of the world of the first submap to the map frame.
    #[must_use]
    pub fn map_from_world(&self) -> Se3 {
        let ros_from_world = Se3::new(axes::body_from_optical(), Vec3::zeros());
        self.mount.place(&ros_from_world)
    }

    /// A floor plan of `width` columns, row by row, in percent and -1 for unknown. Its axes are those of the map, its first cell's outer
    /// corner is at `origin` there, and cells have a side of `resolution`; m.
    #[must_use]
    pub fn grid(&self, width: u32, resolution: f64, origin: &Vec3, cells: Vec<i8>) -> Outgoing {
        let height = (cells.len() as u32).checked_div(width).unwrap_or(0);
        let grid = ros::OccupancyGrid {
            header: self.header(&self.names.map),
            info: ros::MapMetaData {
                map_load_time: time_of(self.span.map_or(0.0, |(_, now)| now)),
                resolution: resolution as f32,
                width,
                height,
                origin: pose(&quaternion_and_point(&Se3::new(
                    stillpoint_geometry::nalgebra::UnitQuaternion::identity(),
                    *origin,
                ))),
            },
            data: cells,
        };
        Outgoing::new(Topic::Grid, self.time(), &grid)
    }

    fn frame(&mut self, frame: &FrameEvent, located: Option<&Located>, out: &mut Vec<Outgoing>) {
        let stamp = frame.report.stamp;
        let is_first = self.span.is_none();
        self.span = Some((self.span.map_or(stamp, |(first, _)| first), stamp));
        if is_first && self.has_constant {
            let constant = ros::Transform {
                translation: ros::Vector3::default(),
                rotation: quaternion(&axes::body_from_optical()),
            };
            let constant = self.stamped(&self.names.body, &self.names.optical, constant);
            out.push(self.tf(Topic::TfStatic, vec![constant]));
        }
        if let Some(located) = located {
            self.first.get_or_insert(located.submap);
            self.here = Some(located.submap);
            let map = self.map_name(located.submap);
            let transforms = vec![
                self.transform(&map, &self.names.odom, &located.world_from_odom),
                self.transform(
                    &self.names.odom,
                    &self.names.body,
                    &located.odom_from_camera,
                ),
            ];
            out.push(self.tf(Topic::Tf, transforms));
            out.push(self.odometry(frame, located));
            let (boxes, markers) = objects::messages(
                &frame.report,
                &located.world_from_camera,
                &self.mount,
                &self.header(&map),
            );
            out.push(Outgoing::new(Topic::Objects, self.time(), &boxes));
            out.push(Outgoing::new(Topic::Markers, self.time(), &markers));
        } else {
            self.last_health = None;
        }
        let diagnostics = diagnostics::message(frame, self.header(""));
        out.push(Outgoing::new(Topic::Diagnostics, self.time(), &diagnostics));
    }

    fn odometry(&mut self, frame: &FrameEvent, located: &Located) -> Outgoing {
        let covariance = match (frame.health.covariance, frame.report.outcome) {
            (Some(covariance), _) => covariance,
            // Exact, by definition.
            (None, Outcome::Initialised) => Mat6::zeros(),
            (None, _) => Mat6::identity() * OPEN,
        };
        let turn = located.odom_from_camera.rotation_matrix();
        let of_pose = axes::turned(&covariance, &turn);
        let velocity = located.velocity.unwrap_or_default();
        let since = located.since.filter(|dt| *dt > 0.0);
        let of_velocity = self
            .last_health
            .as_ref()
            .zip(since)
            .and_then(|(before, dt)| {
                let motion = Se3::exp(&(velocity * dt));
                Some(frame.health.covariance_since(before, &motion)? / (dt * dt))
            });
        let of_velocity = of_velocity.unwrap_or_else(|| Mat6::identity() * OPEN);
        self.last_health = Some(frame.health.clone());
        let twist = self.mount.velocity(&velocity);
        let [linear, angular] = twist.map(|part| vector(&part));
        let base = self.mount.base(&located.odom_from_camera);
        let of_pose = self.mount.covariance(&of_pose, &base);
        let of_velocity = self.mount.velocity_covariance(&of_velocity);
        let message = ros::Odometry {
            header: self.header(&self.names.odom),
            child_frame_id: self.names.body.as_str().into(),
            pose: ros::PoseWithCovariance {
                pose: pose(&quaternion_and_point(&base)),
                covariance: rows(&of_pose),
            },
            twist: ros::TwistWithCovariance {
                twist: ros::Twist { linear, angular },
                covariance: rows(&of_velocity),
            },
        };
        Outgoing::new(Topic::Odometry, self.time(), &message)
    }

    fn is_due(&self) -> bool {
        let Some((first, now)) = self.span else {
            return false;
        };
        let every = EVERY.max(EVERY_SHARE * (now - first));
        self.shown.is_none_or(|then| now - then >= every)
    }

    /// Path and map of the camera's submap.
    fn map(&mut self, out: &mut Vec<Outgoing>) {
        let (Some(submap), Some((_, now))) = (self.here, self.span) else {
            return;
        };
        let Some(view) = self.unshown.take() else {
            return;
        };
        self.shown = Some(now);
        // The submap may have been joined to another.
        let newest = view.keyframes().filter(|k| k.submap == submap).count();
        let submap = if newest > 0 {
            submap
        } else {
            view.submap_of(stillpoint_map::KeyframeId(submap.0))
                .unwrap_or(submap)
        };
        let name = self.map_name(submap);
        let header = self.header(&name);
        let path = cloud::path(&view, submap, &self.mount, &header, time_of);
        out.push(Outgoing::new(Topic::Path, self.time(), &path));
        let points = cloud::landmarks(&view, submap, &self.mount, header);
        out.push(Outgoing::new(Topic::Map, self.time(), &points));
    }

    fn map_name(&self, submap: SubmapId) -> String {
        if self.first.is_none_or(|first| first == submap) {
            return self.names.map.clone();
        }
        format!("{}_{submap}", self.names.map)
    }

    fn time(&self) -> u64 {
        self.span.map_or(0, |(_, now)| nanoseconds(now))
    }

    fn header<'a>(&self, frame: &'a str) -> ros::Header<'a> {
        ros::Header {
            seq: 0,
            stamp: time_of(self.span.map_or(0.0, |(_, now)| now)),
            frame_id: frame.into(),
        }
    }

    fn transform<'a>(
        &self,
        parent: &'a str,
        child: &'a str,
        parent_from_child: &Se3,
    ) -> ros::TransformStamped<'a> {
        let (rotation, p) = quaternion_and_point(&self.mount.base(parent_from_child));
        let translation = ros::Vector3 {
            x: p.x,
            y: p.y,
            z: p.z,
        };
        self.stamped(
            parent,
            child,
            ros::Transform {
                translation,
                rotation,
            },
        )
    }

    fn stamped<'a>(
        &self,
        parent: &'a str,
        child: &'a str,
        transform: ros::Transform,
    ) -> ros::TransformStamped<'a> {
        ros::TransformStamped {
            header: self.header(parent),
            child_frame_id: child.into(),
            transform,
        }
    }

    fn tf(&self, topic: Topic, transforms: Vec<ros::TransformStamped<'_>>) -> Outgoing {
        Outgoing::new(topic, self.time(), &ros::TfMessage { transforms })
    }
}

//! Input: pairs of images, camera infos, constant transforms, odometry.

use crate::bus::{Bus, BusError, Quality, Reader};
use crate::camera::{CameraState, CameraTopics};
use crate::inertial::{IMU, Measured};
use crate::names::{NodeName, Remap, resolve};
use crate::odometry::{ODOMETRY, Rolled};
use crate::options::Options;
use crate::pairing::{Pair, Pairing, Stream, Taken};
use crate::waiting::{Seen, StreamState};
use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use stillpoint::recordings::{ImageMessage, camera_info_topic, stamp_seconds};
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::Message;

/// Topic of colour images, before remapping.
pub const COLOUR: &str = "camera/color/image_raw";
/// Topic of depth registered to the colour camera, as named by RealSense drivers.
pub const DEPTH: &str = "camera/aligned_depth_to_color/image_raw";

/// Number of images per stream with known arrival times: more than may wait for a calibration.
const WHOLE: usize = 32;

/// Readers of all topics.
pub struct Intake {
    colour: Reader,
    depth: Reader,
    colour_info: Reader,
    depth_info: Reader,
    tf_static: Reader,
    odometry: Option<(String, Reader)>,
    inertial: Option<(String, Reader)>,
    topics: CameraTopics,
    pairing: Pairing<Vec<u8>>,
    /// States of both image streams.
    pub seen: [StreamState; 2],
    reliable: bool,
    /// Arrival times of the newest images of both streams, by their stamps.
    whole: [VecDeque<(f64, Instant)>; 2],
}

/// New messages other than images.
#[derive(Default)]
pub struct News {
    /// Whether the calibration changed.
    pub other_camera: bool,
    /// Messages of `/tf_static`.
    pub transforms: Vec<Vec<u8>>,
    /// Messages of odometry, parsed and raw.
    pub odometry: Vec<(Rolled, Vec<u8>)>,
    /// Messages of the inertial sensor, parsed and raw.
    pub inertial: Vec<(Measured, Vec<u8>)>,
    /// Errors of unreadable messages.
    pub broken: Vec<String>,
}

/// Names of the topics of images and camera infos.
#[must_use]
pub fn topics(options: &Options, node: &NodeName, remaps: &[Remap]) -> CameraTopics {
    let base = [COLOUR, DEPTH].map(|name| resolve(name, node, remaps));
    // Camera infos can be remapped separately.
    let info = |default: &str, image: &str| {
        let renamed = resolve(default, node, remaps);
        let unchanged = resolve(default, node, &[]);
        if renamed == unchanged {
            camera_info_topic(image)
        } else {
            renamed
        }
    };
    let with = |base: &str, transport: &str| {
        if transport == "raw" || base.ends_with(&format!("/{transport}")) {
            base.to_owned()
        } else {
            format!("{base}/{transport}")
        }
    };
    let colour = with(&base[0], &options.color_transport);
    let depth = with(&base[1], &options.depth_transport);
    let compressed =
        |topic: &str| topic.ends_with("/compressed") || topic.ends_with("/compressedDepth");
    CameraTopics {
        colour_info: info("camera/color/camera_info", &base[0]),
        depth_info: info("camera/aligned_depth_to_color/camera_info", &base[1]),
        colour_compressed: compressed(&colour),
        depth_compressed: compressed(&depth),
        colour,
        depth,
    }
}

impl Intake {
    /// Creates the readers.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn subscribe(
        bus: &mut Bus,
        topics: &CameraTopics,
        options: &Options,
        remaps: &[Remap],
    ) -> Result<Self, BusError> {
        let node = bus.node().clone();
        let images = Quality {
            reliable: options.reliable,
            ..Quality::SENSOR
        };
        let image = |compressed| {
            if compressed {
                ros::CompressedImage::NAME
            } else {
                ros::Image::NAME
            }
        };
        let constant = Quality {
            depth: 100,
            ..Quality::LATCHED
        };
        let odometry = options.subscribe_odometry.then(|| {
            let name = resolve(ODOMETRY, &node, remaps);
            let reader = bus.subscribe(&name, ros::Odometry::NAME, Quality::INERTIAL)?;
            Ok::<_, BusError>((name, reader))
        });
        let odometry = odometry.transpose()?;
        let inertial = options.subscribe_imu.then(|| {
            let name = resolve(IMU, &node, remaps);
            let reader = bus.subscribe(&name, ros::Imu::NAME, Quality::INERTIAL)?;
            Ok::<_, BusError>((name, reader))
        });
        let inertial = inertial.transpose()?;
        let info = ros::CameraInfo::NAME;
        Ok(Self {
            colour: bus.subscribe(&topics.colour, image(topics.colour_compressed), images)?,
            depth: bus.subscribe(&topics.depth, image(topics.depth_compressed), images)?,
            colour_info: bus.subscribe(&topics.colour_info, info, Quality::SENSOR)?,
            depth_info: bus.subscribe(&topics.depth_info, info, Quality::SENSOR)?,
            tf_static: bus.subscribe(
                &resolve("/tf_static", &node, remaps),
                ros::TfMessage::NAME,
                constant,
            )?,
            odometry,
            inertial,
            topics: topics.clone(),
            pairing: Pairing::new(options.max_dt),
            seen: [StreamState::default(), StreamState::default()],
            reliable: options.reliable,
            whole: Default::default(),
        })
    }

    /// Names of the camera's topics.
    #[must_use]
    pub fn topics(&self) -> &CameraTopics {
        &self.topics
    }

    /// Name of the inertial sensor's topic, if used.
    #[must_use]
    pub fn inertial_topic(&self) -> Option<&str> {
        self.inertial.as_ref().map(|(name, _)| name.as_str())
    }

    /// Name of the odometry's topic, if used.
    #[must_use]
    pub fn odometry_topic(&self) -> Option<&str> {
        self.odometry.as_ref().map(|(name, _)| name.as_str())
    }

    /// Numbers of publishers of colour, depth and constant transforms.
    #[must_use]
    pub fn publishers(&self) -> [usize; 3] {
        [&self.colour, &self.depth, &self.tf_static].map(Reader::publishers)
    }

    /// Whether publishers of colour or depth offer incompatible quality of service.
    pub fn misfits(&self, bus: &mut Bus) -> [bool; 2] {
        [bus.take_misfit(&self.colour), bus.take_misfit(&self.depth)]
    }

    /// Numbers of colour and depth images without a partner.
    #[must_use]
    pub fn alone(&self) -> [u64; 2] {
        self.pairing.alone()
    }

    /// Restarts pairing with a maximum time difference, s.
    pub fn begin_run(&mut self, max_dt: f64) {
        self.pairing = Pairing::new(max_dt);
    }

    /// Receives all messages other than images.
    pub fn take_news(&mut self, camera: &mut CameraState) -> News {
        let mut news = News::default();
        for (is_depth, reader) in [(false, &self.colour_info), (true, &self.depth_info)] {
            // Only the newest info counts, since they repeat with every image.
            let mut newest = None;
            while let Some(message) = reader.take() {
                newest = Some(message.bytes);
            }
            if newest.is_some() {
                self.seen[usize::from(is_depth)].info = Some(Instant::now());
            }
            match newest.map(|bytes| camera.take_info(is_depth, bytes)) {
                Some(Ok(differs)) => news.other_camera |= differs,
                Some(Err(e)) => news.broken.push(e),
                None => {}
            }
        }
        while let Some(message) = self.tf_static.take() {
            match camera.take_transforms(&message.bytes) {
                Ok(()) => news.transforms.push(message.bytes),
                Err(e) => news.broken.push(e),
            }
        }
        if let Some((_, reader)) = &self.odometry {
            while let Some(message) = reader.take() {
                match Rolled::read(&message.bytes) {
                    Ok(rolled) => {
                        camera.note_odometry(&rolled.frames);
                        news.odometry.push((rolled, message.bytes));
                    }
                    Err(e) => news.broken.push(e),
                }
            }
        }
        if let Some((_, reader)) = &self.inertial {
            while let Some(message) = reader.take() {
                match Measured::read(&message.bytes) {
                    Ok(measured) => {
                        camera.note_inertial(&measured.frame);
                        news.inertial.push((measured, message.bytes));
                    }
                    Err(e) => news.broken.push(e),
                }
            }
        }
        news
    }

    /// Receives images; appends errors to `told`.
    pub fn take_images(&mut self, told: &mut Vec<String>) {
        let readers = [
            (Stream::Colour, &self.colour, self.topics.colour_compressed),
            (Stream::Depth, &self.depth, self.topics.depth_compressed),
        ];
        for (stream, reader, compressed) in readers {
            let seen = &mut self.seen[stream as usize];
            while let Some(message) = reader.take() {
                seen.come(Instant::now(), message.number());
                match stamp_of(&message.bytes, compressed) {
                    Ok(stamp) => {
                        seen.stamp = Some(stamp);
                        note(&mut self.whole[stream as usize], stamp, message.age());
                        if self.pairing.take(stream, stamp, message.bytes) == Taken::SetBack {
                            told.push(format!(
                                "stamps of images went back to {stamp:.3} s: the clock was set back, and frames follow its new time"
                            ));
                        }
                    }
                    Err(e) => told.push(format!("{}: {e}", name(stream))),
                }
            }
        }
    }

    /// The next pair of images.
    pub fn next_pair(&mut self) -> Option<Pair<Vec<u8>>> {
        self.pairing.next_pair()
    }

    /// Time since the arrival of both images of a pair.
    #[must_use]
    pub fn age(&self, pair: &Pair<Vec<u8>>) -> Duration {
        let of = |stream: usize, stamp: f64| {
            let found = self.whole[stream].iter().find(|(s, _)| *s == stamp);
            found.map_or(Duration::ZERO, |(_, at)| at.elapsed())
        };
        of(0, pair.colour.0).min(of(1, pair.depth.0))
    }

    /// The state of both streams for [`crate::waiting`]. `losses` describes losses on the wire.
    #[must_use]
    pub fn state<'a>(&'a self, losses: Option<&'a str>) -> Seen<'a> {
        Seen {
            topics: &self.topics,
            streams: &self.seen,
            publishers: self.publishers(),
            alone: self.alone(),
            reliable: self.reliable,
            losses,
        }
    }
}

fn note(whole: &mut VecDeque<(f64, Instant)>, stamp: f64, age: Duration) {
    let now = Instant::now();
    whole.push_front((stamp, now.checked_sub(age).unwrap_or(now)));
    whole.truncate(WHOLE);
}

fn name(stream: Stream) -> &'static str {
    match stream {
        Stream::Colour => "colour image",
        Stream::Depth => "depth image",
    }
}

/// Stamp of an image, s; the current time if the camera sets none.
fn stamp_of(bytes: &[u8], compressed: bool) -> Result<f64, String> {
    let message = ImageMessage::read(bytes, compressed).map_err(|e| e.to_string())?;
    let stamp = message.header().stamp;
    if stamp != ros::Time::default() {
        return Ok(stamp_seconds(stamp));
    }
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    Ok(now.map_or(0.0, |t| t.as_secs_f64()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::Parameters;
    use crate::value::Value;

    fn of(settings: &[(&str, &str)], remaps: &[(&str, &str)]) -> CameraTopics {
        let mut p = Parameters::default();
        for (name, value) in settings {
            p.set(name, &Value::Text((*value).to_owned())).unwrap();
        }
        let node = NodeName {
            namespace: "/robot1".into(),
            name: "stillpoint".into(),
        };
        let rule = |(from, to): &(&str, &str)| Remap {
            node: None,
            from: (*from).to_owned(),
            to: (*to).to_owned(),
        };
        let remaps: Vec<Remap> = remaps.iter().map(rule).collect();
        topics(&Options::new(&p).unwrap(), &node, &remaps)
    }

    #[test]
    fn topics_follow_transports_and_remapping() {
        let plain = of(&[], &[]);
        assert_eq!(plain.colour, "/robot1/camera/color/image_raw");
        assert_eq!(plain.colour_info, "/robot1/camera/color/camera_info");
        assert!(!plain.colour_compressed && !plain.depth_compressed);
        let compressed = of(
            &[
                ("color_transport", "compressed"),
                ("depth_transport", "compressedDepth"),
            ],
            &[
                (COLOUR, "/front/rgb/image"),
                (DEPTH, "/front/depth_registered/image"),
            ],
        );
        assert_eq!(compressed.colour, "/front/rgb/image/compressed");
        assert_eq!(compressed.colour_info, "/front/rgb/camera_info");
        assert_eq!(
            compressed.depth,
            "/front/depth_registered/image/compressedDepth"
        );
        assert!(compressed.colour_compressed && compressed.depth_compressed);
        let named = of(
            &[],
            &[
                (COLOUR, "/a/image/compressed"),
                ("camera/color/camera_info", "/b/info"),
            ],
        );
        assert_eq!(
            (named.colour.as_str(), named.colour_info.as_str()),
            ("/a/image/compressed", "/b/info")
        );
        assert!(named.colour_compressed);
    }
}

//! The examination: frames in, a report out.

use crate::edges::{Edge, FrameEdges, MeanProfile};
use crate::finding::{Figure, Finding, Report, Symptom};
use crate::gradient::{Axis, Gradient, PROFILE};
use crate::registration::Registered;
use crate::sync::{Delay, Moving};
use crate::tracks::{Motion, Tracks};
use crate::{depth_scale, focal, images, lens, registration, stamps, standstill, sync};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{FrameSource, RgbdFrame, SourceError};

/// Assumptions about the frames.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// The camera.
    pub camera: Camera,
    /// Depth image values per metre used to convert depth to metres; remedies refer to it.
    pub depth_scale: f64,
}

/// Maximum distance of corners that give a silhouette's motion, px, and maximum difference of their depth, as a fraction.
const NEAR_PX: f32 = 60.0;
const ALIKE: f32 = 0.12;
/// Number of corners for the median motion, and their maximum difference: in px/s, and as a fraction. A velocity other than the
/// silhouette's own makes every delay look shorter.
const CORNERS: usize = 3;
const AGREE: f32 = 12.0;
const AGREE_SHARE: f32 = 0.15;

/// Examines the frames of a stream.
pub struct Doctor {
    setup: Setup,
    tracks: Tracks,
    depths: depth_scale::Depths,
    still: standstill::Standstills,
    images: images::Images,
    stamps: Vec<f64>,
    /// Silhouettes of the last frame; their motion needs the next frame.
    last: Option<(FrameEdges, f32)>,
    edges: Vec<Moving>,
    profiles: Vec<f32>,
    mirrored: [[MeanProfile; 2]; 3],
    size: [usize; 2],
}

impl Doctor {
    /// An empty examination.
    #[must_use]
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            tracks: Tracks::new(),
            depths: depth_scale::Depths::default(),
            still: standstill::Standstills::default(),
            images: images::Images::default(),
            stamps: Vec::new(),
            last: None,
            edges: Vec::new(),
            profiles: Vec::new(),
            mirrored: [[MeanProfile::default(); 2]; 3],
            size: [0; 2],
        }
    }

    /// Examines the next frame. Keeps some 300 kB of each.
    pub fn look(&mut self, frame: &RgbdFrame) {
        let number = self.stamps.len() as u32;
        self.stamps.push(frame.stamp);
        self.size = [frame.gray.width(), frame.gray.height()];
        self.depths.add(frame.stamp, &frame.depth);
        self.still.add(frame);
        self.tracks.step(frame);
        self.settle(number);
        let gradient = Gradient::new(&frame.gray);
        self.images.add(frame, &gradient);
        let difference = (frame.stamp - frame.depth_stamp) as f32;
        self.last = Some((FrameEdges::new(&gradient, &frame.depth), difference));
    }

    /// Assigns motion to the silhouettes of the last frame.
    fn settle(&mut self, number: u32) {
        let Some((found, difference)) = self.last.take() else {
            return;
        };
        let motions = self.tracks.motions();
        for (edge, profile) in found.edges.iter().zip(found.profiles.chunks_exact(PROFILE)) {
            let Some(velocity) = velocity(edge, &motions) else {
                continue;
            };
            self.edges.push(Moving {
                axis: edge.axis,
                backwards: edge.backwards,
                x: edge.x,
                y: edge.y,
                z: edge.z,
                velocity,
                stamp_difference: difference,
                frame: number - 1,
            });
            self.profiles.extend_from_slice(profile);
        }
        for (sums, more) in self.mirrored.iter_mut().zip(&found.mirrored) {
            for (sum, more) in sums.iter_mut().zip(more) {
                sum.merge(more);
            }
        }
    }

    /// The report on the frames added until now, the most harmful finding first. Skips checks that depend on a faulty input.
    #[must_use]
    pub fn report(&mut self) -> Report {
        let mut report = Report {
            frames: self.stamps.len(),
            ..Report::default()
        };
        if let [first, .., last] = self.stamps[..] {
            report.seconds = last - first;
        }
        let lens_is_sound = lens::judge(&self.setup.camera, &mut report);
        let scale_is_right =
            depth_scale::judge(&mut self.depths, self.setup.depth_scale, &mut report);
        let delay = sync::estimate(&self.edges, &self.profiles);
        let registered = self.judge_registration(delay.as_ref(), &mut report);
        if registered.yes {
            let held = delay.as_ref().filter(|_| registered.delay_holds);
            sync::judge(held, &mut report);
        } else {
            report.pass_over("synchronisation: depth has to be registered first");
        }
        if lens_is_sound {
            let late = report.names(crate::Symptom::Synchronisation);
            let why_not = match (scale_is_right, registered.yes) {
                (false, _) => Some("the depth scale has to be right first"),
                (_, false) => Some("depth has to be registered first"),
                _ if late => Some("colour and depth have to be synchronous first"),
                _ => None,
            };
            let factor = match why_not {
                None => focal::estimate(&self.setup.camera, &self.tracks),
                Some(_) => None,
            };
            focal::judge(&self.setup.camera, factor, why_not, &mut report);
        }
        stamps::judge(&self.stamps, &mut report);
        images::judge(&mut self.images, &mut report);
        standstill::judge(&self.still, &mut report);
        report.findings.sort_by_key(|f| f.symptom);
        report
    }

    fn judge_registration(&self, delay: Option<&Delay>, report: &mut Report) -> Registered {
        registration::judge(
            &self.edges,
            &self.profiles,
            delay,
            self.size,
            &self.mirrored,
            report,
        )
    }
}

/// Image velocity at a silhouette along its axis, px/s: the median of nearby corners on the same surface.
fn velocity(edge: &Edge, motions: &[Motion]) -> Option<f32> {
    let mut nearest = [(NEAR_PX * NEAR_PX, 0.0_f32); CORNERS];
    let mut count = 0;
    for m in motions {
        let (dx, dy) = (
            m.pixel[0] - f32::from(edge.x),
            m.pixel[1] - f32::from(edge.y),
        );
        let distance = dx * dx + dy * dy;
        if distance >= nearest[CORNERS - 1].0 || (m.z - edge.z).abs() > ALIKE * edge.z {
            continue;
        }
        let along = match edge.axis {
            Axis::X => m.velocity[0],
            Axis::Y => m.velocity[1],
        };
        count += 1;
        nearest[CORNERS - 1] = (distance, along);
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    if count < CORNERS {
        return None;
    }
    nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
    let median = nearest[CORNERS / 2].1;
    let spread = nearest[CORNERS - 1].1 - nearest[0].1;
    (spread <= AGREE + AGREE_SHARE * median.abs()).then_some(median)
}

/// One frame in this number may be unreadable: a few damaged images are common.
const READABLE: usize = 10;

/// Pixels examined per requested second: those of 1280 x 720 px at 30 Hz. Three seconds of them take some seconds of CPU time; larger
/// images would take minutes.
const PIXELS_PER_SECOND: f64 = 1280.0 * 720.0 * 30.0;

/// Examines this many seconds of a stream, or less if images are large, as the report then states. Unreadable frames are skipped, and are a
/// finding if frequent.
///
/// # Errors
/// The first error of a stream without any readable frame.
pub fn examine(
    source: &mut dyn FrameSource,
    setup: Setup,
    seconds: f64,
) -> Result<Report, SourceError> {
    let mut doctor = Doctor::new(setup);
    let (mut first, mut unread, mut error) = (None, 0_usize, None);
    let most = seconds * PIXELS_PER_SECOND;
    let mut pixels = 0.0;
    while let Some(item) = source.next_frame() {
        match item {
            Ok(frame) => {
                let begin = *first.get_or_insert(frame.stamp);
                if frame.stamp - begin > seconds || pixels >= most {
                    break;
                }
                doctor.look(&frame);
                pixels += frame.gray.data().len() as f64;
            }
            Err(e) => {
                unread += 1;
                let ended = !e.recoverable;
                error.get_or_insert(e);
                if ended || (first.is_none() && unread >= MOST_UNREAD) {
                    break;
                }
            }
        }
    }
    if first.is_none() {
        return Err(error.unwrap_or_else(|| SourceError {
            message: "expected frames, found none; record again".to_owned(),
            recoverable: false,
        }));
    }
    let mut report = doctor.report();
    if pixels >= most {
        report.pass_over(format!(
            "what comes after {:.1} s: images of {} x {} px are so large that {:.0} megapixels of {seconds} s are looked at, and no more; ask for more seconds",
            report.seconds,
            doctor.size[0],
            doctor.size[1],
            1e-6 * most
        ));
    }
    if let Some(error) = error.filter(|_| unread * READABLE > unread + report.frames) {
        unreadable(unread, &error, &mut report);
    }
    Ok(report)
}

/// Number of unreadable frames at the beginning after which the stream is abandoned.
const MOST_UNREAD: usize = 300;

fn unreadable(unread: usize, first: &SourceError, report: &mut Report) {
    let all = unread + report.frames;
    let finding = Finding {
        symptom: Symptom::Unreadable,
        message: format!("{unread} of {all} frames cannot be read, first: {first}"),
        remedy: "copy or export the recording again; what is said below is of the other frames"
            .into(),
        evidence: vec![Figure::new("frames that cannot be read", unread as f64, "")],
    };
    report.findings.insert(0, finding);
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::{DepthImage, FrameId, GrayImage};

    /// A wall before a camera at 30 Hz, in images of a size.
    struct Wall(usize, usize, u32);

    impl FrameSource for Wall {
        fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
            let Self(width, height, id) = *self;
            self.2 += 1;
            let stamp = f64::from(id) / 30.0;
            Some(Ok(RgbdFrame {
                id: FrameId(id),
                stamp,
                depth_stamp: stamp,
                gray: GrayImage::from_vec(width, height, vec![90; width * height]).ok()?,
                colour: None,
                depth: DepthImage::from_vec(width, height, vec![2.0; width * height]).ok()?,
            }))
        }
    }

    #[test]
    fn fewer_large_images_are_examined_with_a_note() {
        let looked = |width: usize, height: usize| {
            let setup = Setup {
                camera: Camera::pinhole(
                    width as u32,
                    height as u32,
                    [
                        width as f64,
                        width as f64,
                        width as f64 / 2.0,
                        height as f64 / 2.0,
                    ],
                ),
                depth_scale: 1000.0,
            };
            let report = examine(&mut Wall(width, height, 0), setup, 0.5).ok()?;
            let said = report.not_judged.iter().find(|s| s.contains("so large"));
            Some((report.frames, said.cloned()))
        };
        // Half a second of 1280 x 720 px are 13.8 megapixels.
        let (frames, said) = looked(2400, 1600).expect("frames");
        assert_eq!(frames, 4);
        assert!(said.is_some_and(|s| s.contains("after 0.1 s: images of 2400 x 1600 px")));
        assert_eq!(looked(320, 240), Some((16, None)));
    }
}

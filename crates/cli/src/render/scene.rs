//! Draws the images of an animation from the data of a run.

use crate::dense::Fused;
use crate::failure::Failure;
use crate::render::OURS;
use crate::render::reel::{RATE, Reel};
use crate::run::result::timed;
use crate::run::session::Session;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::Mesh;
use stillpoint::evaluation::{EvalOptions, Score, absolute_error, associate, score};
use stillpoint::geometry::{Camera, Se3, Vec3};
use stillpoint::imaging::FrameId;
use stillpoint::view::film::{Film, Look, Plot, Stand, Surface, Track, first_seen};
use stillpoint::view::{Colour, Picture};

/// Colours of other trajectories: none is green, which is the run's, and neighbours differ in brightness too.
const OTHERS: [Colour; 4] = [
    Colour(255, 120, 60),
    Colour(255, 214, 64),
    Colour(214, 120, 255),
    Colour(90, 170, 255),
];
const TRUTH: Colour = Colour(240, 244, 250);

pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) poses: Vec<StampedPose>,
}

pub(crate) struct Scene {
    reel: Reel,
    camera: Camera,
    mesh: Mesh,
    up: Vec3,
    frames: Vec<FrameId>,
    poses: Vec<StampedPose>,
    truth: Option<Vec<StampedPose>>,
}

pub(crate) struct Shot {
    pub(crate) pictures: Vec<Picture>,
    pub(crate) rate: f64,
}

impl Scene {
    /// From a session that ended.
    pub(crate) fn of(
        reel: Reel,
        session: &Session,
        fused: Option<&Fused>,
        truth: Option<Vec<StampedPose>>,
        camera: &Camera,
    ) -> Self {
        Self {
            reel,
            camera: *camera,
            mesh: fused.map(|f| f.mesh.clone()).unwrap_or_default(),
            up: fused.map_or_else(|| -Vec3::y(), |f| f.upward()),
            frames: session.poses.of_frames.clone(),
            poses: session.poses.final_poses.clone(),
            truth,
        }
    }

    pub(crate) fn shoot(&self, also: &[Named]) -> Result<Shot, Failure> {
        if self.reel.taken.is_empty() || self.poses.is_empty() {
            return Err(Failure::criteria(
                "expected frames with a pose to show, found none; the run was lost from its beginning",
            ));
        }
        let tracks = self.tracks(also)?;
        let mesh = &self.mesh;
        let since = first_seen(
            &self.camera,
            &self.looks(),
            &mesh.positions,
            &mesh.triangles,
        );
        let ahead = |p: &StampedPose| p.world_from_camera.rotation * Vec3::z();
        let camera = &self.camera;
        let plot = Plot {
            surface: Surface {
                positions: &mesh.positions,
                normals: &mesh.normals,
                colours: &mesh.colours,
                triangles: &mesh.triangles,
                since: &since,
            },
            tracks: &tracks,
            up: self.up,
            heading: self.poses.iter().map(ahead).sum(),
            opening: [
                0.5 * f64::from(camera.width) / camera.fx,
                0.5 * f64::from(camera.height) / camera.fy,
            ],
            measure: self.error(&self.poses).map_or("", |e| e.0),
            speed: self.speed(),
        };
        let height = self.reel.taken.first().map_or(0, |t| t.view.height());
        let mut film = Film::new(&plot, height);
        let picture = |(taken, number): (&super::reel::Taken, u32)| {
            film.picture(&Stand {
                number,
                stamp: taken.stamp,
                view: &taken.view,
                pose: self.pose(taken.frame),
            })
        };
        Ok(Shot {
            pictures: self.reel.taken.iter().zip(0..).map(picture).collect(),
            rate: RATE,
        })
    }

    /// Playback speed relative to the recording.
    fn speed(&self) -> f64 {
        let taken = &self.reel.taken;
        let (Some(first), Some(last)) = (taken.first(), taken.last()) else {
            return 1.0;
        };
        (last.stamp - first.stamp) * RATE / (taken.len() - 1).max(1) as f64
    }

    fn pose(&self, frame: FrameId) -> Option<&Se3> {
        let at = self.frames.binary_search(&frame).ok()?;
        self.poses.get(at).map(|p| &p.world_from_camera)
    }

    fn looks(&self) -> Vec<Look> {
        let look = |(taken, number): (&super::reel::Taken, u32)| {
            Some(Look {
                number,
                world_from_camera: *self.pose(taken.frame)?,
                depth: taken.depth.clone(),
            })
        };
        self.reel.taken.iter().zip(0..).filter_map(look).collect()
    }

    /// The true trajectory, the others, and that of the run.
    fn tracks(&self, also: &[Named]) -> Result<Vec<Track>, Failure> {
        let mut tracks = Vec::new();
        // Limited to the time of the run.
        let span = |p: &StampedPose| {
            let near = |q: Option<&StampedPose>, sign: f64| {
                q.is_some_and(|q| sign * (p.stamp - q.stamp) >= -0.05)
            };
            near(self.poses.first(), 1.0) && near(self.poses.last(), -1.0)
        };
        if let Some(truth) = &self.truth {
            let within: Vec<StampedPose> = truth.iter().filter(|p| span(p)).copied().collect();
            if let Some(points) = self.aligned(&within) {
                tracks.push(Track {
                    is_truth: true,
                    ..track("truth", String::new(), TRUTH, points)
                });
            }
        }
        for (other, colour) in also.iter().zip(OTHERS.iter().cycle()) {
            let points = self.aligned(&other.poses).ok_or_else(|| {
                Failure::input(format!(
                    "--also {}: expected stamps of the run, found no pose within 20 ms of any; check that it is of this recording",
                    other.name
                ))
            })?;
            tracks.push(track(&other.name, self.note(&other.poses), *colour, points));
        }
        let ours = self.poses.iter();
        let ours = ours
            .map(|p| (p.stamp, p.world_from_camera.translation))
            .collect();
        tracks.push(track(OURS, self.note(&self.poses), Colour::STATIC, ours));
        Ok(tracks)
    }

    /// A trajectory aligned to the run by the best rigid motion; `None` without common stamps.
    fn aligned(&self, poses: &[StampedPose]) -> Option<Vec<(f64, Vec3)>> {
        let (ours, theirs) = (timed(&self.poses), timed(poses));
        let pairs = associate(&ours, &theirs, EvalOptions::default().max_dt);
        let (first, other) = *pairs.first()?;
        let points = |place: &dyn Fn(&Vec3) -> Vec3| {
            let placed = poses.iter();
            let placed = placed.map(|p| (p.stamp, place(&p.world_from_camera.translation)));
            Some(placed.collect())
        };
        match absolute_error(&ours, &theirs, &pairs, false) {
            Ok(ate) => points(&|p| ate.alignment.apply(p)),
            // Where cameras stand still, the first common pose gives the transform.
            Err(_) => {
                let motion =
                    ours[first].world_from_camera * theirs[other].world_from_camera.inverse();
                points(&|p| motion.transform(p))
            }
        }
    }

    /// The name of the error and its RMSE, m, where the truth is known.
    fn error(&self, poses: &[StampedPose]) -> Option<(&'static str, f64)> {
        let truth = timed(self.truth.as_ref()?);
        match score(&truth, &timed(poses), &EvalOptions::default()).ok()? {
            Score::Moving(e) => Some(("ATE", e.ate.statistics.rmse)),
            Score::Fixed(d) => Some(("drift", d.drift.rmse)),
        }
    }

    fn note(&self, poses: &[StampedPose]) -> String {
        let error = self.error(poses);
        error.map_or_else(String::new, |(_, m)| format!("{:.1} mm", m * 1e3))
    }
}

fn track(name: &str, note: String, colour: Colour, points: Vec<(f64, Vec3)>) -> Track {
    Track {
        name: name.to_owned(),
        note,
        colour,
        is_truth: false,
        points,
    }
}

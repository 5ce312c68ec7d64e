//! Assembles the data of a report after a run.

use super::columns::Column;
use super::model::{Mark, MarkKind, ObjectColumns, Pictures, RunData, SurfaceColumns};
use super::recorder::{ONE_IN, ReportRecorder, SeenObject};
use std::collections::BTreeMap;
use stillpoint_detection::Motion;
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_map::{MapView, SubmapId};
use stillpoint_slam::FrameState;

/// Maximum number of landmarks in a report, of 13 bytes each.
const MOST_LANDMARKS: usize = 60_000;

/// A frame in the result.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRow {
    /// Frame number.
    pub id: u32,
    /// Stamp, s.
    pub stamp: f64,
    /// Its state.
    pub state: FrameState,
    /// Number of inliers of the pose.
    pub inliers: u32,
    /// Why it has no pose; empty otherwise.
    pub reason: String,
    /// Final pose, world from camera.
    pub pose: Option<Se3>,
    /// Distance to the true position, m.
    pub error: Option<f64>,
    /// The true position in the world of the poses, m.
    pub truth: Option<Vec3>,
    /// Processing time or latency, ms.
    pub time_ms: Option<f64>,
    /// Time until the detector's answer was used, ms.
    pub answer_ms: Option<f64>,
}

impl RunData {
    /// Sets the frames, in order, and marks losses.
    pub fn set_frames(&mut self, rows: &[FrameRow]) {
        let f = &mut self.frames;
        let first = rows.first().map_or(0.0, |r| r.stamp);
        let or_nan = |x: Option<f64>, factor: f64| x.map_or(f32::NAN, |x| (factor * x) as f32);
        f.first_stamp = first;
        f.id = rows.iter().map(|r| r.id).collect();
        f.seconds = rows.iter().map(|r| (r.stamp - first) as f32).collect();
        f.state = rows.iter().map(|r| r.state as u8).collect();
        let inliers = rows
            .iter()
            .map(|r| u16::try_from(r.inliers).unwrap_or(u16::MAX));
        f.inliers = inliers.collect();
        f.time_ms = rows.iter().map(|r| or_nan(r.time_ms, 1.0)).collect();
        f.answer_ms = rows.iter().map(|r| or_nan(r.answer_ms, 1.0)).collect();
        f.error_mm = rows.iter().map(|r| or_nan(r.error, 1e3)).collect();
        f.pose = rows.iter().flat_map(|r| numbers(r.pose.as_ref())).collect();
        let truth = rows.iter().flat_map(|r| triple(r.truth.as_ref()));
        f.truth = truth.collect();
        for column in [&mut f.moving, &mut f.sigma_mm, &mut f.quality] {
            *column = Column(vec![f32::NAN; rows.len()]);
        }
        let mut lost = false;
        for row in rows {
            let is_lost = row.state == FrameState::Lost;
            if is_lost && !lost {
                self.marks.push(Mark {
                    frame: row.id,
                    kind: MarkKind::Loss,
                    text: format!("no pose: {}", row.reason),
                });
            }
            lost = is_lost;
        }
    }

    /// Sets the landmarks and keyframes of a submap.
    pub fn set_map(&mut self, view: &MapView, submap: Option<SubmapId>) {
        let of = |id| submap.is_none() || view.submap_of(id) == submap;
        let all = || view.landmarks().filter(|(_, l)| of(l.anchor));
        let count = all().count();
        let every = count.div_ceil(MOST_LANDMARKS).max(1);
        let map = &mut self.map;
        map.count = count as u32;
        for (id, landmark) in all().step_by(every) {
            map.position
                .extend(triple(view.landmark_position(id).as_ref()));
            map.frame.0.push(landmark.created_at.0);
            let odds = f64::from(landmark.static_odds);
            let probability = 1.0 / (1.0 + (-odds).exp());
            map.stands_still.0.push((255.0 * probability).round() as u8);
        }
        for keyframe in view.keyframes().filter(|k| of(k.id)) {
            self.keyframes.id.0.push(keyframe.id.0);
            let pose = numbers(Some(&keyframe.world_from_camera));
            self.keyframes.pose.extend(pose);
        }
        for edge in view.loops() {
            let ends = [edge.old, edge.new].map(|id| view.resolve_keyframe(id));
            if let [Some(a), Some(b)] = ends
                && of(a)
                && of(b)
            {
                self.keyframes.loops.extend([a.0, b.0]);
            }
        }
    }

    /// Adds the data collected during the run. The frames must have been set.
    pub fn set_recorded(&mut self, recorder: &ReportRecorder) {
        let ids = self.frames.id.0.iter().enumerate();
        let at: BTreeMap<u32, usize> = ids.map(|(i, id)| (*id, i)).collect();
        for seen in recorder.frames() {
            if let Some(i) = at.get(&seen.frame.0) {
                self.frames.moving.0[*i] = seen.moving as f32;
                self.frames.quality.0[*i] = seen.quality as f32;
                let sigma = seen.sigma_m.map_or(f32::NAN, |m| (1e3 * m) as f32);
                self.frames.sigma_mm.0[*i] = sigma;
            }
        }
        self.marks.extend_from_slice(recorder.marks());
        self.marks.sort_by_key(|m| (m.frame, m.kind));
        self.image = recorder.image();
        let [width, height] = self.image.map(|n| n as usize);
        let (width, height) = recorder.picture_size(width, height);
        let mut pictures = Pictures {
            size: [width as u32, height as u32],
            one_in: ONE_IN as u32,
            ..Pictures::default()
        };
        let mut objects = ObjectColumns::default();
        for (frame, shown) in recorder.shown() {
            pictures.frame.0.push(frame.0);
            pictures.webp.push(shown.webp.clone());
            pictures.features.push(shown.features.clone());
            let pose = at.get(&frame.0).and_then(|i| self.pose(*i));
            for object in &shown.objects {
                objects.add(frame.0, object, pose.as_ref());
            }
        }
        self.pictures = pictures;
        self.objects = objects;
    }

    fn pose(&self, i: usize) -> Option<Se3> {
        let p = self.frames.pose.0.get(7 * i..7 * i + 7)?;
        let [x, y, z, qx, qy, qz, qw] = [0, 1, 2, 3, 4, 5, 6].map(|k| f64::from(p[k]));
        let rotation = stillpoint_geometry::nalgebra::Quaternion::new(qw, qx, qy, qz);
        let rotation = stillpoint_geometry::nalgebra::UnitQuaternion::new_normalize(rotation);
        let pose = Se3::new(rotation, Vec3::new(x, y, z));
        pose.is_finite().then_some(pose)
    }
}

impl SurfaceColumns {
    /// A surface: vertices (m) with colours, and triangles; `count` is the number of triangles of the full surface. Triangles with vertices
    /// beyond the 65 536th are left out.
    #[must_use]
    pub fn new(
        count: usize,
        positions: &[[f32; 3]],
        colours: &[[u8; 3]],
        triangles: &[[u32; 3]],
    ) -> Self {
        let fold = |start: f32, f: fn(f32, f32) -> f32| -> [f32; 3] {
            std::array::from_fn(|k| positions.iter().fold(start, |m, p| f(m, p[k])))
        };
        let (least, most) = (
            fold(f32::INFINITY, f32::min),
            fold(f32::NEG_INFINITY, f32::max),
        );
        let sides: [f32; 3] = std::array::from_fn(|k| (most[k] - least[k]).max(1e-6));
        let share =
            |p: &[f32; 3], k: usize| ((p[k] - least[k]) / sides[k] * 65_535.0).round() as u16;
        Self {
            count: count as u32,
            bounds: if positions.is_empty() {
                Column::default()
            } else {
                least.into_iter().chain(sides).collect()
            },
            position: positions
                .iter()
                .flat_map(|p| [0, 1, 2].map(|k| share(p, k)))
                .collect(),
            colour: colours.iter().flatten().copied().collect(),
            triangle: triangles
                .iter()
                .filter(|t| t.iter().all(|i| *i <= u32::from(u16::MAX)))
                .flat_map(|t| t.map(|i| i as u16))
                .collect(),
        }
    }
}

impl ObjectColumns {
    pub(crate) fn add(&mut self, frame: u32, object: &SeenObject, pose: Option<&Se3>) {
        let known = self.classes.iter().position(|c| c == object.class);
        let class = known.unwrap_or_else(|| {
            self.classes.push(object.class.to_owned());
            self.classes.len() - 1
        });
        self.frame.0.push(frame);
        self.id.0.push(object.id);
        self.class.0.push(class as u8);
        self.motion.0.push(match object.motion {
            Motion::Unknown => 0,
            Motion::Moving => 1,
            Motion::Parked => 2,
        });
        let px = object.bounds.map(|x| x.round().clamp(0.0, 65_535.0) as u16);
        self.bounds.extend(px);
        let position = object
            .in_camera
            .zip(pose)
            .map(|(p, pose)| pose.transform(&p));
        self.position.extend(triple(position.as_ref()));
        self.size.extend(object.size.map(|x| x as f32));
        self.speed
            .0
            .push(object.speed.map_or(f32::NAN, |s| s as f32));
    }
}

pub(crate) fn triple(p: Option<&Vec3>) -> [f32; 3] {
    p.map_or([f32::NAN; 3], |p| [p.x, p.y, p.z].map(|x| x as f32))
}

/// Position and quaternion (x, y, z, w).
pub(crate) fn numbers(pose: Option<&Se3>) -> [f32; 7] {
    pose.map_or([f32::NAN; 7], |p| {
        let (t, q) = (&p.translation, p.rotation.coords);
        [t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(|x| x as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surface_vertices_are_encoded_to_a_tenth_of_a_millimetre() {
        let positions = [[-1.25, 0.5, 2.0], [3.0, 0.5, 1.0], [0.3, 0.5, 7.7]];
        let colours = [[1, 2, 3], [40, 50, 60], [255, 0, 7]];
        let triangles = [[0, 1, 2], [0, 1, 70_000]];
        let s = SurfaceColumns::new(5, &positions, &colours, &triangles);
        assert_eq!((s.count, &s.triangle.0[..]), (5, &[0, 1, 2][..]));
        assert_eq!(s.colour.0, colours.concat());
        for (i, share) in s.position.0.iter().enumerate() {
            let (least, side) = (s.bounds.0[i % 3], s.bounds.0[3 + i % 3]);
            let back = least + f32::from(*share) / 65_535.0 * side;
            assert!((back - positions[i / 3][i % 3]).abs() < 1e-4, "{i}: {back}");
        }
        assert!(SurfaceColumns::new(0, &[], &[], &[]).bounds.0.is_empty());
    }
}

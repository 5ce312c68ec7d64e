//! Finds the faces, including those of people, that rows of an image may show around a moment. `raster` determines which pixels see them.

use crate::people::Asked;
use crate::scene::{Face, Scene};
use std::ops::Range;
use stillpoint_geometry::{Camera, Se3, Vec3};

/// Margin for the motion of a face around such a moment, rows.
const MARGIN: f64 = 3.0;
/// Signed distance from a face's plane below which the camera cannot see its front around a moment, m.
const TURNED_AWAY: f64 = -0.05;

/// The faces that some rows may show around a moment, with the range of rendered rows that each may touch.
pub(crate) struct Moment {
    /// Static faces, by index.
    fixed: Vec<(usize, [f64; 2])>,
    moving: Vec<(Face, [f64; 2])>,
}

/// A face, with the first and the last rendered row that it may touch.
pub(crate) type Touched<'a> = (&'a Face, [f64; 2]);

/// Whether a face with this row range may touch some rows around the moment.
pub(crate) fn touch([first, last]: &[f64; 2], rows: &Range<usize>) -> bool {
    let (top, bottom) = (rows.start as f64, rows.end as f64);
    *first <= bottom + MARGIN && *last >= top - MARGIN
}

impl Moment {
    /// The faces that `rows` may show around a time (s) to a camera at a pose.
    pub(crate) fn new(
        scene: &Scene,
        camera: &Camera,
        (time, world_from_camera): (f64, &Se3),
        rows: &Range<usize>,
    ) -> Self {
        let sight = InSight::new(camera, world_from_camera, rows);
        let fixed = scene.fixed().iter().enumerate();
        let fixed = fixed.filter_map(|(number, face)| {
            let at = sight.rows_of(&face.vertices, &face.normal);
            touch(&at, rows).then_some((number, at))
        });
        let fixed = fixed.collect();
        let (moving, at) = sight.moving(scene, time);
        Self {
            fixed,
            moving: moving.into_iter().zip(at).collect(),
        }
    }

    /// The faces that a subset of the rows may show; static ones come first.
    pub(crate) fn touched<'a>(&'a self, scene: &'a Scene, rows: &Range<usize>) -> Vec<Touched<'a>> {
        let fixed = self
            .fixed
            .iter()
            .map(|(number, at)| (&scene.fixed()[*number], *at));
        let moving = self.moving.iter().map(|(face, at)| (face, *at));
        fixed
            .chain(moving)
            .filter(|(_, at)| touch(at, rows))
            .collect()
    }
}

/// Filters the faces that some rows may show around a moment.
pub(crate) struct InSight<'a> {
    camera: &'a Camera,
    camera_from_world: Se3,
    eye: Vec3,
    rows: &'a Range<usize>,
    /// Row ranges of the accepted faces.
    found: Vec<[f64; 2]>,
}

impl<'a> InSight<'a> {
    pub(crate) fn new(camera: &'a Camera, world_from_camera: &Se3, rows: &'a Range<usize>) -> Self {
        Self {
            camera,
            camera_from_world: world_from_camera.inverse(),
            eye: world_from_camera.translation,
            rows,
            found: Vec::new(),
        }
    }

    /// The faces of movers at a time (s), with their row ranges.
    pub(crate) fn moving(mut self, scene: &Scene, time: f64) -> (Vec<Face>, Vec<[f64; 2]>) {
        let faces = scene.moving(time, &mut self);
        (faces, self.found)
    }

    /// The first and the last rendered row that a face touches; an empty range if it is a back face.
    fn rows_of(&self, corners: &[Vec3], normal: &Vec3) -> [f64; 2] {
        let turned_away = normal.dot(&(self.eye - corners[0])) < TURNED_AWAY;
        if turned_away {
            NO_ROWS
        } else {
            self.extent(corners)
        }
    }

    /// The row range of everything between some points.
    fn extent(&self, points: &[Vec3]) -> [f64; 2] {
        let mut rows = NO_ROWS;
        let (mut near, mut behind) = (false, true);
        for point in points {
            let p = self.camera_from_world.transform(point);
            near |= p.z < 0.2;
            behind &= p.z < -0.2;
            let v = self.camera.project(&p).y;
            rows = [rows[0].min(v), rows[1].max(v)];
        }
        match (near, behind) {
            (false, _) => rows,
            // A face that passes the camera moves by more than the margin, or is invisible.
            (true, true) => NO_ROWS,
            (true, false) => [f64::MIN, f64::MAX],
        }
    }
}

const NO_ROWS: [f64; 2] = [f64::MAX, f64::MIN];

impl Asked for InSight<'_> {
    fn about(&self, corners: &[Vec3; 8]) -> bool {
        let [first, last] = self.extent(corners);
        // One pixel more than its faces, for rounding.
        touch(&[first - 1.0, last + 1.0], self.rows)
    }

    fn asks(&mut self, corners: &[Vec3; 3], normal: &Vec3) -> bool {
        let rows = self.rows_of(corners, normal);
        let asked = touch(&rows, self.rows);
        if asked {
            self.found.push(rows);
        }
        asked
    }
}

//! What rows of an image may show about a moment.
//!
//! Answers: which faces, those of people where they are then, may be seen in some rows by a camera that is about there. Which pixels see them is the business of `raster`.

use crate::people::Asked;
use crate::scene::{Face, Scene};
use std::ops::Range;
use stillpoint_geometry::{Camera, Se3, Vec3};

/// Rows that a face may move by from such a moment to one about it, px.
const MARGIN: f64 = 3.0;
/// A face is not in sight about a moment whose plane is so far on the wrong side of the camera, m.
const TURNED_AWAY: f64 = -0.05;

/// The faces that some rows may show about a moment, with the rows of the rendered image that each may touch.
pub(crate) struct Moment {
    /// Of what stands still, by number.
    fixed: Vec<(usize, [f64; 2])>,
    moving: Vec<(Face, [f64; 2])>,
}

/// A face, and the first and the last row of the rendered image that it may touch.
pub(crate) type Touched<'a> = (&'a Face, [f64; 2]);

/// Whether a face that touches rows at a moment may touch some about it.
pub(crate) fn touch([first, last]: &[f64; 2], rows: &Range<usize>) -> bool {
    let (top, bottom) = (rows.start as f64, rows.end as f64);
    *first <= bottom + MARGIN && *last >= top - MARGIN
}

impl Moment {
    /// What `rows` may show at a time (s) or about it to a camera at a pose.
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

    /// Those that fewer rows may show; what stands still comes first.
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

/// Asks for the faces that some rows may show about a moment.
pub(crate) struct InSight<'a> {
    camera: &'a Camera,
    camera_from_world: Se3,
    eye: Vec3,
    rows: &'a Range<usize>,
    /// The rows that each of those asked for may touch.
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

    /// The faces of what moves, where it is at a time (s), and the rows that each may touch.
    pub(crate) fn moving(mut self, scene: &Scene, time: f64) -> (Vec<Face>, Vec<[f64; 2]>) {
        let faces = scene.moving(time, &mut self);
        (faces, self.found)
    }

    /// The first and the last row of the rendered image that a face touches: none where it is turned away from the camera.
    fn rows_of(&self, corners: &[Vec3], normal: &Vec3) -> [f64; 2] {
        let turned_away = normal.dot(&(self.eye - corners[0])) < TURNED_AWAY;
        if turned_away {
            NO_ROWS
        } else {
            self.extent(corners)
        }
    }

    /// The same of all that lies between some points.
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
            // What passes the camera moves by more than the margin, or is not there at all.
            (true, true) => NO_ROWS,
            (true, false) => [f64::MIN, f64::MAX],
        }
    }
}

const NO_ROWS: [f64; 2] = [f64::MAX, f64::MIN];

impl Asked for InSight<'_> {
    fn about(&self, corners: &[Vec3; 8]) -> bool {
        let [first, last] = self.extent(corners);
        // A pixel more than its faces have, for rounding.
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

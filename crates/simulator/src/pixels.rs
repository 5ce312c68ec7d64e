//! Face and inverse depth of each recorded pixel, through the lens, with a global or rolling shutter; one sample per pixel.

use crate::lens::Lens;
use crate::raster::{NOTHING, View};
use crate::shade::Visible;
use std::ops::Range;

/// Faces and depths of a recorded image.
pub(crate) struct Pixels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 / z, 1/m; 0 for no face.
    pub(crate) inverse_depth: Vec<f32>,
    /// Index in `faces`, or beyond them for no face.
    face: Vec<u32>,
    faces: Vec<Visible>,
}

impl Pixels {
    pub(crate) fn new(lens: &Lens) -> Self {
        let size = lens.width * lens.height;
        Self {
            width: lens.width,
            height: lens.height,
            inverse_depth: Vec::with_capacity(size),
            face: Vec::with_capacity(size),
            faces: Vec::new(),
        }
    }

    pub(crate) fn scale(&mut self, factor: f64) {
        if factor == 1.0 {
            return;
        }
        let per_pixel = self.inverse_depth.iter_mut();
        per_pixel.for_each(|w| *w = (f64::from(*w) / factor) as f32);
        for face in &mut self.faces {
            face.inverse_depth = face.inverse_depth.map(|c| c / factor);
        }
    }

    #[inline]
    pub(crate) fn face(&self, pixel: usize) -> Option<&Visible> {
        self.faces.get(self.face[pixel] as usize)
    }

    /// Adds the next rows of the recorded image from a view with one sample per pixel; its faces must be added afterwards.
    pub(crate) fn push(&mut self, view: &View, lens: &Lens, rows: Range<usize>) {
        let before = self.faces.len() as u32;
        let number = |n: u32| match n {
            NOTHING => u32::MAX,
            n => before + n,
        };
        for y in rows {
            if lens.is_ideal() {
                let (depths, faces) = view.row(y);
                self.inverse_depth.extend_from_slice(depths);
                self.face.extend(faces.iter().map(|n| number(*n)));
                continue;
            }
            for x in 0..lens.width {
                let [u, v] = lens.place(x, y);
                let found = view.face_at((u + 0.5) as usize, (v + 0.5) as usize);
                let [c0, cu, cv] = view
                    .faces
                    .get(found as usize)
                    .map_or([0.0; 3], |f| f.inverse_depth);
                // At a face's border the line of sight may just miss it, where its plane is behind the camera.
                self.inverse_depth
                    .push((c0 + cu * u + cv * v).max(0.0) as f32);
                self.face.push(number(found));
            }
        }
    }

    /// Adds the faces of the view whose rows were added last.
    pub(crate) fn add_faces(&mut self, view: &mut View) {
        self.faces.append(&mut view.faces);
    }
}

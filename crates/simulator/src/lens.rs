//! Lens distortion: maps pixels of the recorded image to the rendered pinhole image.

use stillpoint_geometry::{Camera, Vec2};

/// A recording camera, and a pinhole camera whose view covers it.
pub(crate) struct Lens {
    /// The rendered pinhole camera: the recording camera itself without distortion.
    pub(crate) rendered: Camera,
    /// Width of the recorded image, px.
    pub(crate) width: usize,
    /// Height of the recorded image, px.
    pub(crate) height: usize,
    /// For each recorded pixel its position in the rendered image; empty without distortion.
    places: Vec<[f64; 2]>,
}

impl Lens {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut lens = Self {
            rendered: *camera,
            width,
            height,
            places: Vec::new(),
        };
        if camera.distortion.is_zero() {
            return lens;
        }
        let mut bounds = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for i in 0..width * height {
            let p = camera.undistort(Vec2::new((i % width) as f64, (i / width) as f64));
            let b = bounds;
            bounds = [b[0].min(p.x), b[1].min(p.y), b[2].max(p.x), b[3].max(p.y)];
            lens.places.push([p.x, p.y]);
        }
        let (left, top) = (bounds[0].floor() - 1.0, bounds[1].floor() - 1.0);
        for [u, v] in &mut lens.places {
            *u -= left;
            *v -= top;
        }
        let size = [bounds[2] - left + 2.0, bounds[3] - top + 2.0].map(|v| v.ceil() as u32);
        let intrinsics = [camera.fx, camera.fy, camera.cx - left, camera.cy - top];
        lens.rendered = Camera::pinhole(size[0], size[1], intrinsics);
        lens
    }

    /// True if recorded and rendered pixels are the same.
    pub(crate) fn is_ideal(&self) -> bool {
        self.places.is_empty()
    }

    /// Position of the recorded pixel (x, y) in the rendered image, px.
    pub(crate) fn place(&self, x: usize, y: usize) -> [f64; 2] {
        match self.places.get(y * self.width + x) {
            Some(place) => *place,
            None => [x as f64, y as f64],
        }
    }

    /// The rows of the rendered image needed for the recorded row `y`.
    pub(crate) fn rendered_rows(&self, y: usize) -> std::ops::Range<usize> {
        if self.is_ideal() {
            return y..y + 1;
        }
        let places = &self.places[y * self.width..(y + 1) * self.width];
        let (top, bottom) = places.iter().fold((f64::MAX, f64::MIN), |(a, b), [_, v]| {
            (a.min(*v), b.max(*v))
        });
        let last = self.rendered.height as usize;
        // Samples extend half a pixel around a position.
        ((top - 1.0).max(0.0) as usize).min(last)..((bottom + 2.0) as usize).min(last)
    }
}

//! Exposure times of image rows.
//!
//! Renders ideal colour images with rolling shutter and motion blur, and the visible faces of depth images. Every row has the exact pose of
//! its own time; movers are updated every [`STEP`].

use crate::lens::Lens;
use crate::moment::{InSight, Moment, Touched, touch};
use crate::path::Path;
use crate::pixels::Pixels;
use crate::raster::View;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::ops::Range;
use stillpoint_geometry::{Vec2, Vec3};

/// Exposure timing of a camera's images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// Readout time of the colour image, first row to last, s; 0 for a global shutter. The stamp is the middle of the middle row's
    /// exposure.
    pub readout: f64,
    /// Readout time of the depth image, s: the infrared camera of a Kinect has its own rolling shutter (Ringaby and Forssen, ICCV 2011).
    pub depth_readout: f64,
    /// Exposure time of each row of the colour image, s; 0 for no motion blur.
    pub exposure: f64,
}

impl Shutter {
    /// A hand-held camera indoors: 20 ms of readout, 30 ms of the infrared camera's, 10 ms of exposure.
    pub(crate) const ROLLING: Self = Self {
        readout: 0.02,
        depth_readout: 0.03,
        exposure: 0.01,
    };

    /// Adapts it to another rate: times that nearly fill a frame period at 30 Hz do so at any higher rate.
    pub(crate) fn at_rate(self, rate: f64) -> Self {
        let share = (30.0 / rate).min(1.0);
        Self {
            readout: share * self.readout,
            depth_readout: share * self.depth_readout,
            exposure: share * self.exposure,
        }
    }

    /// True if every time is at least 0 and an image is read before the next one.
    pub(crate) fn fits(&self, rate: f64) -> bool {
        let period = 1.0 / rate;
        [self.readout, self.depth_readout, self.exposure]
            .iter()
            .all(|t| (0.0..=period).contains(t))
    }
}

/// Maximum image motion between two averaged exposures, px.
const BLUR_STEP: f64 = 2.0;
/// Maximum number of averaged exposures: faster motion exceeds `BLUR_STEP` between two of them.
const MOST_EXPOSURES: usize = 12;
/// Minimum depth assumed for the bound on image motion, m.
const NEAREST: f64 = 0.7;
/// Interval of updating movers, s: limbs of 2 m/s at 1 m move by half a pixel.
const STEP: f64 = 0.0005;

/// Number of rows drawn at once.
const BAND: usize = 8;

/// A camera on its path through a scene.
#[derive(Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) path: &'a Path,
    pub(crate) lens: &'a Lens,
}

impl<'a> Sight<'a> {
    /// Ideal RGB rows in grey levels of an image with the middle of its middle row's exposure at `stamp`.
    pub(crate) fn colour(&self, stamp: f64, shutter: &Shutter) -> Vec<f32> {
        let count = self.exposures(stamp, shutter.exposure);
        let stamps = (0..count).map(|k| {
            let late = shutter.exposure * ((k as f64 + 0.5) / count as f64 - 0.5);
            stamp + late
        });
        let stamps: Vec<f64> = stamps.collect();
        let moments = self.moments(&stamps, shutter.readout);
        let mut sum = Vec::new();
        for (k, stamp) in stamps.into_iter().enumerate() {
            let one = self.exposed(stamp, shutter.readout, &moments);
            if k == 0 {
                sum = one;
            } else {
                sum.iter_mut().zip(&one).for_each(|(s, v)| *s += v);
            }
        }
        if count > 1 {
            let share = 1.0 / count as i32 as f32;
            sum.iter_mut().for_each(|s| *s *= share);
        }
        sum
    }

    /// Like [`Self::colour`] with zero exposure time; `moments` are precomputed.
    fn exposed(&self, stamp: f64, readout: f64, moments: &BTreeMap<i64, Moment>) -> Vec<f32> {
        let (w, h) = (self.lens.width, self.lens.height);
        let mut ideal = vec![0.0_f32; 3 * w * h];
        let mut rows = ideal.chunks_exact_mut(3 * w).enumerate();
        if readout == 0.0 {
            let mut view = self.faces(stamp, 2);
            for band in self.bands() {
                view.draw(self.rendered_rows(&band));
                for (y, row) in rows.by_ref().take(band.len()) {
                    view.shade_row(self.scene, self.lens, y, row);
                }
            }
            return ideal;
        }
        let mut view = View::blank(&self.lens.rendered, 2);
        for (key, run) in self.runs(stamp, readout) {
            let at = self.all_rendered_rows(&run);
            let fresh;
            let moment = match moments.get(&key) {
                Some(moment) => moment,
                None => {
                    fresh = self.moment(key, &at);
                    &fresh
                }
            };
            let touched = moment.touched(self.scene, &at);
            for (y, row) in rows.by_ref().take(run.len()) {
                self.strip(y, self.row_time(y, stamp, readout), &touched, &mut view);
                view.shade_row(self.scene, self.lens, y, row);
            }
        }
        ideal
    }

    /// The visible faces in the middle of each pixel's exposure.
    pub(crate) fn pixels(&self, stamp: f64, readout: f64) -> Pixels {
        let mut pixels = Pixels::new(self.lens);
        if readout == 0.0 {
            let mut view = self.faces(stamp, 1);
            for band in self.bands() {
                view.draw(self.rendered_rows(&band));
                pixels.push(&view, self.lens, band);
            }
            pixels.add_faces(&mut view);
            return pixels;
        }
        let mut view = View::blank(&self.lens.rendered, 1);
        for (key, run) in self.runs(stamp, readout) {
            let rows = self.all_rendered_rows(&run);
            let moment = self.moment(key, &rows);
            let touched = moment.touched(self.scene, &rows);
            for y in run {
                self.strip(y, self.row_time(y, stamp, readout), &touched, &mut view);
                pixels.push(&view, self.lens, y..y + 1);
                pixels.add_faces(&mut view);
            }
        }
        pixels
    }

    /// The recorded rows in bands that are drawn in turn, small enough to stay in the processor's cache.
    fn bands(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let height = self.lens.height;
        // Bands of a distorting lens would overlap in the rendered image.
        let step = if self.lens.is_ideal() { BAND } else { height };
        (0..height)
            .step_by(step)
            .map(move |y| y..(y + step).min(height))
    }

    /// The rows of the rendered image needed for some recorded rows.
    fn rendered_rows(&self, recorded: &Range<usize>) -> Range<usize> {
        if self.lens.is_ideal() {
            return recorded.clone();
        }
        0..self.lens.rendered.height as usize
    }

    /// Exposure time of a row of the recorded image, s.
    pub(crate) fn row_time(&self, y: usize, stamp: f64, readout: f64) -> f64 {
        stamp + readout * (y as f64 / self.lens.height as f64 - 0.5)
    }

    /// The faces that the camera sees at a time, before the lens, with `factor`^2 samples per pixel; nothing is drawn yet.
    pub(crate) fn faces(&self, stamp: f64, factor: usize) -> View {
        let pose = self.path.world_from_camera(stamp);
        let rows = 0..self.lens.rendered.height as usize;
        let moving = InSight::new(&self.lens.rendered, &pose, &rows)
            .moving(self.scene, stamp)
            .0;
        let faces = self.scene.fixed().iter().chain(&moving);
        let mut view = View::blank(&self.lens.rendered, factor);
        view.place(faces, &self.lens.rendered, &pose, rows);
        view
    }

    /// The recorded rows in groups exposed around the same moment, with its number.
    fn runs(&self, stamp: f64, readout: f64) -> Vec<(i64, Range<usize>)> {
        let mut runs: Vec<(i64, Range<usize>)> = Vec::new();
        for y in 0..self.lens.height {
            let key = (self.row_time(y, stamp, readout) / STEP).round() as i64;
            match runs.last_mut() {
                Some((last, run)) if *last == key => run.end = y + 1,
                _ => runs.push((key, y..y + 1)),
            }
        }
        runs
    }

    /// The moments around which images centred at `stamps` are exposed, each with the faces that their rows may show.
    fn moments(&self, stamps: &[f64], readout: f64) -> BTreeMap<i64, Moment> {
        if readout == 0.0 {
            return BTreeMap::new();
        }
        let mut rows: BTreeMap<i64, Range<usize>> = BTreeMap::new();
        for (key, run) in stamps.iter().flat_map(|t| self.runs(*t, readout)) {
            let all = rows.entry(key).or_insert_with(|| run.clone());
            *all = all.start.min(run.start)..all.end.max(run.end);
        }
        let moment = |(key, run)| (key, self.moment(key, &self.all_rendered_rows(&run)));
        rows.into_iter().map(moment).collect()
    }

    fn moment(&self, key: i64, rows: &Range<usize>) -> Moment {
        let time = key as f64 * STEP;
        let pose = self.path.world_from_camera(time);
        Moment::new(self.scene, &self.lens.rendered, (time, &pose), rows)
    }

    /// The rows of the rendered image needed for some recorded rows.
    fn all_rendered_rows(&self, recorded: &Range<usize>) -> Range<usize> {
        let rows = recorded.clone().map(|y| self.lens.rendered_rows(y));
        let rows = rows.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
        rows.unwrap_or_default()
    }

    /// Draws the recorded row `y` of some faces at a time.
    fn strip(&self, y: usize, time: f64, faces: &[Touched], view: &mut View) {
        let rows = self.lens.rendered_rows(y);
        let touched = faces.iter().filter(|(_, at)| touch(at, &rows));
        let pose = self.path.world_from_camera(time);
        let faces = touched.map(|(face, _)| *face);
        view.place(faces, &self.lens.rendered, &pose, rows.clone());
        view.draw(rows);
    }

    fn exposures(&self, stamp: f64, exposure: f64) -> usize {
        if exposure == 0.0 {
            return 1;
        }
        let moved = self
            .camera_px(stamp, exposure)
            .max(self.mover_px(stamp, exposure));
        ((moved / BLUR_STEP).ceil() as usize).clamp(1, MOST_EXPOSURES)
    }

    /// Maximum image motion of static faces within a time about a stamp, px.
    fn camera_px(&self, stamp: f64, span: f64) -> f64 {
        let camera = &self.lens.rendered;
        let pose = |t: f64| self.path.world_from_camera(t);
        let later_from_earlier = pose(stamp + 0.5 * span).inverse() * pose(stamp - 0.5 * span);
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let mut most = 0.0_f64;
        for (u, v) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)] {
            let px = Vec2::new(u, v);
            for z in [NEAREST, 10.0] {
                let there = later_from_earlier.transform(&camera.backproject(px, z));
                if there.z > 0.0 {
                    most = most.max((camera.project(&there) - px).norm());
                }
            }
        }
        most
    }

    /// Maximum image motion of visible movers; limbs are twice as fast as bodies.
    fn mover_px(&self, stamp: f64, span: f64) -> f64 {
        let pose = self.path.world_from_camera(stamp);
        let mut most = 0.0_f64;
        for motion in self.scene.movers(stamp).iter().filter_map(|m| m.motion) {
            let distance = (Vec3::from(motion.position) - pose.translation).norm();
            let speed = 2.0 * Vec3::from(motion.velocity).norm();
            most = most.max(speed * span * self.lens.rendered.fx / distance.max(NEAREST));
        }
        most
    }
}

#[cfg(test)]
mod tests;

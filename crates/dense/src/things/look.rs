//! A view kept from a frame: a reduced depth image, and the boxes of the objects in it.

use super::part::Point;
use crate::floor::Floor;
use crate::kept::Anchor;
use stillpoint_detection::ClassId;
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3};
use stillpoint_imaging::DepthImage;
use stillpoint_map::{KeyframeId, MapView, SubmapId};

/// Depth units per metre.
const PER_METRE: f64 = 1000.0;
/// Minimum number of columns of the reduced image.
const COLUMNS: usize = 106;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighting {
    pub(crate) track: u32,
    /// How often the track has moved.
    pub(crate) run: u32,
    pub(crate) class: ClassId,
    pub(crate) score: f32,
    /// Whether it is a candidate object: detected in this frame, and not a mover. Others only occlude.
    pub(crate) counts: bool,
    /// Left, top, right, bottom; px of the pinhole image.
    pub(crate) bounds: [f32; 4],
    pub(crate) depths: [f32; 2],
}

#[derive(Clone, Debug)]
pub(crate) struct Grid {
    pub(crate) camera: Camera,
    /// Pixels from one point to the next.
    pub(crate) step: usize,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Per point the raw pixel, if inside of the image.
    source: Vec<Option<[u16; 2]>>,
}

impl Grid {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (w, h) = (camera.width as usize, camera.height as usize);
        let step = (w / COLUMNS).max(1);
        let (columns, rows) = (w.div_ceil(step), h.div_ceil(step));
        let of = |i: usize| {
            let (x, y) = (i % columns * step, i / columns * step);
            let raw = camera.distort(Vec2::new(x as f64, y as f64));
            let (u, v) = (raw.x + 0.5, raw.y + 0.5);
            let inside = u >= 0.0 && v >= 0.0 && u < w as f64 && v < h as f64;
            inside.then_some([u as u16, v as u16])
        };
        Self {
            camera: camera.rectified(),
            step,
            columns,
            rows,
            source: (0..columns * rows).map(of).collect(),
        }
    }

    /// Reduces a depth image; 0 where depth is missing or moving (`moving` has one entry per raw pixel, or is empty).
    pub(crate) fn depths(&self, depth: &DepthImage, moving: &[bool]) -> Box<[u16]> {
        let (w, h) = (depth.width(), depth.height());
        let value = |at: &Option<[u16; 2]>| {
            let [x, y] = (*at)?.map(usize::from);
            let moves = moving.get(y * w + x).is_some_and(|m| *m);
            let z = f64::from((x < w && y < h).then(|| depth.at(x, y))?);
            let units = z * PER_METRE + 0.5;
            (!moves && units < 65535.0).then_some(units as u16)
        };
        self.source.iter().map(|s| value(s).unwrap_or(0)).collect()
    }

    pub(crate) fn pixel(&self, i: usize) -> Vec2 {
        let (x, y) = (i % self.columns, i / self.columns);
        Vec2::new((x * self.step) as f64, (y * self.step) as f64)
    }

    /// The point of the reduced image nearest to a pixel; `None` outside.
    pub(crate) fn nearest(&self, px: Vec2) -> Option<usize> {
        let at = [px.x, px.y].map(|v| (v / self.step as f64 + 0.5).floor());
        let inside =
            at[0] >= 0.0 && at[1] >= 0.0 && at[0] < self.columns as f64 && at[1] < self.rows as f64;
        inside.then(|| at[1] as usize * self.columns + at[0] as usize)
    }

    /// The box in the pinhole image around one in the raw image.
    pub(crate) fn undistorted(raw: &Camera, bounds: [f64; 4]) -> [f32; 4] {
        let [x0, y0, x1, y1] = bounds;
        let (xm, ym) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let rim = [
            [x0, y0],
            [xm, y0],
            [x1, y0],
            [x1, ym],
            [x1, y1],
            [xm, y1],
            [x0, y1],
            [x0, ym],
        ];
        let far = f64::INFINITY;
        rim.map(|[x, y]| raw.undistort(Vec2::new(x, y)))
            .iter()
            .fold([far, far, -far, -far], |b, p| {
                [b[0].min(p.x), b[1].min(p.y), b[2].max(p.x), b[3].max(p.y)]
            })
            .map(|v| v as f32)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) stamp: f64,
    pub(crate) anchor: Anchor,
    pub(crate) depths: Box<[u16]>,
    pub(crate) sightings: Vec<Sighting>,
}

impl Look {
    pub(crate) fn depth(&self, i: usize) -> f64 {
        f64::from(self.depths.get(i).copied().unwrap_or(0)) / PER_METRE
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + 2 * self.depths.len() + size_of::<Sighting>() * self.sightings.len()
    }
}

/// Evidence of a view about a world point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// A surface at the point.
    Point,
    Nearer,
    /// A farther surface: the place is empty.
    Farther,
    /// Unknown: no depth, or outside of the image.
    Nothing,
}

/// Maximum depth difference within one surface, m: noise, which grows with the square of the depth (Khoshelham and Elberink, 2012), and
/// pose errors.
pub(crate) fn tolerance(z: f64) -> f64 {
    0.05 + 0.01 * z * z
}

/// Minimum depth, m.
const NEAREST: f64 = 0.2;

/// A view at its pose in the map.
pub(crate) struct Placed<'a> {
    pub(crate) look: &'a Look,
    pub(crate) grid: &'a Grid,
    /// The keyframe that it is anchored to, and its pose in that keyframe's camera.
    pub(crate) keyframe: KeyframeId,
    keyframe_from_camera: Se3,
    pub(crate) submap: SubmapId,
    pub(crate) world_from_camera: Se3,
    camera_from_world: Se3,
}

impl<'a> Placed<'a> {
    /// `None` if the map lacks its keyframe.
    pub(crate) fn new(look: &'a Look, grid: &'a Grid, view: &MapView) -> Option<Self> {
        let (keyframe, keyframe_from_camera) = look.anchor.hold(view)?;
        let world_from_camera = view.world_from_keyframe(keyframe)? * keyframe_from_camera;
        Some(Self {
            look,
            grid,
            keyframe,
            keyframe_from_camera,
            submap: view.submap_of(keyframe)?,
            camera_from_world: world_from_camera.inverse(),
            world_from_camera,
        })
    }

    #[cfg(test)]
    pub(crate) fn at(look: &'a Look, grid: &'a Grid, world_from_camera: Se3) -> Self {
        Self {
            look,
            grid,
            keyframe: KeyframeId(0),
            keyframe_from_camera: Se3::identity(),
            submap: SubmapId(0),
            camera_from_world: world_from_camera.inverse(),
            world_from_camera,
        }
    }

    pub(crate) fn keep(&self, in_camera: &Vec3) -> Option<(Point, Vec3)> {
        let at = self.keyframe_from_camera.transform(in_camera);
        let world = self.world_from_camera.transform(in_camera);
        Some((Point::new(self.keyframe, &at)?, world))
    }

    pub(crate) fn keep_world(&self, p: &Vec3) -> Option<Point> {
        self.keep(&self.camera_from_world.transform(p)).map(|k| k.0)
    }

    pub(crate) fn project(&self, p: &Vec3) -> Option<(Vec2, f64)> {
        let at = self.camera_from_world.transform(p);
        if at.z < NEAREST {
            return None;
        }
        let camera = &self.grid.camera;
        let px = camera.project(&at);
        let inside = px.x >= 0.0
            && px.y >= 0.0
            && px.x < f64::from(camera.width)
            && px.y < f64::from(camera.height);
        inside.then_some((px, at.z))
    }

    pub(crate) fn shows(&self, p: &Vec3) -> Shown {
        let found = self.project(p).and_then(|(px, z)| {
            let seen = self.look.depth(self.grid.nearest(px)?);
            (seen > 0.0).then_some((seen, z))
        });
        let Some((seen, z)) = found else {
            return Shown::Nothing;
        };
        let tolerance = tolerance(z);
        if seen > z + tolerance {
            Shown::Farther
        } else if seen < z - tolerance {
            Shown::Nearer
        } else {
            Shown::Point
        }
    }

    /// The depth of a world point, inside of the image or not, m.
    pub(crate) fn depth(&self, p: &Vec3) -> f64 {
        self.camera_from_world.transform(p).z
    }

    /// The pixel extent of a visible world point and, if it stands on a floor and is not occluded, of its foot: left, top, right, bottom.
    /// Legs are too thin for reduced images.
    pub(crate) fn extent(&self, p: &Vec3, floor: Option<&Floor>) -> Option<[f32; 4]> {
        let pixel = |p: &Vec3| {
            let (px, _) = self.project(p)?;
            (self.shows(p) == Shown::Point).then_some([px.x as f32, px.y as f32])
        };
        let [x, y] = pixel(p)?;
        let foot = floor.and_then(|f| pixel(&(p - f.height(p) * f.up)));
        let [u, v] = foot.unwrap_or([x, y]);
        Some([x.min(u), y.min(v), x.max(u), y.max(v)])
    }

    /// A point of the reduced image in the camera; `None` without depth.
    pub(crate) fn in_camera(&self, i: usize) -> Option<Vec3> {
        let z = self.look.depth(i);
        (z > 0.0).then(|| self.grid.camera.backproject(self.grid.pixel(i), z))
    }
}
